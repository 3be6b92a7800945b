"""What is wrong with a recipe is told in the words of recipes, and what was meant is guessed."""

import pytest
import yaml

from rpaug.core.errors import BadRecipe
from rpaug.pipeline import recipe

PAINT = "edits: [{op: recolor, target: {role: manipulated}, color: blue}]"
WORDS = [
    ("select: [a]", "select: found a list; expected `select: {episodes: ..., limit: ...}`"),
    ("select: {episodes: 3}", "select.episodes: found 3; expected a list"),
    ("slect: {episodes: [a]}", "slect: unknown key; did you mean select?"),
    ("select: {episode: [a]}", "did you mean episodes?"),
    ("select: {zzz: [a]}", "unknown key; known are: episodes, limit"),
    (PAINT.replace("recolor", "recolour"), "did you mean recolor?"),
    (PAINT.replace("manipulated", "manipulatd"), "did you mean manipulated?"),
    (PAINT.replace("blue", "bleu"), "did you mean blue?"),
    (PAINT.replace("color: blue", "colour: blue"), "colour: unknown key; did you mean color?"),
    (PAINT.replace("{role: manipulated}", "5"), "expected `target: {handle: ..., role: ..., text: ..."),
    ("edits: [{op: table_texture, texture: graniteblack}]", "did you mean granite_black?"),
    ("edits: [{op: camera_pose, camera: front, shift: big}]", "shift: found 'big'; expected a number"),
    ("edits: [{op: light_color, probability: 2}]", "probability: found 2; expected at most 1"),
    ("edits: [recolor]", "edits[0]: found 'recolor'; expected a mapping with `op` or `one_of`"),
    ("edits: {op: recolor}", "edits: found a mapping; expected a list"),
    ("copies: two", "copies: found 'two'; expected a whole number"),
    ("on_missing: skip", "did you mean skip_edit? expected one of: skip_edit, skip_copy, fail"),
    ("roles: {manipulatd: {handle: 3}}", "roles.manipulatd: found 'manipulatd'; did you mean manipulated?"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "words"), WORDS, ids=[given for given, _ in WORDS])
def test_in_the_words_of_recipes(given: str, words: str) -> None:
    with pytest.raises(BadRecipe) as caught:
        recipe.build({"version": 1, **yaml.safe_load(given)}, name="r.yaml")
    assert words in str(caught.value)
    assert "Input should" not in str(caught.value)
    assert str(caught.value).count("edits[0]: found") <= 1
