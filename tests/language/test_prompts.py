"""Prompts are found by stage and version, and every example in them is one that the stage would accept."""

import json

import pytest

from rpaug.language import answers, prompting
from rpaug.language.messages import WishContext

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
        answers.planned(json.loads(answered), question["wish"], len(question["earlier"]))


def test_the_wishs_examples_are_valid_recipes() -> None:
    for asked, answered in prompting.prompt("wish").examples:
        question = json.loads(asked)
        found = answers.understood(json.loads(answered), question["wish"], len(question["earlier"]))
        setting = WishContext(cameras=tuple(question["cameras"]))
        made = [answers.entry(edit, question["wish"], setting) for edit in found.edits]
        assert bool(made) != bool(found.refuse)
