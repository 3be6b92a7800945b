"""An instruction's colour words follow what is painted, and only that; where they cannot, the copy is rejected."""

import json
from dataclasses import replace

import numpy as np
import pytest
from tabletop import gl, handle, scene

from rpaug import instruct, pipeline, recipe
from rpaug.instruct import Untrue
from rpaug.scene.naming.survey import survey
from rpaug.types import Scene


def after(recorded: Scene, *edits: dict) -> tuple[str, ...]:
    made = recipe.build({"version": 1, "edits": list(edits)})
    edited, draws = pipeline.draw(recorded, made, 1)
    return instruct.followed(edited, [one.describe() for one in draws])


def told(*texts: str) -> Scene:
    return replace(scene(), descriptions=texts)


@pytest.fixture(scope="module")
def block() -> str:
    """The colour word of the block that the robot picks up."""
    (name,) = {
        row.colour_name
        for row in survey(scene().episode, scene().bodies, scene().roles)
        if row.role == "manipulated"
    }
    return name


@gl
class TestFollowed:
    def paint(self, color: str, **more: object) -> dict:
        return {"op": "recolor", "target": {"role": "manipulated"}, "color": color, **more}

    def test_every_way_of_saying_it_follows(self, block):
        # As RLBench's pick_and_lift and stack_blocks word their variations.
        said = told(
            f"pick up the {block} block and lift it up to the target",
            f"Grasp a {block} block, then place it on the pad",
            "lift the block",
        )
        new = "orange" if block != "orange" else "azure"
        assert after(said, self.paint(new)) == (
            f"pick up the {new} block and lift it up to the target",
            f"Grasp an {new} block, then place it on the pad",
            "lift the block",
        )

    def test_paint_elsewhere_leaves_the_words(self, block):
        said = told(f"put the {block} block on the pad")
        assert after(said, {"op": "table_color"}) == said.descriptions
        assert after(said, {"op": "light_color"}) == said.descriptions
        cylinder = {"op": "recolor", "target": {"handle": handle("cylinder")}, "color": "white"}
        assert after(said, cylinder) == said.descriptions

    def test_a_shade_of_the_word_is_still_the_word(self):
        said = told("put the blue block on the pad")
        (block,) = scene().roles["manipulated"]
        judge = instruct._Judge(scene(), instruct.Painted({block: "navy"}, (), frozenset()))
        judge._named = lambda phrase: frozenset([block])  # type: ignore[method-assign]
        assert judge.rewritten(said.descriptions[0]) == said.descriptions[0]

    def test_a_new_pattern_has_no_colour_word(self, block):
        with pytest.raises(Untrue, match="another pattern"):
            after(
                told(f"put the {block} block on the pad"),
                {"op": "retexture", "target": {"role": "manipulated"}},
            )

    def test_another_thing_of_that_name_is_refused(self, block):
        with pytest.raises(Untrue, match="could be it too"):
            after(
                told(f"put the {block} block on the pad"),
                {"op": "recolor", "target": {"handle": handle("block_textured")}, "color": block},
            )

    def test_a_copy_whose_words_would_lie_is_rejected(self, block):
        said = replace(scene().episode, descriptions=(f"put the {block} block on the pad",))
        base = replace(scene(), episode=said, descriptions=said.descriptions)
        made = recipe.build(
            {"version": 1, "edits": [{"op": "retexture", "target": {"role": "manipulated"}}]}
        )
        edited, draws = pipeline.draw(base, made, 1)
        from rpaug import plan

        drawn = pipeline.render(
            edited, draws, plan.make([d.option.operator for d in draws], said, 0)
        )
        assert "pattern" in drawn.untrue
        assert drawn.episode.descriptions == said.descriptions


@pytest.mark.parametrize(
    ("text", "found"),
    [
        # RLBench's variation descriptions, by task.
        ("open the top drawer", []),
        ("put the ring on the azure spoke", [("azure", ("spoke",))]),
        (
            "push the maroon button, then push the green button",
            [("maroon", ("button",)), ("green", ("button",))],
        ),
        ("screw in the blue light bulb", [("blue", ("light", "bulb"))]),
        ("stack 2 red blocks", [("red", ("blocks",))]),
        ("reach the gray target", [("gray", ("target",))]),
        ("slide the block to pink target", [("pink", ("target",))]),
        ("put the orange in the drawer", []),
    ],
)
def test_colour_words_are_found_with_their_nouns(text, found):
    assert [(one.colour, one.nouns) for one in instruct.phrases(text)] == found


@gl
def test_it_is_written_and_reported(tmp_path, block):
    from rpaug import twin
    from rpaug.augment import Run, execute
    from rpaug.registry import adapter
    from rpaug.verify import verify

    take = twin.perform("pick_block", 3, frames=17, size=64)
    said = replace(take.episode, descriptions=(f"put the {block} block on the pad", "move it"))
    key = "pick_block/all_variations/episodes/episode0"
    adapter("rlbench").write(said, tmp_path / "in", key, dict)
    made = recipe.build(
        {
            "version": 1,
            "edits": [{"op": "recolor", "target": {"role": "manipulated"}, "color": "cyan"}],
        }
    )
    summary = execute(Run(tmp_path / "in", made, tmp_path / "out"))
    assert summary.copies == 1, summary
    out = adapter("rlbench").read(tmp_path / "out", key)
    assert out.descriptions == ("put the cyan block on the pad", "move it")
    report = json.loads((tmp_path / "out" / key / "rpaug.json").read_text())
    assert report["words"]["recorded"][0] == said.descriptions[0]
    findings = [
        one for one in verify(tmp_path / "out", tmp_path / "in").findings if one.level == "bad"
    ]
    assert not [one for one in findings if one.topic == "instruction"], findings


def test_numbers_are_no_colours():
    assert np.all([not list(instruct.phrases(text)) for text in ("", "slide 3 times", "PUSH!")])
