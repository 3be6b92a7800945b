"""An instruction's color words follow what is painted, and only that; where they cannot, the copy is rejected."""

import json
from dataclasses import replace
from functools import cache

import boxes
import numpy as np
import pytest
from analysed import analysed
from tabletop import gl, instance_id, scene, take

from rpaug import instruct, twin
from rpaug.core.files import encode_png
from rpaug.core.types import Scene
from rpaug.instruct import Untrue
from rpaug.instruct.changes import Changes
from rpaug.instruct.judging import Judge
from rpaug.operators.insert import Insert
from rpaug.pipeline import copies, recipe
from rpaug.scene.build import build
from rpaug.scene.targets import targets
from rpaug.scene.targets.survey import survey


def after(recorded: Scene, *edits: dict) -> tuple[str, ...]:
    made = recipe.build({"version": 1, "edits": list(edits)})
    edited, draws = copies.draw(recorded, made, 1)
    return instruct.followed(edited, [(one.option.operator, one.edit) for one in draws]).texts


def given(*texts: str) -> Scene:
    return replace(scene(), descriptions=texts)


@pytest.fixture(scope="module")
def block() -> str:
    """The color word of the block that the robot picks up."""
    (name,) = {
        row.color_name
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
        stated = given(
            f"pick up the {block} block and lift it up to the target",
            f"Grasp a {block} block, then place it on the pad",
            "lift the block",
        )
        new = "olive"
        assert after(stated, self.paint(new)) == (
            f"pick up the {new} block and lift it up to the target",
            f"Grasp an {new} block, then place it on the pad",
            "lift the block",
        )

    def test_words_that_name_nothing_may_not_keep_the_old_color(self, block):
        new = "olive"
        stated = given(f"lift the {block} block", f"lift_{block}_block_table")
        with pytest.raises(Untrue, match=f"still says '{block}'"):
            after(stated, self.paint(new))

    def test_paint_elsewhere_leaves_the_words(self, block):
        stated = given(f"put the {block} block on the pad")
        assert after(stated, {"op": "table_color"}) == stated.descriptions
        assert after(stated, {"op": "light_color"}) == stated.descriptions
        cylinder = {
            "op": "recolor",
            "target": {"handle": instance_id("cylinder")},
            "color": "white",
        }
        assert after(stated, cylinder) == stated.descriptions

    def test_a_shade_of_the_word_is_still_the_word(self):
        stated = given("put the blue block on the pad")
        (block,) = scene().roles["manipulated"]
        judge = Judge(scene(), scene(), Changes(words={block: "navy"}))
        judge._found = lambda *_, **__: frozenset([block])  # type: ignore[method-assign]
        assert judge.rewritten(stated.descriptions[0]) == stated.descriptions[0]

    @pytest.mark.parametrize(
        ("thing", "color", "text", "new"),
        [
            ("block_plain", "green", "pick up the RED block", "pick up the GREEN block"),
            ("cylinder", "orange", "LIFT A GREEN CYLINDER", "LIFT AN ORANGE CYLINDER"),
            ("pad", "blue", "put it on the white pad", "put it on the blue pad"),
            ("block_plain", "purple", "push the reddish block", "push the purple block"),
            ("cylinder", "purple", "lift the greenish cylinder", "lift the purple cylinder"),
            ("block_plain", "green", "push the dark red block", "push the green block"),
            ("block_plain", "cyan", "slide the bright red block", "slide the cyan block"),
            ("block_small", "yellow", "take the navy blue block", "take the yellow block"),
            ("block_small", "pink", "grab the light blue block", "grab the pink block"),
            ("block_plain", "green", "push the scarlet block", "push the green block"),
            ("cylinder", "purple", "move the emerald cylinder", "move the purple cylinder"),
            ("block_plain", "green", "push the ruby block", "push the green block"),
            ("block_plain", "green", "push the blood-red block", "push the green block"),
            ("pad", "blue", "put it on the off-white pad", "put it on the blue pad"),
            ("block_plain", "cyan", "push the block that is red", "push the block that is cyan"),
        ],
    )  # fmt: skip
    def test_near_names_tones_and_capitals_follow(self, thing, color, text, new):
        paint = {"op": "recolor", "target": {"handle": instance_id(thing)}, "color": color}
        assert after(given(text), paint) == (new,)

    def test_a_near_name_that_two_things_may_have_is_refused(self, block):
        paint = {"op": "recolor", "target": {"handle": instance_id("block_plain")}, "color": "blue"}
        with pytest.raises(Untrue, match="cannot be told"):
            after(given("push the pink block"), paint)

    @pytest.mark.parametrize(
        "text",
        [
            "pose le bloc rouge sur le plateau",
            "recoge el objeto rojo",
            "lege den roten Würfel auf die Matte",
            "bloc rouge",
            "把红色方块放到垫子上",
        ],
    )
    def test_another_language_is_left_with_a_line(self, text):
        paint = {"op": "recolor", "target": {"handle": instance_id("block_plain")}, "color": "blue"}
        made = recipe.build({"version": 1, "edits": [paint]})
        edited, draws = copies.draw(given(text), made, 1)
        found = instruct.followed(edited, [(one.option.operator, one.edit) for one in draws])
        assert found.texts == (text,)
        assert len(found.left) == 1
        assert instruct.followed(given(text), []) == instruct.Followed((text,))

    def test_the_color_of_another_is_refused(self):
        paint = {"op": "recolor", "target": {"handle": instance_id("block_plain")}, "color": "blue"}
        with pytest.raises(Untrue, match="is azure: blue block could be it too"):
            after(given("push the red block"), paint)

    def patterned(self, texture: str) -> dict:
        return {"op": "retexture", "target": {"role": "manipulated"}, "texture": texture}

    def test_a_new_pattern_is_said_where_no_other_has_one(self, block):
        stated = given(f"put the {block} block on the pad")
        (own,) = scene().roles["manipulated"]
        others = frozenset({instance_id("block_small")})
        for other, told_apart in (
            (others, True),
            (others | {instance_id("block_textured")}, False),
        ):
            judge = Judge(scene(), scene(), Changes(words={own: "checkered"}))
            known = {"block": other | {own}, f"{block} block": frozenset([own])}
            judge._found = lambda stated, *_, known=known, **__: known.get(stated)  # type: ignore[method-assign]
            if told_apart:
                assert (
                    judge.rewritten(stated.descriptions[0]) == "put the checkered block on the pad"
                )
            else:
                with pytest.raises(Untrue, match="a pattern of its own"):
                    judge.rewritten(stated.descriptions[0])

    def test_among_patterned_blocks_a_new_pattern_is_refused(self, block):
        with pytest.raises(Untrue, match="a pattern of its own"):
            after(given(f"put the {block} block on the pad"), self.patterned("checker_green"))

    def test_an_image_of_ones_own_has_no_word(self, tmp_path, block):
        halves = np.zeros((8, 8, 3), np.uint8)
        halves[:4] = 255
        (tmp_path / "own.png").write_bytes(encode_png(halves))
        own = self.patterned("own.png") | {"textures": str(tmp_path)}
        with pytest.raises(Untrue, match="another pattern"):
            after(given(f"put the {block} block on the pad"), own)

    def test_a_texture_of_one_color_is_called_by_it(self, block):
        stated = given(f"put the {block} block on the pad")
        assert after(stated, self.patterned("felt_purple")) == ("put the purple block on the pad",)

    def test_a_pattern_needs_no_color_word_where_the_noun_is_enough(self):
        judge = Judge(scene(), scene(), Changes(words={instance_id("pad"): None}))
        pad = frozenset([instance_id("pad")])
        judge._found = lambda stated, *_, **__: pad if "pad" in stated else frozenset()  # type: ignore[method-assign]
        assert judge.rewritten("touch the white pad") == "touch the pad"

    def test_another_thing_of_that_name_is_refused(self, block):
        with pytest.raises(Untrue, match="could be it too"):
            after(
                given(f"put the {block} block on the pad"),
                {
                    "op": "recolor",
                    "target": {"handle": instance_id("block_textured")},
                    "color": block,
                },
            )

    def test_a_copy_whose_words_would_lie_is_rejected(self, block):
        stated = replace(scene().episode, descriptions=(f"put the {block} block on the pad",))
        base = replace(scene(), episode=stated, descriptions=stated.descriptions)
        made = recipe.build({"version": 1, "edits": [self.patterned("checker_green")]})
        edited, draws = copies.draw(base, made, 1)
        from rpaug.pipeline import plan

        drawn = copies.render(
            edited, draws, plan.make([d.option.operator for d in draws], stated, 0)
        )
        assert "pattern" in drawn.untrue
        assert drawn.episode.descriptions == stated.descriptions


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
def test_color_words_are_found_with_their_nouns(text, found):
    assert [(one.color, one.nouns) for one in instruct.phrases(text) if one.color] == found


@gl
def test_it_is_written_and_reported(tmp_path, block):
    from rpaug.core.registry import adapter
    from rpaug.pipeline.augment import Run, execute
    from rpaug.pipeline.verify import verify

    recorded = twin.perform("pick_block", 3, frames=17, size=64)
    stated = replace(
        recorded.episode, descriptions=(f"put the {block} block on the pad", "move it")
    )
    key = "pick_block/all_variations/episodes/episode0"
    adapter("rlbench").write(stated, tmp_path / "in", key, dict)
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
    assert report["words"]["recorded"][0] == stated.descriptions[0]
    findings = [
        one for one in verify(tmp_path / "out", tmp_path / "in").findings if one.level == "bad"
    ]
    assert not [one for one in findings if one.topic == "instruction"], findings


def test_numbers_are_no_colors():
    assert np.all([not list(instruct.phrases(text)) for text in ("", "slide 3 times", "PUSH!")])


# What RLBench's tasks say, and the phrases in it that name a thing: color, word for size or place, nouns.
RLBENCH = {
    "open the top drawer": [(None, "top", ("drawer",))],
    "screw in the blue light bulb": [("blue", None, ("light", "bulb"))],
    "sweep dirt to the short dustpan": [(None, None, ("dirt",)), (None, "short", ("dustpan",))],
    "stack the other cups on top of the red cup": [
        (None, None, ("other", "cups")),
        ("red", None, ("cup",)),
    ],
    "use the stick to drag the cube onto the red target": [
        (None, None, ("stick",)),
        (None, None, ("cube",)),
        ("red", None, ("target",)),
    ],
    "put the money away in the safe on the bottom shelf": [
        (None, None, ("money",)),
        (None, None, ("safe",)),
        (None, "bottom", ("shelf",)),
    ],
    "take the steak off the grill": [(None, None, ("steak",)), (None, None, ("grill",))],
    "hang mug on rack": [(None, None, ("mug",)), (None, None, ("rack",))],
    "place 3 cups on the cup holder": [(None, None, ("cups",)), (None, None, ("cup", "holder"))],
    "turn left tap": [(None, "left", ("tap",))],
    "pick up the small cup and put it in the large one": [
        (None, "small", ("cup",)),
        (None, "large", ("cup",)),
    ],
    "slide 3 times": [],
    "push it, then lift it up": [],
}


@pytest.mark.parametrize("text", RLBENCH)
def test_phrases_of_variation_descriptions(text: str) -> None:
    found = [(p.color, p.rank.text if p.rank else None, p.nouns) for p in instruct.phrases(text)]
    assert found == RLBENCH[text]


@cache
def cups() -> twin.Take:
    return twin.perform("stack_cups", 2, frames=17, size=96)


@cache
def two_cups() -> Scene:
    return build(cups().episode, with_bodies=True)


def edited(base: Scene, instance_id: int, *texts: str, **body: object) -> Scene:
    """The scene saying `texts`, with one body other than recorded; without fields of its own it is gone."""
    bodies = [
        one if instance_id not in one.instance_ids else replace(one, **body)  # type: ignore[arg-type]
        for one in base.bodies
        if body or instance_id not in one.instance_ids
    ]
    return replace(base, descriptions=texts, bodies=tuple(bodies), recorded_bodies=base.bodies)


@gl
class TestSizes:
    SMALL, LARGE = "cup_small", "cup_large"

    def grown(self, name: str, factor: float, *texts: str) -> tuple[str, ...]:
        instance_id = cups().truth.handles[name]
        return instruct.followed(edited(two_cups(), instance_id, *texts, scale=factor), []).texts

    def test_the_smaller_one_that_is_the_larger_now_is_called_so(self):
        stated = ("put the small cup into the large one", "Put the small blue cup away")
        assert self.grown(self.SMALL, 1.6, *stated) == (
            "put the large cup into the small one",
            "Put the large blue cup away",
        )

    def test_a_word_that_is_still_true_stays(self):
        stated = ("put the small cup into the large one", "stack the cups", "take the big cup")
        assert self.grown(self.SMALL, 1.05, *stated) == stated
        assert self.grown(self.LARGE, 1.2, *stated) == stated

    def test_what_stands_alone_has_no_other_to_be_compared_with(self):
        tall = instance_id("cylinder")
        stated = edited(scene(), tall, "take the small green cylinder", scale=1.1)
        with pytest.raises(Untrue, match=r"1\.10 times its size"):
            instruct.followed(stated, [])
        stated = edited(scene(), tall, "take the large green cylinder", scale=1.1)
        assert instruct.followed(stated, []).texts == stated.descriptions

    def test_neither_the_smallest_nor_the_largest_is_refused(self):
        (small,) = targets.find(scene(), targets.Target(text="smallest block"))
        with pytest.raises(Untrue, match="another thing now"):
            instruct.followed(edited(scene(), small, "push the smallest block", scale=1.2), [])

    def test_words_that_cannot_be_compared_are_refused(self):
        with pytest.raises(Untrue, match=r"0\.90 times its size"):
            self.grown(self.LARGE, 0.9, "put it into the wide orange cup")


@gl
class TestGone:
    def test_what_is_named_must_be_there(self):
        for stated in ("pick the block next to the green cylinder", "knock over the cylinder"):
            with pytest.raises(Untrue, match="was taken out"):
                instruct.followed(edited(scene(), instance_id("cylinder"), stated), [])

    def test_what_is_not_named_may_go(self, block):
        stated = edited(
            scene(), instance_id("cylinder"), f"put the {block} block on the pad", "lift it"
        )
        assert instruct.followed(stated, []).texts == stated.descriptions

    def test_a_noun_that_means_nothing_here_may_be_what_is_gone(self):
        stated = "put the block on the pad near the gizmo"
        with pytest.raises(Untrue, match="cannot be told whether 'gizmo'"):
            instruct.followed(edited(scene(), instance_id("cylinder"), stated), [])

    @pytest.mark.parametrize(
        "stated",
        [
            "grip the top gizmo and put the block on the pad",
            "pick up the gizmo, then push all of the widgets",
        ],
    )
    def test_what_the_robot_handles_is_not_what_it_left_alone(self, stated):
        gone = edited(scene(), instance_id("cylinder"), stated)
        assert instruct.followed(gone, []).texts == gone.descriptions

    def test_a_color_tells_more_than_the_verb(self):
        with pytest.raises(Untrue, match="was taken out"):
            instruct.followed(edited(scene(), instance_id("cylinder"), "grip the green gizmo"), [])

    def test_what_is_told_by_its_place_must_stay_there(self):
        away = np.eye(4)
        away[0, 3] = 0.2
        moved = {"to_world": np.tile(away, (17, 1, 1))}
        for stated in ("take the block next to the cylinder", "take the leftmost cylinder"):
            gone = edited(scene(), instance_id("cylinder"), stated, **moved)
            if "leftmost" in stated:  # the only one is so wherever it stands
                assert instruct.followed(gone, []).texts == gone.descriptions
            else:
                with pytest.raises(Untrue, match="was moved"):
                    instruct.followed(gone, [])


@pytest.fixture(scope="module")
def chest() -> Scene:
    return analysed(boxes.chest(1, 3, 1).episode())


class TestParts:
    """What an instruction tells by its place is told by it still, or the copy is rejected."""

    MIDDLE, TOP = boxes.DRAWERS + 1, boxes.DRAWERS + 2
    TEXT = "grip the middle handle and pull the middle drawer open"

    def test_its_neighbors_may_change_color(self, chest):
        told = replace(chest, descriptions=(self.TEXT,))
        judge = Judge(told, told, Changes(words={self.TOP: "red"}))
        assert judge.rewritten(self.TEXT) == self.TEXT

    def test_only_the_drawer_that_is_meant_gives_the_color(self, chest):
        text = "open the gray drawer"
        told = replace(chest, descriptions=(text,))
        assert Judge(told, told, Changes(words={self.MIDDLE: "red"})).rewritten(text) == (
            "open the red drawer"
        )

    def test_without_its_neighbor_it_is_the_middle_one_no_more(self, chest):
        with pytest.raises(Untrue, match="another thing now"):
            instruct.followed(edited(chest, self.TOP, self.TEXT), [])

    def test_a_neighbor_that_is_there_twice_leaves_the_words_unclear(self, chest):
        told = replace(chest, descriptions=(self.TEXT,))
        judge = Judge(told, told, Changes(copied=frozenset([self.TOP])))
        with pytest.raises(Untrue, match="one more thing could be"):
            judge.rewritten(self.TEXT)

    def test_a_neighbor_that_is_moved_below_makes_it_another(self, chest):
        (top,) = [body for body in chest.bodies if self.TOP in body.instance_ids]
        below = top.to_world @ boxes.at(0, 0, -0.3)
        with pytest.raises(Untrue, match="another thing now"):
            instruct.followed(edited(chest, self.TOP, self.TEXT, to_world=below), [])


@gl
class TestAdded:
    """A new thing that the words fit as well makes them unclear."""

    def put(self, asset: str, *texts: str) -> tuple[str, ...]:
        scene = given(*texts)
        return instruct.followed(scene, [(Insert(), {"things": [{"asset": asset}]})]).texts

    @pytest.mark.parametrize(
        ("asset", "text"),
        [
            ("mug_red", "pick up the red cup"),
            ("mug_red", "pick up the mug and hang it on the rack"),
            ("mug_blue", "stack the cups"),
            ("block_oak", "put the cube on the pad"),
            ("apple", "put the apple in the bowl"),
            ("bottle_green", "take the green one"),
            ("can_red", "pick up the red thing"),
            ("bottle_green", "grasp the green object"),
            ("apple", "move the round red item"),
            ("apple", "put the fruit in the bowl"),
        ],
    )
    def test_such_a_thing_is_refused(self, asset: str, text: str) -> None:
        with pytest.raises(Untrue, match="was put in"):
            self.put(asset, text)

    @pytest.mark.parametrize(
        ("asset", "text"),
        [
            ("mug_blue", "pick up the red cup"),
            ("can_red", "pick up the red bottle"),
            ("lemon", "put the apple in the bowl"),
            ("book_red", "put the red block on the pad"),
            ("mug_red", "lift it"),
        ],
    )
    def test_another_thing_is_not(self, asset: str, text: str) -> None:
        assert self.put(asset, text) == (text,)

    def test_it_is_drawn_again_until_the_words_are_clear(self, tmp_path):
        from rpaug.core.registry import adapter
        from rpaug.pipeline.augment import Run, execute

        stated = replace(take().episode, descriptions=("take the red mug",))
        key = "pick_block/all_variations/episodes/episode0"
        adapter("rlbench").write(stated, tmp_path / "in", key, dict)
        recipe_ = {"version": 1, "copies": 3, "edits": [{"op": "insert", "category": "mug"}]}
        once = execute(Run(tmp_path / "in", recipe.build(recipe_), tmp_path / "once"))
        several = recipe.build({**recipe_, "gates": {"tries": 8}})
        again = execute(Run(tmp_path / "in", several, tmp_path / "again"))
        assert (once.copies, again.copies) == (once.copies, 3)
        assert once.copies < 3
        for path in (tmp_path / "again").rglob("rpaug.json"):
            (thing,) = json.loads(path.read_text())["draws"][0]["edit"]["things"]
            assert thing["asset"] == "mug_blue"
