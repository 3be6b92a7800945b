"""Operators' own phrases: as rules of the grammar, and as examples of what may be said."""

import json
from dataclasses import dataclass

import pytest

from rpaug import Needs, Operator, Target
from rpaug.core import phrases, registry
from rpaug.language import talk, templates
from rpaug.language.messages import Meant, Mention, NotUnderstood, Wish, WishContext
from rpaug.language.rounds import said_after

SETTING = WishContext(cameras=("front", "wrist"))


@dataclass(frozen=True, kw_only=True)
class Haze(Operator):
    target: Target
    near: Target | None = None
    camera: str = "front"
    color: str = "white"
    share: float = 0.5
    count: int = 1
    range: tuple[float, float] = (0.0, 1.0)
    kind: str = "fog"

    needs = Needs(targets=("target",), anchors=("near",))


def meant(template: str, stated: str, **more: object) -> Meant | None:
    return templates.rule("haze", Haze, template)(
        stated, Wish(stated=stated, setting=SETTING, **more)
    )


@pytest.mark.parametrize(
    ("template", "stated", "edit"),
    [
        ("[please] haze {target}", "haze the cup", {"target": "cup"}),
        ("[please] haze {target}", "please haze the cup", {"target": "cup"}),
        ("haze {target} (by|with) {share}", "haze it with 30%", {"target": "bowl", "share": 0.3}),
        ("haze {target} in {color}", "haze the cup in green", {"target": "cup", "color": "green"}),
        ("haze {target} near {near}", "haze the cup near the bowl", {"target": "cup", "near": "bowl"}),
        ("haze {target} {count} times", "haze the cup three times", {"target": "cup", "count": 3}),
        ("haze {camera}", "haze the wrist camera", {"camera": "wrist"}),
        ("add {kind:fog|mist}", "add mist", {"kind": "mist"}),
        ("haze [from {range:number} to {range:number}]", "haze from 0.2 to 1", {"range": [0.2, 1]}),
        ("haze [from {range:number} to {range:number}]", "haze", {}),
    ],
)  # fmt: skip
def test_a_phrase_is_a_rule(template: str, stated: str, edit: dict) -> None:
    found = meant(template, stated, mention=Mention(kind="target", target="bowl"))
    assert found is not None
    assert found.edits == ({"op": "haze", **edit},)


def test_several_things_get_an_edit_each() -> None:
    found = meant("haze {target}", "haze the bowl and the cup")
    assert found is not None
    assert [edit["target"] for edit in found.edits] == ["bowl", "cup"]
    assert found.mention is None


def test_it_stands_for_what_was_named() -> None:
    found = meant("haze {target}", "haze the bowl")
    assert found is not None
    assert found.mention == Mention(kind="target", target="bowl")


def test_every_word_counts() -> None:
    assert meant("haze {target}", "haze") is None
    assert meant("haze {target} by {share}", "haze the cup by much") is None
    assert meant("add {kind:fog|mist}", "add smoke") is None
    with pytest.raises(NotUnderstood, match="front, wrist"):
        meant("haze {camera}", "haze the ceiling camera")


def test_every_kind_of_slot_has_a_pattern_that_its_example_fits() -> None:
    for kind, (words, value) in phrases.EXAMPLES.items():
        found = meant(f"haze with {{share:{kind}}}", f"haze with {words}")
        assert found is not None, kind
        assert found.edits == ({"op": "haze", "share": value},), kind


@pytest.mark.parametrize("name", registry.operator_names())
def test_what_we_say_of_ours_is_understood(name: str) -> None:
    operator = registry.operator(name)
    assert operator.phrases
    for text in operator.phrases:
        for whole in (True, False):
            stated = phrases.example(phrases.parse(text, operator), whole)
            edits = said_after(stated, (), SETTING).edits
            assert [edit["op"] for edit in edits] == [name], stated


def test_a_model_is_told_of_every_operator_and_how_to_ask_for_it() -> None:
    told = talk.operators()
    for name in registry.operator_names():
        kind = registry.operator(name)
        assert f"- {name}: {(kind.__doc__ or '').split()[0]}" in told
        wish, given = kind.examples[0]
        assert f"{wish!r}: {json.dumps(given)}" in told


def test_a_model_is_told_phrases_where_an_operator_brings_no_examples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry.operator("remove"), "examples", ())
    assert "'remove the red block'" in talk.operators(["remove"])
