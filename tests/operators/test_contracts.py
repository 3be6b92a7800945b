"""Every registered operator is held to the contract by a test of its own in this folder."""

from importlib import import_module
from pathlib import Path

import pytest

from rpaug import registry
from rpaug.testing import OperatorContract


def contracts() -> list[type[OperatorContract]]:
    """All contract tests that stand beside this one."""
    modules = [import_module(path.stem) for path in sorted(Path(__file__).parent.glob("test_*.py"))]
    return [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, OperatorContract)
    ]


@pytest.mark.parametrize("name", registry.operator_names())
def test_it_is_held_to_the_contract(name: str) -> None:
    kind = registry.operator(name)
    held = [one for one in contracts() if one is not OperatorContract]
    assert any(type(one().operator()) is kind for one in held), (
        f"subclass OperatorContract for {name}"
    )
