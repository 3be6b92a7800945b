"""Whether a thing may go elsewhere: if the robot acts on it, the recorded actions would no longer be true."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from rpaug.core.errors import Unsupported
from rpaug.core.memo import once
from rpaug.core.types import Episode, Scene
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets.targets import Target, find
from rpaug.scene.tracking.touch import touching

FEW = 2  # looked-at frames: a contact seen less often is chance
ACTED_ON = ("robot", "manipulated")
CARRYING = ("table", "background")


def find_untouched(scene: Scene, target: Target, doing: str) -> frozenset[int]:
    """Handles of the target, all of which the robot leaves alone. Raises TargetError, Unsupported with the reason."""
    handles = find(scene, target)
    check(scene, handles, target, doing)
    return handles


def check(scene: Scene, handles: frozenset[int], target: object, doing: str) -> None:
    """Raises Unsupported, with the reason, if the robot acts on one of the handles or others stand on it."""
    check_seen(scene, target, doing)
    for role in ACTED_ON:
        if held := handles & scene.roles.get(role, frozenset()):
            what = "is part of the robot" if role == "robot" else "is moved by the robot"
            raise Unsupported(
                f"{doing} {target}: {_names(held)} {what}; the recorded actions would be untrue"
            )
    for role in CARRYING:
        if held := handles & scene.roles.get(role, frozenset()):
            raise Unsupported(
                f"{doing} {target}: {_names(held)} is the {role}, which carries the rest"
            )
    acted = frozenset().union(*(scene.roles.get(role, frozenset()) for role in ACTED_ON))
    if held := _touched(scene, handles, acted):
        raise Unsupported(
            f"{doing} {target}: {_names(held)} is touched by the robot or by what it moves; the recorded actions "
            "would be untrue"
        )


def check_seen(scene: Scene, target: object, doing: str) -> None:
    """Raises Unsupported unless every camera has depth and masks, over more than one frame."""
    whole = all(view.depth and view.ids for view in scene.episode.views.values())
    if not whole or scene.episode.length < 2:
        raise Unsupported(f"{doing} {target}: needs recorded depth, masks and more than one frame")


def _touched(scene: Scene, handles: frozenset[int], acted: frozenset[int]) -> frozenset[int]:
    """Those of the handles that were seen to touch what acts."""
    seen = _contacts(scene.episode)
    return frozenset(
        handle
        for handle in handles
        if sum(seen.get(frozenset({handle, other}), 0) for other in acted) > FEW
    )


@once
def _contacts(episode: Episode) -> Mapping[frozenset[int], int]:
    """In how many looked-at frames each pair of things touches."""
    return touching(look(episode))


def _names(handles: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(handles)))


def without(scene: Scene, handles: Iterable[int]) -> Scene:
    """The scene with those instances gone; what else is rigid to them stays."""
    gone = frozenset(handles)
    left = tuple(
        replace(body, handles=body.handles - gone) if body.handles & gone else body
        for body in scene.bodies
        if not body.handles <= gone
    )
    return replace(scene, bodies=left, recorded_bodies=scene.tracked)
