"""A model words the instruction, and rules check what it says: nothing that the scene contradicts, nothing unheard."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from tabletop import gl, instance_id, scene, take

from rpaug import instruct
from rpaug.core.errors import RpaugError
from rpaug.core.types import Scene
from rpaug.instruct.wording import Wording, wording
from rpaug.operators.insert import Insert
from rpaug.pipeline import copies, recipe
from rpaug.pipeline.prepare import build_and_plan
from rpaug.providers.language import LanguageError

PURPLE = {"op": "recolor", "target": {"handle": "block_plain"}, "color": "purple"}


@dataclass
class Model:
    """Answers with what it was given, once each; what is asked is kept."""

    answers: list[Any]
    asked: list[str] = field(default_factory=list)

    def ask(self, messages: Any, name: str, schema: Any, check: Any) -> Any:
        self.asked.append(messages[-1]["content"])
        try:
            return check(self.answers.pop(0))
        except (RpaugError, KeyError, IndexError) as error:
            raise LanguageError(f"no answer that holds: {error}") from None


def given(text: str) -> Scene:
    return replace(scene(), descriptions=(text,))


def painted(text: str, **model: Any) -> instruct.Followed:
    """The instruction after the plain red block was painted purple."""
    edit = {**PURPLE, "target": {"handle": instance_id("block_plain")}}
    made = recipe.build({"version": 1, "edits": [edit]})
    edited, draws = copies.draw(given(text), made, 1)
    done = [(one.option.operator, one.edit) for one in draws]
    return instruct.followed(edited, done, Wording(**model), np.random.default_rng(0))


def said(text: str, english: str = "", before: str = "") -> Model:
    return Model([{"text": text, "english": english, "recorded_english": before}])


@gl
class TestModelFirst:
    RED = "pick up the red block"

    def test_its_words_are_taken_where_they_hold(self):
        model = said("lift the purple block")
        found = painted(self.RED, endpoint=model, first=True)
        assert found == instruct.Followed(("lift the purple block",))
        assert f"{instance_id('block_plain')} is purple now" in model.asked[0]

    @pytest.mark.parametrize(
        ("wrong", "why"),
        [
            ("pick up the red block", "nothing is"),
            ("pick up the green cylinder", "does not name"),
            ("pick up the purple block with the spoon", "nothing that the recording shows"),
            ("pick up the purple block and the green cylinder", "not what"),
            ("pick up the 3 purple blocks", "other numbers"),
            ("pick up the leftmost purple block", "another place"),
            ("", "one line"),
            ("pick up the purple block\x07", "one line"),
        ],
    )
    def test_else_the_rules_word_it_with_a_line(self, wrong, why):
        found = painted(self.RED, endpoint=said(wrong), first=True)
        assert found.texts == ("pick up the purple block",)
        (line,) = found.left
        assert "worded by rules" in line
        assert why in line

    def test_another_language_is_checked_by_its_english(self):
        text, new = "prends le bloc rouge", "prends le bloc violet"
        right = said(new, "take the purple block", "take the red block")
        assert painted(text, endpoint=right, first=True) == instruct.Followed((new,))
        wrong = said(new, "take the red block", "take the red block")
        found = painted(text, endpoint=wrong, first=True)
        assert found.texts == (text,)
        assert len(found.left) == 2

    def test_words_may_be_made_clear_where_rules_refuse(self):
        base = given("pick up the green object")
        put_in = [(Insert(), {"things": [{"asset": "bottle_green"}]})]
        clear = said("pick up the green cylinder")
        with pytest.raises(instruct.Untrue):
            instruct.followed(base, put_in)
        still = Wording(said("grasp the green thing"), first=True)
        with pytest.raises(instruct.Untrue, match="was put in"):
            instruct.followed(base, put_in, still)
        base = given("pick up the green cylinder")
        put_in = [(Insert(), {"things": [{"asset": "mug_blue"}]})]
        assert not instruct.followed(base, put_in, Wording(clear, first=True)).left


@gl
class TestParaphrases:
    TEXTS = ("grab the red block", "grasp the red block", "lift the green cylinder")

    def test_those_that_hold_are_drawn_and_asked_for_once(self):
        model = Model([{"texts": list(self.TEXTS)}])
        asked = Wording(model, paraphrases=3)
        drawn = [
            instruct.followed(given("lift the red block"), [], asked, np.random.default_rng(n))
            for n in range(20)
        ]
        assert {one.texts[0] for one in drawn} == {"lift the red block", *self.TEXTS[:2]}
        assert all("2 of 3 paraphrases" in one.left[0] for one in drawn)
        assert len(model.asked) == 1

    def test_without_an_answer_the_words_stay_with_a_line(self):
        asked = Wording(Model([]), paraphrases=3)
        found = instruct.followed(given("lift the red block"), [], asked, np.random.default_rng(0))
        assert found.texts == ("lift the red block",)
        assert "no paraphrase" in found.left[0]

    def test_originals_keep_their_words_and_a_report_gives_its_own(self):
        made = recipe.build({"version": 1, "instructions": {"paraphrases": 3}, "edits": []})
        vars(made)["wording"] = Wording(Model([{"texts": list(self.TEXTS)}]), paraphrases=3)
        text = replace(take().episode, descriptions=("lift the red block",))
        built, plan = build_and_plan(text, made, 0)
        prepared = copies.PreparedEpisode(built, plan, made)
        several = [copies.draw_copy(prepared, n).episode.instruction for n in (1, 1, 2, 3, 4, 5)]
        assert several[0] == several[1]
        assert len({*several}) > 1
        assert copies.draw_copy(prepared, 0).episode.instruction == "lift the red block"
        known = copies.Known(draws=[], words=["as it was written"])
        replayed = copies.draw_copy(prepared, 2, known=known)
        assert replayed.episode.instruction == "as it was written"


def test_without_a_model_it_is_refused(monkeypatch, tmp_path):
    monkeypatch.delenv("RPAUG_LLM_URL", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert wording(False, 0) is None
    with pytest.raises(LanguageError, match="RPAUG_LLM_URL"):
        wording(False, 3)
