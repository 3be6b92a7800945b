"""Every registered operator is held to the contract by a test of its own in this folder."""

from importlib import import_module
from pathlib import Path

import pytest

from rpaug import Operator
from rpaug.core import registry
from rpaug.pipeline.contracts import OperatorContract


def held() -> set[str]:
    """The operators that contract tests beside this one test: what their `operator` is annotated with, or returns."""
    found = set()
    for path in sorted(Path(__file__).parent.glob("test_*.py")):
        for value in vars(import_module(path.stem)).values():
            if not isinstance(value, type) or not issubclass(value, OperatorContract):
                continue
            kind = value.operator.__annotations__.get("return", Operator)
            if kind is Operator and value is not OperatorContract:
                kind = type(value().operator())
            found.add(kind.__name__)
    return found


@pytest.mark.parametrize("name", registry.operator_names())
def test_it_is_held_to_the_contract(name: str) -> None:
    kind = registry.operator(name).__name__
    assert kind in held(), f"subclass OperatorContract with `def operator(self) -> {kind}`"
