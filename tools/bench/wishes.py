"""Wishes of people who had not read the docs: how many come to the recipe that was meant.

    python tools/bench/wishes.py WISHES --recordings FOLDER --answers FILE   a model's answers, replayed
    python tools/bench/wishes.py WISHES --recordings FOLDER --offline        without a model
    python tools/bench/wishes.py WISHES --recordings FOLDER --questions      what a model is asked, to be answered

WISHES holds a JSON value a line: `scene` (a folder of FOLDER), `after` (an earlier wish or null), `wish`, `expect` (in
its writer's words) and `want`, the same for a rule: a list of what is right, each "refuse" or a list of edits. Each is
a mapping: `op` (several with |), `on` (the instances that must be edited) and `may` (others that may), `color` (words)
and `each` (of these one word each must occur), `texture`, `near`, `cameras`, `p` (the share of copies, [1, 1] if left
out), `count`, `within` and `spans` (a field's numbers lie between two, or reach from one to the other), `is` (a field
is one of several values), `lamp` (directions that it may come from), `bright` and `warm` (times as recorded; red over
blue), `same` (one color for all) and `optional`. A mapping with `settings` alone says what of the recipe is set, and
with `notes` that something must be said of how the wish was taken. `want` null is for a person: the recipe is printed.

FILE holds {"n": the wish's line from 0, "a" after it for the wish before, "answer": what the model says} a line.
`--questions` prints the messages that come before every question, then {"n": ..., "question": ...} a line, for each
that `--answers` has no answer to: a wish with one before it takes two turns. What is judged by is not in them.
"""

import argparse
import hashlib
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/helpers"))

from endpoints import Handler, completion, served

from rpaug.core import color_space, registry
from rpaug.core.errors import RpaugError
from rpaug.core.types import Episode, Scene
from rpaug.language import asking, rounds
from rpaug.language.asking import AskResult
from rpaug.language.messages import NotUnderstood
from rpaug.language.rounds import History
from rpaug.language.talk import WishModel
from rpaug.pipeline import recipe as recipes
from rpaug.scene.build import build
from rpaug.scene.lighting import black_body
from rpaug.scene.targets import targets

ALWAYS = (1.0, 1.0)
REFUSED = {"refuse": "not answered yet", "drop": [], "edits": [], "settings": None, "notes": []}
NEAR = 1e-3
DRAWS = 60  # of a field that draws colors
TURNED = 0.6  # cosine: a lamp so near the direction that is wanted is there
SET = ("copies", "seed", "select", "keep_originals", "instructions", "gates")
LAID = {"retexture", "table_texture", "background_texture"}  # the same on the same target

Pattern = Mapping[str, Any]


@dataclass(frozen=True)
class Chosen:
    """One option of one entry of a recipe, with the share of copies that draw it."""

    step: int
    share: float
    name: str
    operator: Any
    ids: frozenset[int]
    near: frozenset[int]

    @property
    def colors(self) -> frozenset[str]:
        """The words for what it paints or looks for."""
        field = getattr(self.operator, "color", None)
        if field is None and self.name == "table_color":
            low, high = np.array(self.operator.range)
            rng = np.random.default_rng(0)
            return frozenset(color_space.nearest(rng.uniform(low, high)) for _ in range(DRAWS))
        if field is None or isinstance(field, str):
            return frozenset([field] if field else [])
        rng = np.random.default_rng(0)
        return frozenset(color_space.nearest(np.array(field.draw(rng))) for _ in range(DRAWS))

    @property
    def light(self) -> tuple[float, float, float] | None:
        """Least and most light against that recorded, and red over blue; None where it changes none."""
        if self.name == "sensor_exposure":
            low, high = self.operator.stops
            return 2.0**low, 2.0**high, 1.0
        if self.name == "light_color" and (self.operator.temperature or self.operator.brightness):
            low, high = self.operator.brightness or (1.0, 1.0)
            kelvin = self.operator.temperature or ()
            red, _, blue = np.mean([black_body.hue(one) for one in kelvin] or [np.ones(3)], 0)
            return low, high, float(red / max(blue, NEAR))
        if self.name == "light_color":
            low, high = np.array(self.operator.range)
            middle = (low + high) / 2
            return low.mean() * 2, high.mean() * 2, float(middle[0] / max(middle[2], NEAR))
        return None

    def numbers(self, path: str) -> list[float]:
        """All numbers of a field, or of one component: `turned.0`."""
        name, *inner = path.split(".")
        value = getattr(self.operator, name, None)
        for one in inner:
            value = value[int(one)] if isinstance(value, list | tuple) else None
        return [] if value is None else np.ravel(np.array(value, float)).tolist()


def chosen(scene: Scene, recipe: Mapping[str, Any]) -> Iterator[Chosen]:
    """Every option of a recipe."""
    for number, step in enumerate(recipes.build(dict(recipe)).steps):
        whole = sum(option.weight for option in step.options)
        for option in step.options:
            needs = option.operator.needs
            yield Chosen(
                number,
                step.probability * option.weight / whole,
                option.name,
                option.operator,
                _found(scene, option.operator, needs.targets),
                _found(scene, option.operator, needs.anchors),
            )


def _found(scene: Scene, operator: Any, fields: Sequence[str]) -> frozenset[int]:
    found: set[int] = set()
    for name in fields:
        value = getattr(operator, name, None)
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, targets.Target):
                found |= targets.find(scene, one)
    return frozenset(found)


def fits(one: Chosen, wanted: Pattern) -> bool:
    """Whether an option is one of those that a pattern means."""
    ops = set(wanted["op"].split("|"))
    if one.name not in ops and not (one.name in LAID and ops & LAID):
        return False
    if "on" in wanted and not one.ids <= {*wanted["on"], *wanted.get("may", [])}:
        return False
    if "color" in wanted and not one.colors <= set(wanted["color"].split("|")):
        return False
    if "color" in wanted and not one.colors:
        return False
    if "texture" in wanted and not _textures(one.operator) <= set(wanted["texture"].split("|")):
        return False
    if "near" in wanted and not (
        one.near & set(wanted["near"]) or getattr(one.operator, "near", None) in wanted["near"]
    ):
        return False
    if "cameras" in wanted:
        given = getattr(one.operator, "camera", None) or getattr(one.operator, "cameras", None)
        named = {given} if isinstance(given, str) else set(given or ())
        if named != set(wanted["cameras"]):
            return False
    if any(
        getattr(one.operator, name, None) not in values
        for name, values in wanted.get("is", {}).items()
    ):
        return False
    return _lit(one, wanted) and all(
        low - NEAR <= value <= high + NEAR
        for path, (low, high) in wanted.get("within", {}).items()
        for value in one.numbers(path) or [np.inf]
    )


def _textures(operator: Any) -> set[str]:
    given = getattr(operator, "texture", None)
    return {given if isinstance(given, str) else f"any {getattr(given, 'sample', '')}"}


def _lit(one: Chosen, wanted: Pattern) -> bool:
    if "lamp" in wanted:
        to = getattr(one.operator, "to", None)
        if to is None:
            return False
        there = np.array(to) / np.linalg.norm(to)
        if all(there @ one < TURNED * np.linalg.norm(one) for one in np.array(wanted["lamp"])):
            return False
    light = one.light
    if not {"bright", "warm"} & set(wanted):
        return True
    if light is None:
        return False
    low, high = wanted.get("bright", (0, np.inf))
    least, most = wanted.get("warm", (0, np.inf))
    return bool(low <= light[0] and light[1] <= high and least <= light[2] <= most)


def met(found: Sequence[Chosen], wanted: Pattern) -> bool:
    """Whether the options that fit a pattern come to all that it asks for."""
    if not found:
        return bool(wanted.get("optional"))
    if not set(wanted.get("on", ())) <= frozenset().union(*(one.ids for one in found)):
        return False
    shares: Counter[int] = Counter()
    for one in found:
        shares[one.step] += one.share  # type: ignore[assignment]
    low, high = wanted.get("p", ALWAYS)
    if not all(low - 0.01 <= share <= high + 0.01 for share in shares.values()):
        return False
    colors = frozenset().union(*(one.colors for one in found))
    if any(not colors & set(words.split("|")) for words in wanted.get("each", ())):
        return False
    if wanted.get("same") and len(colors) != 1:
        return False
    if "count" in wanted:
        steps = {one.step: getattr(one.operator, "count", 1) for one in found}
        low, high = wanted["count"]
        if not low <= sum(steps.values()) <= high:
            return False
    for path, (low, high) in wanted.get("spans", {}).items():
        values = [value for one in found for value in one.numbers(path)]
        if not values or abs(min(values) - low) + abs(max(values) - high) > 0.1 * (
            high - low
        ) + 0.02 * max(abs(high), NEAR):
            return False
    return True


def meant(result: AskResult, scene: Scene, want: Sequence[Pattern]) -> bool:
    """Whether a recipe does all that is wanted and nothing else."""
    recipe = result.recipe
    if any("notes" in one for one in want) and not result.notes:
        return False
    patterns = [one for one in want if "op" in one]
    settings = {k: v for one in want if "op" not in one for k, v in one["settings"].items()}
    if {
        key: recipe[key] for key in SET if recipe.get(key, _DEFAULT.get(key)) != _DEFAULT.get(key)
    } != settings:
        return False
    matched: list[list[Chosen]] = [[] for _ in patterns]
    for one in chosen(scene, recipe):
        number = next((i for i, pattern in enumerate(patterns) if fits(one, pattern)), None)
        if number is None:
            return False
        matched[number].append(one)
    return all(map(met, matched, patterns))


_DEFAULT = {"copies": 1, "seed": 0, "keep_originals": False}


def verdict(result: AskResult | None, scene: Scene, want: Any) -> str:
    """right, refused (though meant), wrong, or person."""
    if want is None:
        return "person"
    if result is None:
        return "right" if "refuse" in want else "refused"
    ways = [one for one in want if one != "refuse"]
    return "right" if any(meant(result, scene, one) for one in ways) else "wrong"


@cache
def recorded(path: Path) -> tuple[Episode, Scene]:
    """A recording's first episode, and its scene."""
    episode = registry.read(path, None)
    return episode, build(episode, with_bodies=True)


def said(
    row: Mapping[str, Any],
    folder: Path,
    answers: Sequence[Any] | None,
    asked: list[Any] | None = None,
) -> Any:
    """What comes of a wish, after the one before it if there is one. Raises RpaugError.

    `answers` are what a model says to each; None asks without a model. `asked` gets the messages of each question.
    """
    episode, scene = recorded(folder / row["scene"])
    history, result = History(), None
    wishes = [one for one in (row["after"], row["wish"]) if one is not None]
    for number, wish in enumerate(wishes):
        understanding: asking.Understanding = rounds.next_round
        with served(partial(_say, answers[number] if answers else None)) as (endpoint, seen):
            if answers:
                understanding = WishModel(endpoint)
            try:
                result = asking.ask(
                    wish,
                    asking.setting_of(episode),
                    lambda: scene,
                    history=history,
                    understanding=understanding,
                )
            finally:
                if asked is not None:
                    asked.append(seen[0][1]["messages"])
        history = result.history
    return result


def _say(answer: Any, handler: Handler, number: int) -> None:
    handler.answer(completion(json.dumps(answer)))


def question(row: Mapping[str, Any], folder: Path, answers: Sequence[Any]) -> list[Any]:
    """The messages that a model gets after it has said `answers` to the wishes before. Raises RpaugError."""
    asked: list[Any] = []
    with suppress(NotUnderstood):
        said(row, folder, [*answers, REFUSED], asked)
    return list(asked[len(answers)])


def sample(rows: Sequence[Mapping[str, Any]], size: int) -> list[int]:
    """The lines of so many wishes, chosen by the hash of their words."""
    keys = [hashlib.sha256(f"{row['scene']}{row['wish']}".encode()).hexdigest() for row in rows]
    return sorted(sorted(range(len(rows)), key=keys.__getitem__)[:size])


def main() -> None:
    """Print what is not right, and the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wishes", type=Path)
    parser.add_argument("--recordings", type=Path, required=True)
    parser.add_argument("--answers", type=Path, nargs="+", help="files; a later one's answers hold")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--offline", action="store_true")
    how.add_argument("--questions", action="store_true", help="print what a model is asked")
    parser.add_argument("--sample", type=int, help="so many of the wishes, by hash")
    parser.add_argument("--only", nargs="+", help="scenes, or numbers of wishes")
    parser.add_argument("--quiet", action="store_true", help="the figures alone")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.offline == bool(options.answers) and not options.questions:
        parser.error("one of --answers, --offline and --questions")
    rows = [json.loads(line) for line in options.wishes.read_text().splitlines()]
    answers: dict[str, Any] = {}
    for path in options.answers or ():
        lines = map(json.loads, path.read_text().splitlines())
        answers |= {str(one["n"]): one["answer"] for one in lines}
    count: Counter[str] = Counter()
    taken = sample(rows, options.sample or len(rows))
    before = None
    for n, row in sorted(enumerate(rows), key=lambda one: str(one[1]["scene"])):
        if n not in taken or (options.only and not {str(n), row["scene"]} & set(options.only)):
            continue
        keys = [f"{n}a"] * (row["after"] is not None) + [str(n)]
        if options.questions:
            known = [answers[key] for key in keys if key in answers]
            if len(known) < len(keys):
                try:
                    *shared, last = question(row, options.recordings, known)
                except RpaugError as error:  # the wish before it came to nothing
                    sys.stderr.write(f"{n}: {asking.reason(error)}\n")
                    continue
                if not before:
                    before = shared
                    sys.stdout.write(json.dumps({"messages": before}) + "\n")
                line = {"n": keys[len(known)], "question": json.loads(last["content"])}
                sys.stdout.write(json.dumps(line, ensure_ascii=False) + "\n")
            continue
        if options.answers and any(key not in answers for key in keys):
            count["not answered"] += 1
            continue
        given = [answers[key] for key in keys] if options.answers else None
        why, result = "", None
        try:
            result = said(row, options.recordings, given)
        except RpaugError as error:
            why = asking.reason(error)
        want = row["want"]
        told = verdict(result, recorded(options.recordings / row["scene"])[1], want)
        kind = "to be refused" if want == ["refuse"] else "feasible"
        count[f"{kind}: {told}"] += 1
        if told != "right" and not options.quiet:
            came = why or json.dumps([result.recipe["edits"], result.notes])
            sys.stdout.write(
                f"{n} {told}: {row['after'] or ''} / {row['wish']!r}\n   expect {row['expect']}\n"
                f"   want {json.dumps(want)}\n   {came}\n"
            )
            sys.stdout.flush()
    if not options.questions:
        sys.stdout.write(json.dumps(dict(sorted(count.items())), indent=1) + "\n")


if __name__ == "__main__":
    main()
