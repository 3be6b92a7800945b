"""Recipes: what is accepted, what is refused and where, and that draws are reproducible."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpaug import BadRecipe
from rpaug.core import registry
from rpaug.core.errors import RpaugError
from rpaug.core.types import Scene
from rpaug.pipeline import copies, inputs, recipe
from rpaug.scene.build import build

GOOD = """\
version: 1
seed: 7
copies: 2
edits:
  - op: recolor
    target: {role: manipulated}
    color: blue
    probability: 0.8
  - one_of:
      - {op: light_color, weight: 3}
      - {op: recolor, target: {handle: 48}, color: {rgb: [1, 0, 0]}}
"""


def load(tmp_path: Path, text: str, *overrides: str) -> recipe.Recipe:
    path = tmp_path / "r.yaml"
    path.write_text(text)
    return recipe.load(path, overrides)


def refusal(tmp_path: Path, text: str, *overrides: str) -> str:
    with pytest.raises(BadRecipe) as caught:
        load(tmp_path, text, *overrides)
    return str(caught.value)


def test_a_good_recipe_is_understood(tmp_path: Path) -> None:
    made = load(tmp_path, GOOD)
    assert (made.seed, made.copies, len(made.steps)) == (7, 2, 2)
    assert made.steps[0].probability == 0.8
    assert [option.name for option in made.steps[1].options] == ["light_color", "recolor"]
    assert made.steps[1].options[0].weight == 3


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("color: blue", "color: bluu", ["r.yaml:7: edits[0].color", "bluu", "azure"]),
        ("color: blue", "color: {rgb: [0, 0, 1.5]}", ["r.yaml:7", "1.5", "0..1"]),
        ("color: blue", "color: {lab: [101, 0, 0]}", ["r.yaml:7", "101"]),
        ("color: blue", "colour: blue", ["edits[0].colour", "unknown key"]),
        ("op: recolor\n", "op: recolour\n", ["r.yaml:5: edits[0].op", "recolor", "light_color"]),
        ("probability: 0.8", "probability: 1.8", ["r.yaml:8: edits[0].probability"]),
        ("seed: 7", "seed: -1", ["r.yaml:2: seed"]),
        ("copies: 2", "copies: 0", ["r.yaml:3: copies"]),
        ("version: 1", "version: 2", ["r.yaml:1: version"]),
        ("seed: 7", "sed: 7", ["r.yaml:2: sed", "unknown key"]),
        ("copies: 2", "gates: {tries: 0}", ["r.yaml:3: gates.tries", "at least 1"]),
        ("copies: 2", "copies: 2\ncopies: 3", ["r.yaml:4: found copies given twice"]),
        ("seed: 7", "seed: &a 7\narms: !!set {x}", ["r.yaml:3", "!!set"]),
        ("color: blue", "color: 2001-01-01", ["r.yaml:7", "timestamp", "quotes make it text"]),
        ("copies: 2", "copies: " + "1" + ":59" * 200, ["r.yaml:3", "a number that does not end"]),
        ("role: manipulated", "roll: manipulated", ["edits[0].target"]),
        ("weight: 3", "weight: 0", ["edits[1].one_of[0].weight"]),
        ("weight: 3", "weight: .inf", ["edits[1].one_of[0].weight"]),
        ("weight: 3", "probability: 0.0", ["edits[1].one_of[0].probability", "unknown key"]),
        ("probability: 0.8", "weight: 2", ["edits[0].weight", "unknown key"]),
        ("version: 1", "version: true", ["r.yaml:1: version"]),
        ("copies: 2", "? [a, b]\n: c", ["r.yaml:3", "no word"]),
        ("copies: 2", "copies: [2", ["r.yaml:"]),
        ("copies: 2", "copies: !!python/object/apply:os.system [ls]", ["r.yaml:3", "python"]),
    ],
)
def test_faults_are_named_with_line_and_key(
    tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    assert old in GOOD
    message = refusal(tmp_path, GOOD.replace(old, new, 1))
    assert all(word in message for word in words), message


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    text = GOOD.replace("color: blue", "color: bluu").replace("seed: 7", "seed: x")
    message = refusal(tmp_path, text)
    assert "seed" in message
    assert "bluu" in message


def test_a_bomb_of_aliases_is_refused(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert "values" in refusal(tmp_path, "\n".join(lines))


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    assert "r.yaml" in refusal(tmp_path, "[" * 3000)


def test_not_a_mapping_not_text_not_there(tmp_path: Path) -> None:
    assert "found a list" in refusal(tmp_path, "- 1")
    assert "found nothing" in refusal(tmp_path, "")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe")
    with pytest.raises(BadRecipe, match="UTF-8"):
        recipe.load(tmp_path / "b.yaml")


@pytest.mark.parametrize(
    ("text", "line", "found"), [("vers", 1, "'vers'"), ("\n- 1", 2, "a list"), ("", 1, "nothing")]
)
def test_what_is_no_mapping_is_refused_by_its_line(
    tmp_path: Path, text: str, line: int, found: str
) -> None:
    path = tmp_path / "recipe.yaml"
    path.write_text(text)
    with pytest.raises(BadRecipe, match=rf"recipe\.yaml:{line}: found {found}; expected keys"):
        recipe.load(path)


def test_values_can_be_set_from_outside(tmp_path: Path) -> None:
    made = load(tmp_path, GOOD, "seed=9", "edits.0.color=red", "select.limit=3")
    assert made.seed == 9
    assert made.steps[0].options[0].fields["color"] == "red"
    assert made.select.limit == 3
    assert "bluu" in refusal(tmp_path, GOOD, "edits.0.color=bluu")
    assert "--set edits.9.x=1" in refusal(tmp_path, GOOD, "edits.9.x=1")
    assert "key.path=value" in refusal(tmp_path, GOOD, "seed")


def test_the_schema_knows_every_operator() -> None:
    schema = recipe.schema()
    items = schema["properties"]["edits"]["items"]["oneOf"]
    names = {item["$ref"].removeprefix("#/$defs/") for item in items}
    assert {"op_recolor", "op_light_color", "op_camera_pose", "one_of"} <= names
    assert all(name in schema["$defs"] for name in names)
    assert schema["$defs"]["op_recolor"]["required"] == ["op", "target", "color"]


def test_a_schema_is_that_of_the_operators_there_are_now(monkeypatch: pytest.MonkeyPatch) -> None:
    recipe.schema()["$defs"].clear()  # who changes theirs changes nobody else's
    assert "op_recolor" in recipe.schema()["$defs"]
    others = [name for name in registry.operator_names() if name != "recolor"]
    monkeypatch.setattr(registry, "operator_names", lambda: others)
    assert "op_recolor" not in recipe.schema()["$defs"]


@given(st.integers(0, 2**40), st.text(max_size=20), st.integers(0, 99), st.integers(0, 9))
def test_random_streams_depend_on_nothing_but_their_names(
    seed: int, key: str, copy: int, step: int
) -> None:
    made = recipe.build({"version": 1, "seed": seed})
    other = recipe.build({"version": 1, "seed": seed, "copies": 9})
    first = made.generator(key, copy, step).random(4)
    assert np.array_equal(first, other.generator(key, copy, step).random(4))
    assert not np.array_equal(first, made.generator(key, copy, step + 1).random(4))
    assert not np.array_equal(first, made.generator(key + "x", copy, step).random(4))


def test_probability_and_weights_are_met() -> None:
    entry = {"op": "light_color"}
    made = recipe.build(
        {
            "version": 1,
            "edits": [
                {
                    "one_of": [{**entry, "weight": 3}, {"op": "camera_pose", "camera": "front"}],
                    "probability": 0.5,
                }
            ],
        }
    )
    streams = [made.generator("e", copy, 0) for copy in range(2000)]
    names = [made.steps[0].draw(rng.random(), rng) for rng in streams]
    taken = [option.name for option in names if option]
    assert 0.45 < len(taken) / 2000 < 0.55
    assert 0.7 < taken.count("light_color") / len(taken) < 0.8


@given(st.lists(st.sampled_from(["a/e0", "a/e1", "b/e0"]), unique=True), st.integers(1, 3))
def test_selection_keeps_order_and_limit(keys: list[str], limit: int) -> None:
    for patterns in (["a/*"], "a/*"):
        taken = recipe.Select(episodes=patterns, limit=limit)(keys)  # type: ignore[arg-type]
        assert taken == [key for key in keys if key.startswith("a/")][:limit]


@pytest.mark.parametrize("name", ["object_mass", "object_friction"])
def test_factors_that_change_no_pixel_are_refused_with_the_reason(name: str) -> None:
    with pytest.raises(BadRecipe, match=f"{name}.*no recorded pixel"):
        recipe.build({"version": 1, "edits": [{"op": name}]})


def test_models_of_recipe_option_and_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The option is preferred to the recipe, the recipe to the user's file; all of it stands in the source."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (tmp_path / "rpaug").mkdir()
    (tmp_path / "rpaug" / "models.toml").write_text('text = "of/file"\ndepth = "of/file"\n')
    tree = {"version": 1, "models": {"depth": "of/recipe"}, "edits": [{"op": "light_color"}]}
    made = inputs.recipe(tree, models=["instances=of/option", "inpaint=telea"])
    assert made.models.text == "of/file"
    assert made.models.depth == "of/recipe"
    assert made.models.instances == "of/option"
    assert made.source["models"] == made.models.model_dump(exclude_defaults=True)
    assert inputs.recipe(tree, models=["off"]).source == tree
    for wrong in ("text", "words=x", "text="):
        with pytest.raises(RpaugError, match="expected USE=NAME"):
            inputs.recipe(tree, models=[wrong])
    (tmp_path / "rpaug" / "models.toml").write_text('txt = "of/file"\n')
    with pytest.raises(RpaugError, match=r"models.toml: expected names under text"):
        inputs.recipe(tree)
    with pytest.raises(BadRecipe, match=r"models\.dept"):
        inputs.recipe({**tree, "models": {"dept": "x"}}, models=["off"])


def test_a_recipes_painter_is_that_of_edits_that_name_none() -> None:
    edits = [
        {"op": "remove", "target": {"role": "receiver"}},
        {"one_of": [{"op": "remove", "target": {"handle": 1}, "inpaint": "fsr"}]},
    ]
    made = recipe.build({"version": 1, "models": {"inpaint": "telea"}, "edits": edits})
    assert [step.options[0].operator.inpaint for step in made.steps] == ["telea", "fsr"]
    assert made.source["edits"] == edits


def test_a_color_behind_a_hash_is_one_on_the_command_line_and_wants_quotes_in_a_file(
    tmp_path: Path,
) -> None:
    text = "version: 1\nedits:\n  - {op: recolor, target: {role: table}, color: red}\n"
    (step,) = load(tmp_path, text, "edits.0.color=#ff0000").steps
    assert step.options[0].fields["color"] == "#ff0000"
    assert "wants quotes" in refusal(tmp_path, text.replace("red", "#ff0000"))


def test_steps_together_are_in_the_same_copies_and_take_the_same_option() -> None:
    noise = [{"op": "sensor_noise", "read": [one, one]} for one in (0.01, 0.02, 0.03)]
    blur = [{"op": "sensor_blur", "sigma": [one, one]} for one in (1, 2, 3)]
    tree = {
        "version": 1,
        "edits": [
            {"one_of": noise, "probability": 0.5, "together": "lens"},
            {"one_of": blur, "probability": 0.5, "together": "lens"},
            {"op": "sensor_jpeg", "probability": 0.25, "together": "lens"},
            {"op": "sensor_exposure", "probability": 0.5},
        ],
    }
    made, still = recipe.build(tree), open_still()
    taken = []
    for copy in range(300):
        drawn = copies.draw(still, made, copy)[1]
        first, second, third, alone = (one.option for one in drawn)
        assert (first is None) == (second is None)
        if first and second:
            assert noise.index({"op": "sensor_noise", **first.fields}) == blur.index(
                {"op": "sensor_blur", **second.fields}
            )
        else:
            assert third is None
        taken.append((first is not None, third is not None, alone is not None))
    shares = np.array(taken).mean(0)
    assert np.abs(shares - [0.5, 0.25, 0.5]).max() < 0.1
    assert 0.3 < np.mean([one != other for one, _, other in taken]) < 0.7  # alone is alone
    with pytest.raises(BadRecipe, match="together"):
        recipe.build({**tree, "edits": [{"op": "sensor_jpeg", "together": 3}]})


def open_still() -> Scene:
    """The sample's episode; sensor edits ask nothing of it."""
    return build(registry.read(registry.SAMPLE, None), with_bodies=False)
