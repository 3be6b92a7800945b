"""Strict schemas keep OpenAI's published rules, take whatever the schema takes, and lead back to it."""

import json
from typing import Any, Literal

import pytest
from pydantic import BaseModel
from server_shapes import filled, strict_fault

from rpaug.core import registry
from rpaug.diagnosis import vision
from rpaug.language import answers, schemas
from rpaug.providers.strict_schema import answered, strict

OURS = {
    "plan": schemas.of_plan(),
    "wish": schemas.of_wish(("front", "wrist")),
    "guesses": vision.Guesses.model_json_schema(),
    **{name: schemas.of_wish(("front",), [name]) for name in registry.operator_names()},
}


@pytest.mark.parametrize("name", OURS)
def test_our_schemas_can_be_said_strictly(name: str) -> None:
    found = strict(OURS[name])
    assert found is not None
    assert strict_fault(found) is None


class Leaf(BaseModel):
    size: tuple[float, float] | None = None
    note: str = "none"


class Tree(BaseModel):
    kind: Literal["tree"]
    must: int | None
    share: dict[Literal["near", "far"], float] = {}
    leaves: list[Leaf] = []
    under: "Tree | Leaf | None" = None


WHOLE = Tree.model_json_schema()
VALUES: list[dict[str, Any]] = [
    {"kind": "tree", "must": None},
    {"kind": "tree", "must": 3, "leaves": [{"size": [1.0, 2.0]}, {}]},
    {"kind": "tree", "must": 1, "share": {"near": 0.5}, "under": {"kind": "tree", "must": None}},
    {"kind": "tree", "must": 1, "under": {"note": "last"}},
]


def schema() -> dict[str, Any]:
    """Pydantic refers to a schema that holds itself by name; strict mode wants an object at the root."""
    return WHOLE["$defs"]["Tree"] | {
        "$defs": {name: closed(one) for name, one in WHOLE["$defs"].items()}
    }


def closed(node: dict[str, Any]) -> dict[str, Any]:
    return node | {"additionalProperties": False}


@pytest.mark.parametrize("value", VALUES)
def test_what_is_left_out_is_null_and_left_out_again(value: dict[str, Any]) -> None:
    narrow = strict(schema())
    assert narrow is not None
    assert strict_fault(narrow) is None
    said = filled(value, narrow, narrow)
    assert said.keys() == {"kind", "must", "share", "leaves", "under"}
    assert answered(said, schema()) == value
    assert answered(value, schema()) == value


@pytest.mark.parametrize(
    "node",
    [
        {}, {"type": "object"}, {"type": "object", "additionalProperties": {"type": "number"}}, {"type": "array"},
        {"anyOf": [{"type": "string"}], "properties": {}}, {"enum": [[1]]}, {"not": {"type": "string"}},
        {"enum": list(range(1001))}, {"enum": ["x" * 100 + str(n) for n in range(251)]},
    ],
)  # fmt: skip
def test_what_strict_mode_has_no_words_for_is_not_said(node: dict[str, Any]) -> None:
    assert strict({"type": "object", "properties": {"a": node}, "required": ["a"]}) is None
    assert strict(node) is None


def test_the_rules_are_not_those_of_the_conversion() -> None:
    """The mock refuses what pydantic makes of the same models."""
    assert strict_fault(OURS["wish"]) is not None
    assert strict_fault(answers.Viewpoint.model_json_schema()) is not None
    assert strict_fault(schema()) is not None


def test_strict_schemas_are_small() -> None:
    assert max(len(json.dumps(strict(one))) for one in OURS.values()) < 40_000
