"""What the edits of a copy made of the recorded things, as far as an instruction may speak of it."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rpaug.core.interfaces import Added, Edit, Operator, Painted
from rpaug.core.types import Body, Scene


@dataclass(frozen=True)
class Changes:
    """By recorded instance id: the word for the color or pattern of what was painted, None where there is none; the
    factor by which it was resized; what was moved, copied, taken out. `added` are the new things."""

    words: Mapping[int, str | None] = field(default_factory=dict)
    scales: Mapping[int, float] = field(default_factory=dict)
    moved: frozenset[int] = frozenset()
    copied: frozenset[int] = frozenset()
    removed: frozenset[int] = frozenset()
    added: tuple[Added, ...] = ()

    def __bool__(self) -> bool:
        return any(vars(self).values())


def of(scene: Scene, edits: Sequence[tuple[Operator, Edit]]) -> Changes:
    """What an edited scene changed: what its bodies show, and what the operators say of their edits."""
    recorded = {instance_id: body for body in _seen(scene) for instance_id in body.instance_ids}
    left = [
        body for body in scene.bodies if not body.copy_of and body.instance_ids <= recorded.keys()
    ]
    now = {instance_id: body for body in left for instance_id in body.instance_ids}
    scales = {h: now[h].scale / recorded[h].scale for h in now if now[h].scale != recorded[h].scale}
    given = [change for operator, edit in edits for change in operator.says(edit)]
    painted = [change for change in given if isinstance(change, Painted)]
    return Changes(
        words=_words(scene, frozenset(recorded), painted),
        scales=scales,
        moved=frozenset(h for h in now if h not in scales and _elsewhere(now[h], recorded[h])),
        copied=frozenset(old for body in scene.bodies for old in body.copy_of),
        removed=frozenset(recorded) - frozenset(now),
        added=tuple(change for change in given if isinstance(change, Added)),
    )


def recorded(scene: Scene) -> Scene:
    """The scene as it was before any edit."""
    return replace(scene, bodies=_seen(scene), recorded_bodies=None, appearance=(), sensor=())


def _seen(scene: Scene) -> tuple[Body, ...]:
    """The recorded bodies, without what was put in."""
    return tuple(body for body in scene.tracked if body.mesh is None)


def rearranged(scene: Scene) -> Scene:
    """What is left of the recorded things, as large as they are now and where they stand now, in their old colors."""
    known = frozenset().union(*(body.instance_ids for body in _seen(scene)))
    left = tuple(body for body in scene.bodies if not body.copy_of and body.instance_ids <= known)
    there = frozenset().union(*(body.instance_ids for body in left))
    roles = {
        name: instance_ids & there
        for name, instance_ids in scene.roles.items()
        if instance_ids & there
    }
    return replace(recorded(scene), bodies=left, recorded_bodies=_seen(scene), roles=roles)


def _words(
    scene: Scene, known: frozenset[int], painted: Sequence[Painted]
) -> dict[int, str | None]:
    """The last word for each painted instance; None if an appearance lies on it that no operator gave a word for."""
    words: dict[int, str | None] = {}
    layers: Counter[int] = Counter()
    for appearance in scene.appearance:
        layers.update((appearance.instance_ids or frozenset()) & known)  # light names nothing anew
    once = set[int]()  # painted anew, which is one appearance however often
    for change in painted:
        layers.subtract(change.instance_ids - once)
        once |= change.instance_ids if change.anew else frozenset()
        words |= dict.fromkeys(change.instance_ids & known, change.word)
    return words | {instance_id: None for instance_id, more in layers.items() if more > 0}


def _elsewhere(now: Body, before: Body) -> bool:
    return now is not before and not np.array_equal(now.to_world, before.to_world)
