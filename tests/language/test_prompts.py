"""Prompts are found by stage and version, and every example in them is one that the stage would accept."""

import json

import pytest

from rpaug.language import answers, prompting
from rpaug.language.messages import WishContext
from rpaug.language.rounds import said_after
from rpaug.pipeline import recipe

STAGES = sorted(prompting.LATEST)


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_has_a_prompt_with_examples(stage: str) -> None:
    found = prompting.prompt(stage)
    assert found.version == prompting.LATEST[stage]
    assert len(found.examples) >= 3
    stated = found.messages("Q", operators="OPS", categories="CATS", textures="TEX")
    assert [one["role"] for one in stated][:3] == ["system", "user", "assistant"]
    assert stated[-1] == {"role": "user", "content": "Q"}
    assert "{operators}" not in stated[0]["content"]
    assert "never" in stated[0]["content"].lower()


def test_the_managers_examples_are_valid() -> None:
    for asked, answered in prompting.prompt("manager").examples:
        question = json.loads(asked)
        answers.plan(json.loads(answered), question["wish"], len(question["earlier"]))


def test_the_operations_examples_are_what_the_grammar_says() -> None:
    for asked, answered in prompting.prompt("operation").examples:
        question, edits = json.loads(asked), json.loads(answered)["edits"]
        known = answers.known_words(f"{question['step']} {question['it']}", ())
        assert answers.edits({"edits": edits}, question["op"], known) == edits
        before = [f"paint the {question['it']} red"] if question["it"] else []
        assert (
            list(said_after(question["step"], before, WishContext()).edits[len(before) :]) == edits
        )


def test_the_renderers_examples_are_what_the_grammar_says() -> None:
    for asked, answered in prompting.prompt("renderer").examples:
        question = json.loads(asked)
        setting = WishContext(cameras=tuple(question["cameras"]))
        edit = answers.viewpoint(json.loads(answered), setting.cameras).edit()
        assert edit == said_after(question["step"], (), setting).edits[0]
        recipe.option("camera_pose", {name: value for name, value in edit.items() if name != "op"})
