"""Whether a thing may go elsewhere: if the robot acts on it, the recorded actions would no longer be true."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from rpaug.core.errors import RpaugError, SourceLacks, Unsupported
from rpaug.core.memo import once
from rpaug.core.types import Episode, Scene
from rpaug.scene.placement import standing, zones
from rpaug.scene.placement.placing import find_free_space, points_of
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import agreement
from rpaug.scene.targets.targets import Target, find
from rpaug.scene.tracking.touch import touching

FEW = 2  # looked-at frames: a contact seen less often is chance
ACTED_ON = ("robot", "manipulated")
CARRYING = ("table", "background")
LARGEST = 0.4  # metres: what is wider is furniture
APART = 0.05  # metres from the receiver and wherever the target comes to be: what stands nearer may matter to it


def find_untouched(scene: Scene, target: Target, doing: str) -> frozenset[int]:
    """Handles of the target, all of which the robot leaves alone. Raises TargetError, Unsupported with the reason."""
    instance_ids = find(scene, target)
    check(scene, instance_ids, target, doing)
    return instance_ids


def pick(scene: Scene, target: Target | None, rng: np.random.Generator, doing: str) -> Target:
    """The target itself, or if there is none one of what is `loose`, drawn. Raises SourceLacks, Unsupported."""
    if target is not None:
        return target
    among = loose(scene, doing)
    return Target(handle=sorted(among[rng.integers(len(among))].instance_ids))


def loose(scene: Scene, doing: str) -> list[standing.StandingInstance]:
    """Small things that stand on the table apart from what the task is about, have no role and are left alone by the
    robot; at least one.

    Raises SourceLacks without depth and masks, Unsupported if there is nothing of that kind.
    """
    check_seen(scene, "what the robot leaves alone", doing)
    taken = frozenset().union(*scene.roles.values()) if scene.roles else frozenset()
    around = find_free_space(scene)
    if not zones.acted_on(scene):
        raise Unsupported(
            f"{doing}: what the task is about is not known, so anything may matter to it"
        )
    goal = points_of(scene, scene.roles.get("receiver", frozenset()))
    about = around.near(np.concatenate([zones.target_places(scene), goal]), APART)
    found = []
    for body in scene.bodies:
        if body.motion != "static" or body.copy_of or body.instance_ids & taken:
            continue
        try:
            check(scene, body.instance_ids, "", doing)
            one = standing.thing(scene, body.instance_ids, around, doing)
        except RpaugError:
            continue
        apart = not (around.covered(one.outline + one.middle) & about).any()
        if apart and np.ptp(one.outline, axis=0).max() < LARGEST:
            found.append(one)
    if not found:
        raise Unsupported(f"{doing}: nothing stands on the table that the robot leaves alone")
    return found


def check(scene: Scene, instance_ids: frozenset[int], target: object, doing: str) -> None:
    """Raises Unsupported, with the reason, if the robot acts on one of the instance ids or others stand on it."""
    check_seen(scene, target, doing)
    for role in ACTED_ON:
        if held := instance_ids & agreement.playing(scene, role):
            what = "is part of the robot" if role == "robot" else "is moved by the robot"
            raise Unsupported(
                f"{doing} {target}: {_names(held)} {what}; the recorded actions would be untrue"
            )
    for role in CARRYING:
        if held := instance_ids & agreement.playing(scene, role):
            sure = "is" if role in scene.roles else "may be"
            raise Unsupported(
                f"{doing} {target}: {_names(held)} {sure} the {role}, which carries the rest"
            )
    acted = frozenset().union(*(agreement.playing(scene, role) for role in ACTED_ON))
    if held := _touched(scene, instance_ids, acted):
        raise Unsupported(
            f"{doing} {target}: {_names(held)} is touched by the robot or by what it moves; the recorded actions "
            "would be untrue"
        )


def check_seen(scene: Scene, target: object, doing: str) -> None:
    """Raises SourceLacks unless every camera has depth and masks, Unsupported unless there is more than one frame."""
    if not all(view.depth and view.ids for view in scene.episode.views.values()):
        raise SourceLacks(f"{doing} {target}: needs recorded depth and masks")
    if scene.episode.length < 2:
        raise Unsupported(f"{doing} {target}: needs more than one frame")


def _touched(scene: Scene, instance_ids: frozenset[int], acted: frozenset[int]) -> frozenset[int]:
    """Those of the instance ids that were seen to touch what acts."""
    seen = _contacts(scene.episode)
    return frozenset(
        instance_id
        for instance_id in instance_ids
        if sum(seen.get(frozenset({instance_id, other}), 0) for other in acted) > FEW
    )


@once
def _contacts(episode: Episode) -> Mapping[frozenset[int], int]:
    """In how many looked-at frames each pair of things touches."""
    return touching(look(episode))


def _names(instance_ids: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(instance_ids)))


def without(scene: Scene, instance_ids: Iterable[int]) -> Scene:
    """The scene with those instances gone; what else is rigid to them stays."""
    gone = frozenset(instance_ids)
    left = tuple(
        replace(body, instance_ids=body.instance_ids - gone) if body.instance_ids & gone else body
        for body in scene.bodies
        if not body.instance_ids <= gone
    )
    return replace(scene, bodies=left, recorded_bodies=scene.tracked)
