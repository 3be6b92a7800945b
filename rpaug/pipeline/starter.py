"""A first recipe for a dataset: each edit that its first episode has something for, the others as comments with why."""

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rpaug.core.errors import RpaugError
from rpaug.core.types import Episode, Scene
from rpaug.core.visible import quoted
from rpaug.pipeline import copies, inputs, prepare
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline.plan import Plan
from rpaug.pipeline.recipe import Recipe
from rpaug.pipeline.recipe_yaml import parse
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
        "lamps of other tints, dimmer and brighter, never near darkness",
        "{op: light_color, range: [[0.36, 0.36, 0.33], [0.5, 0.5, 0.5]], probability: 0.5}",
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
WIDTH = 118  # columns of a comment


def text(
    episode: Episode,
    described: Mapping[str, Any],
    episodes: int = 1,
    progress: Callable[[int], None] = lambda tried: None,
) -> str:
    """The recipe as YAML with comments. `described` is what `inspect` says of the episode, one of so many; `progress`
    is called with the number of edits that were tried.

    Raises RpaugError where nothing at all can be edited, with the reasons.
    """
    lines, usable, reasons = list[str](), 0, list[str]()
    lasting = inputs.handles_hold(episode, episodes)
    for tried, (words, entry) in enumerate(CANDIDATES):
        progress(tried)
        reason = _lacking(episode, entry)
        if reason is not None and (fewer := _fewer_cameras(episode, entry, reason)):
            lines += _comment(f"other cameras stay: {reason}", "  # ")
            entry, reason = fewer, None
        if reason is None:
            usable += 1
            lines += [f"  # {words}", f"  - {entry}"]
        else:
            reasons.append(reason)
            lines += [*_comment(f"not here: {words}: {reason}", "  # "), f"  # - {entry}"]
        if entry == CANDIDATES[0][1] and reason is not None:
            lines += _by_instance(episode, described, lasting)
    if not usable:
        raise RpaugError(f"{episode.key}: no edit can be made: {'; '.join(dict.fromkeys(reasons))}")
    if usable <= FEW:  # else many copies would be the recording
        lines = [line.replace("probability: 0.5", "probability: 0.9") for line in lines]
    head = [line for one in _facts(episode, described, lasting) for line in _comment(one, "# ")]
    made = "\n".join(
        [
            *head,
            "version: 1",
            "seed: 0      # the same seed gives the same bytes",
            "copies: 4    # of each episode",
            "edits:",
            *lines,
            "gates: {tries: 4}  # a copy that breaks a limit is drawn again, up to 4 times in all",
            "",
        ]
    )
    recipes.build(parse(made.encode(), "recipe")[0])  # what is written is valid
    return made


def _by_instance(episode: Episode, described: Mapping[str, Any], lasting: bool) -> list[str]:
    """A recolor of one instance without a role, as a comment: a person has to say whether that is a thing. By its
    handle where that holds in all episodes, else by a color that nothing else has."""
    instances = described.get("instances", ())
    colors = Counter(one["color_name"] for one in instances)
    free = [one for one in instances if not one["role"]]
    if not lasting:
        free = [
            one
            for one in free
            if colors[one["color_name"]] == 1 and one["color_name"] not in SHADES
        ]
    scene = None
    for one in sorted(free, key=lambda one: -sum(one["pixels"].values())):
        target = f"{{handle: {one['handle']}}}" if lasting else f"the {one['color_name']} thing"
        entry = f"{{op: recolor, target: {target}, color: {{sample: colosseum}}, probability: 0.5}}"
        recipe = _always(entry)
        try:
            scene = scene or prepare.prepare_scene(episode, recipe, 0)[0]
            prepare.ground(scene, recipe)
        except RpaugError:
            continue
        words = f"if instance {one['handle']} ({one['color_name']}) is a thing, as `rpaug inspect --html` shows it:"
        return [*_comment(f"{words} another color", "  # "), f"  # - {entry}"]
    return []


def _facts(episode: Episode, described: Mapping[str, Any], lasting: bool) -> list[str]:
    """What was found, in sentences."""
    found = {role: one for role, one in described.get("roles", {}).items() if one["handles"]}
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
        + ("`{handle: N}` or " if lasting else "")
        + '`{text: "the red cup"}` names one.',
        "See it: rpaug preview DATASET --recipe THIS. Make it: rpaug augment DATASET --recipe THIS --out OUT.",
    ]


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
