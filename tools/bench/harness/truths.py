"""What truly comes of edits that are no one factor of the twin: things put elsewhere or doubled, and other shadows."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8

from rpaug import twin
from rpaug.core.errors import Unsupported
from rpaug.core.interfaces import Edit, Operator
from rpaug.core.types import CameraView
from rpaug.operators.duplicate import Duplicate
from rpaug.operators.move import Move
from rpaug.operators.spread import Spread
from rpaug.scene import build
from rpaug.scene.targets.targets import Target
from rpaug.twin.look import Look

CYLINDER = "cylinder"  # no task acts on it
FAINTER = 0.4  # times the light that shadows took: the least that `shadows` draws by default
TURNED = 0.4  # radians about the vertical


def again(recorded: twin.Take, look: Look, changed: Sequence[int] = ()) -> twin.Take:
    """The same motion under another look, with these instance ids truly changed."""
    size = next(iter(recorded.episode.views.values())).camera.width
    facts = recorded.truth
    true = twin.perform(
        facts.task, facts.seed, look=look, size=size, frames=recorded.episode.length
    )
    return replace(true, truth=replace(true.truth, old=facts.new, changed=tuple(changed)))


def drawn(operator: Operator, take: twin.Take) -> Edit:
    """What an operator draws in a recording, by its seed. Raises RpaugError where it refuses."""
    scene = build.build(take.episode, with_bodies=True)
    return operator.sample(scene, np.random.default_rng(take.truth.seed))


def moving(take: twin.Take) -> Move:
    """The cylinder elsewhere, unturned."""
    return Move(target=Target(handle=take.truth.handles[CYLINDER]), turn=0.0)


def doubling(take: twin.Take) -> Duplicate:
    """The cylinder once more, unturned."""
    return Duplicate(target=Target(handle=take.truth.handles[CYLINDER]), turn=0.0)


SPREADING = Spread(turn=0.0)


def shift(take: twin.Take, motion: Any, part: str = CYLINDER) -> tuple[float, float, float]:
    """The motion of a thing, without a turn, in the frame of its body."""
    handle = take.truth.handles[part]
    (body,) = (name for name, parts in take.truth.bodies.items() if handle in parts)
    x, y, z = take.poses[body][0, :3, :3].T @ np.array(motion)[:3, 3]
    return float(x), float(y), float(z)


def spread(recorded: twin.Take) -> twin.Take:
    """All things where `spread` puts them."""
    names = {handle: name for name, handle in recorded.truth.handles.items()}
    moves = drawn(SPREADING, recorded)["moves"]
    shifts = {
        names[handle]: shift(recorded, move["motion"], names[handle])
        for move in moves
        for handle in move["handles"]
    }
    handles = [handle for move in moves for handle in move["handles"]]
    return again(recorded, replace(recorded.truth.new, shifts=shifts), handles)


def duplicated(recorded: twin.Take) -> twin.Take:
    """The cylinder where it stands and where `duplicate` puts it."""
    (copy,) = drawn(doubling(recorded), recorded)["copies"]
    ((old, new),) = copy["handles"].items()
    shifts = {CYLINDER: shift(recorded, copy["motion"])}
    moved = again(recorded, replace(recorded.truth.new, shifts=shifts))
    return doubled(recorded, moved, int(old), new)


def doubled(recorded: twin.Take, moved: twin.Take, handle: int, new: int) -> twin.Take:
    """Both recordings, whatever is nearer of the thing; where it was put it has the instance id `new`.

    Raises Unsupported under lamps that cast shadows: the copy's own would be missing.
    """
    if recorded.truth.new.shadows:
        raise Unsupported("two recordings laid over each other lack the copy's shadow")

    def both(one: CameraView, other: CameraView) -> CameraView:
        assert one.depth is not None
        assert one.ids is not None
        assert other.ids is not None
        assert other.depth is not None

        def nearer(t: int) -> Bool[np.ndarray, "h w"]:
            mine = other.ids(t) == handle  # type: ignore[misc]
            return mine & (other.depth(t) < one.depth(t))  # type: ignore[misc]

        return replace(
            one,
            rgb=lambda t: np.where(nearer(t)[..., None], other.rgb(t), one.rgb(t)),
            depth=lambda t: np.where(nearer(t), other.depth(t), one.depth(t)),  # type: ignore[misc]
            ids=lambda t: np.where(nearer(t), new, one.ids(t)).astype(np.int32),  # type: ignore[misc]
        )

    views = {
        name: both(view, moved.episode.views[name]) for name, view in recorded.episode.views.items()
    }
    truth = replace(moved.truth, changed=(new,))
    return replace(recorded, episode=replace(recorded.episode, views=views), truth=truth)


def fainter(recorded: twin.Take) -> twin.Take:
    """Shadows that take `FAINTER` times the light: lamps' light adds up, so it lies between none and all of them."""
    without = again(recorded, replace(recorded.truth.new, shadows=False))

    def between(name: str, t: int) -> UInt8[np.ndarray, "h w 3"]:
        cast, none = (one.episode.views[name].rgb(t) for one in (recorded, without))
        return np.rint(FAINTER * cast + (1 - FAINTER) * none).astype(np.uint8)

    views = {
        name: replace(view, rgb=partial(between, name))
        for name, view in without.episode.views.items()
    }
    return replace(without, episode=replace(without.episode, views=views))


def turned(recorded: twin.Take) -> twin.Take:
    """All lamps turned about the vertical."""
    look = recorded.truth.new
    lamps = tuple(replace(lamp, heading=lamp.heading + TURNED) for lamp in look.lamps)
    return again(recorded, replace(look, lamps=lamps))
