"""A first recipe for a dataset: each edit that its first episode has something for, the others as comments with why."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpaug.core.errors import RpaugError
from rpaug.core.sampling import spans
from rpaug.core.types import Episode, Scene
from rpaug.core.visible import quoted
from rpaug.pipeline import copies, inputs, prepare
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline.plan import Plan
from rpaug.pipeline.recipe import Recipe
from rpaug.pipeline.recipe_yaml import parse
from rpaug.scene.targets.agreement import APART
from rpaug.scene.targets.targets import BY_WORDS

CANDIDATES = (
    (
        "what the robot handles: another color",
        "{op: recolor, target: {role: manipulated}, color: {sample: colosseum}, probability: 0.5}",
    ),
    (
        "where it is put, or what stays behind: another surface",
        "{op: retexture, target: {role: receiver}, probability: 0.3}",
    ),
    ("another tabletop", "{op: table_texture, probability: 0.5}"),
    ("other walls and floor", "{op: background_texture, probability: 0.5}"),
    (
        "two things more on the table, where the robot does not pass",
        "{op: distractors, count: 2, probability: 0.5}",
    ),
    (
        "warmer and cooler, dimmer and brighter lamps, whites not cut off",
        "{op: light_color, temperature: [3800, 8000], brightness: [0.7, 1.2], probability: 0.5}",
    ),
    (
        "cameras bumped by up to 3 cm and 1.7 degrees",
        "{op: camera_pose, camera: static, shift: 0.03, turn: 0.03, probability: 0.5}",
    ),
)
TRIED, LOOKED_AT = 4, 5  # draws that gates judge, and frames of each
FEW = 3  # edits
STATIC, REJECTED = "camera: static", "the gates, which check copies, would reject"
SHADES = frozenset({"black", "gray", "silver", "white"})  # of them walls and shadows are too
TABLE = "op: table_texture"
ROUGH = "left to you, since rough in videos: shade, glass and what moves over the table may stay or be painted"
WIDTH = 118  # columns of a comment
SEE = "See it: rpaug preview DATASET --recipe THIS. Make it: rpaug augment DATASET --recipe THIS --out OUT."


COPIES = 4  # of each episode
OFTEN = 0.5  # of the copies in which an edit is
OFTENER = 0.9  # where few edits can be made, or many copies would be the recording
PROBABILITY = re.compile(r"probability: [0-9.]+")


@dataclass(frozen=True)
class Offer:
    """An edit in words and as YAML, and the `reason` why the episode has nothing for it, None if it has.

    `notes` are said before it; `others` are comments after it: the same edit of things that a person has to point out.
    """

    words: str
    entry: str
    reason: str | None
    notes: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class Tried:
    """An episode, one of so many `episodes` of a dataset, what `inspect` says of it, and what can be offered."""

    episode: Episode
    described: Mapping[str, Any]
    episodes: int
    offers: tuple[Offer, ...] = ()

    @property
    def lasting(self) -> bool:
        """Whether a handle means the same thing in all episodes."""
        return inputs.handles_hold(self.episode, self.episodes)


def tried(
    episode: Episode,
    described: Mapping[str, Any],
    episodes: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> Tried:
    """All candidates, tried on the episode; `progress` is called with how many were.

    Raises RpaugError where nothing at all can be edited, with the reasons.
    """
    found = list[Offer]()
    for done, (words, entry) in enumerate(CANDIDATES):
        progress(done)
        one = offer(episode, words, entry)
        if one.reason is not None and not found:
            one = replace(one, others=tuple(_by_instance(Tried(episode, described, episodes))))
        found.append(one)
    reasons = [one.reason for one in found if one.reason is not None]
    if len(reasons) == len(found):
        raise RpaugError(f"{episode.key}: no edit can be made: {'; '.join(dict.fromkeys(reasons))}")
    return Tried(episode, described, episodes, tuple(found))


def offer(episode: Episode, words: str, entry: str) -> Offer:
    """An edit, tried; of fewer cameras where gates reject most draws of all at once."""
    reason = _lacking(episode, entry)
    if reason is not None and (fewer := _fewer_cameras(episode, entry, reason)):
        return Offer(words, fewer, None, (f"other cameras stay: {reason}",))
    return Offer(words, entry, reason)


def often(one: Offer, share: float) -> Offer:
    """The offer in that share of the copies; with 0 it becomes a comment."""
    if share == 0:
        return replace(one, reason="not wanted")
    return replace(one, entry=PROBABILITY.sub(f"probability: {share:g}", one.entry))


def text(of: Tried, offers: Sequence[Offer], copies: int | None = None, asked: bool = False) -> str:
    """The recipe as YAML with comments, of these offers; where nobody was `asked` few edits are made more often. Of a
    video whose camera was worked out it makes one copy, which takes minutes, unless `copies` says how many."""
    lines = list[str]()
    copies = copies or (1 if "film" in of.described else COPIES)
    for one in offers:
        film = "film" in of.described and TABLE in one.entry and not asked
        others = any(other.reason is None for other in offers if other is not one)
        rough = (ROUGH,) if film and others else ()
        lines += [line for note in (*one.notes, *rough) for line in _comment(note, "  # ")]
        if one.reason is None:
            lines += [f"  # {one.words}", f"  {'# ' if rough else ''}- {one.entry}"]
        else:
            told = f"not here: {one.words}: {one.reason}"
            lines += [*_comment(told, "  # "), f"  # - {one.entry}"]
        lines += one.others
    if not asked and sum(line.startswith("  - ") for line in lines) <= FEW:
        lines = [line.replace(f"probability: {OFTEN}", f"probability: {OFTENER}") for line in lines]
    head = [*facts(of), SEE]
    made = "\n".join(
        [
            *(line for one in head for line in _comment(one, "# ")),
            "version: 1",
            "seed: 0      # the same seed gives the same bytes",
            f"copies: {copies}    # of each episode",
            "edits:",
            *lines,
            "gates: {tries: 4}  # a copy that breaks a limit is drawn again, up to 4 times in all",
            "",
        ]
    )
    recipes.build(parse(made.encode(), "recipe")[0])  # what is written is valid
    return made


def pointed_out(of: Tried) -> Iterator[tuple[str, str]]:
    """Instances without a role that a person may mean, largest first: in words, and as a recipe's target. What may be
    robot, table or background is no thing, and what comes and goes in a video is not painted.

    By their handle where that holds in all episodes, else by a color that nothing else has.
    """
    instances = of.described.get("instances", ())
    known = of.described.get("roles", {})
    around = {h for role in APART if role in known for h in known[role]["handles"]}
    colors = Counter(one["color_name"] for one in instances)
    for one in sorted(instances, key=lambda one: -sum(one["pixels"].values())):
        alone = colors[one["color_name"]] == 1 and one["color_name"] not in SHADES
        steady = one.get("steady", True)
        if steady and not (one["role"] or one["handle"] in around) and (of.lasting or alone):
            handle, color = one["handle"], one["color_name"]
            target = f"{{handle: {handle}}}" if of.lasting else f"the {color} thing"
            yield f"instance {handle} ({color})", target


def recolored(target: str) -> str:
    """The edit that gives a target other colors."""
    return f"{{op: recolor, target: {target}, color: {{sample: colosseum}}, probability: {OFTEN}}}"


def _by_instance(of: Tried) -> list[str]:
    """A recolor of one instance without a role, as a comment: a person has to say whether that is a thing."""
    scene = None
    for named, target in pointed_out(of):
        recipe = _always(recolored(target))
        try:
            scene = scene or prepare.prepare_scene(of.episode, recipe, 0)[0]
            prepare.ground(scene, recipe)
        except RpaugError:
            continue
        words = f"if {named} is a thing, as `rpaug inspect --html` shows it: another color"
        return [*_comment(words, "  # "), f"  # - {recolored(target)}"]
    return []


def facts(of: Tried) -> list[str]:
    """What was found, in sentences."""
    episode, film = of.episode, of.described.get("film", {})
    found = {role: one for role, one in of.described.get("roles", {}).items() if one["handles"]}
    roles = [
        f"{role}: {', '.join(map(str, one['handles']))}"
        for role, one in found.items()
        if one["believed"]
    ]
    doubted = [role for role, one in found.items() if not one["believed"]]
    doubts = f" Not sure enough to be edited: {', '.join(doubted)}." if doubted else ""
    return [
        f"A first recipe for {episode.key}: {quoted(episode.instruction)}, {episode.length} frames, "
        f"camera{'s' if len(episode.views) > 1 else ''} {', '.join(episode.views)}.",
        f"Instances by role: {'; '.join(roles) or 'none were found'}.{doubts} `rpaug inspect` shows what they are, "
        + ("`{handle: N}` or " if of.lasting else "")
        + '`{text: "the red cup"}` names one.',
        *_of_a_video(film),
    ]


def _of_a_video(film: Mapping[str, Any]) -> Iterator[str]:
    """What is to be known before minutes are spent: frames that edits leave out, and tables apart."""
    if lost := film.get("passed_through"):
        yield (
            f"Frames {spans(lost)} have no camera pose: all but light_color and sensor edits vanish there, even in full"
            " view."
        )
    if len(parts := film.get("pieces", ())) > 1:
        told = "; ".join(f"{first} to {last}" for first, last in parts)
        yield (
            f"The video is in pieces (frames {told}) that are not set beside each other: what is put into one does not"
            " show in the others; `near: {handle: N}` puts it beside something of a piece."
        )


def _lacking(episode: Episode, entry: str) -> str | None:
    """Why the episode has nothing for an edit, or why gates would reject most of its draws; None if it has."""
    recipe = _always(entry)
    try:
        scene, plan = prepare.prepare_scene(episode, recipe, 0)
        prepare.ground(scene, recipe)
    except RpaugError as error:
        name = recipe.steps[0].options[0].name
        told = str(error).removeprefix(f"{episode.key}: ").removeprefix(f"{name}: ")
        return told.partition("; there is: ")[0].partition(f"; {BY_WORDS}")[0]
    if recipe.gates is None:
        return None
    found = [_faults(scene, plan, recipe, copy) for copy in range(1, TRIED + 1)]
    failed = [one[0] for one in found if one]
    if len(failed) <= TRIED // 2:
        return None
    return f"{REJECTED} {len(failed)} of {TRIED} trial copies: {failed[0]}"


def _always(entry: str) -> Recipe:
    """A recipe of one edit, in every copy."""
    tree, _ = parse(f"version: 1\nedits:\n  - {entry}\n".encode(), "recipe")
    return recipes.build({**tree, "edits": [{**tree["edits"][0], "probability": 1}]})


def _fewer_cameras(episode: Episode, entry: str, reason: str) -> str | None:
    """The edit of those fixed cameras alone whose draws gates keep, where they reject most of all cameras at once."""
    if STATIC not in entry or not reason.startswith(REJECTED):
        return None
    fixed = [name for name, view in episode.views.items() if view.camera.fixed]
    kept = [name for name in fixed if _lacking(episode, _of_cameras(entry, [name])) is None]
    for some in (kept, kept[:1]):  # each by itself may pass where all at once do not
        if some and _lacking(episode, fewer := _of_cameras(entry, some)) is None:
            return fewer
    return None


def _of_cameras(entry: str, names: list[str]) -> str:
    """The edit of these cameras alone."""
    return entry.replace(STATIC, f"camera: {json.dumps(names)}")


def _faults(scene: Scene, plan: Plan, recipe: Recipe, copy: int) -> list[str]:
    """What the gates find in a few frames of a draw."""
    assert recipe.gates is not None
    edited, draws = copies.draw(scene, recipe, copy)
    made = replace(copies.render(edited, draws, plan), gates=recipe.gates)
    for name, view in made.episode.views.items():
        if view.camera is not scene.episode.views[name].camera:
            for t in (
                np.linspace(0, made.episode.length - 1, LOOKED_AT).round().astype(int).tolist()
            ):
                view.rgb(t)
    return recipe.gates.faults(made.figures)


def _comment(words: str, mark: str) -> list[str]:
    """The words in lines of a comment."""
    lines, line = list[str](), mark
    for word in " ".join(words.split()).split(" "):
        if len(line) + len(word) > WIDTH and line != mark:
            lines.append(line.rstrip())
            line = mark
        line += f"{word} "
    return [*lines, line.rstrip()]
