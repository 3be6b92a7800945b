"""What the edits of a copy made of the recorded things, as far as an instruction may speak of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rpaug.assets import library
from rpaug.assets.textures import shipped
from rpaug.assets.textures.mapping import Texture
from rpaug.core import colors as colours
from rpaug.core.types import Body, Scene

COARSE = 32  # texels a side at which a texture's colours are counted
MOSTLY = 0.9  # of them in one colour, and people call it by that


@dataclass(frozen=True)
class Added:
    """A thing that was put in: its kind, what it is called, and its colour word."""

    kind: str
    name: str
    colour: str


@dataclass(frozen=True)
class Changes:
    """By recorded handle: a colour name for what was painted, for a new pattern the word for that, or None if there is
    no word; the factor by which it was resized; what was moved, copied, taken out. `added` are the new things."""

    sampled: Mapping[int, str | None] = field(default_factory=dict)
    scales: Mapping[int, float] = field(default_factory=dict)
    moved: frozenset[int] = frozenset()
    copied: frozenset[int] = frozenset()
    removed: frozenset[int] = frozenset()
    added: tuple[Added, ...] = ()

    def __bool__(self) -> bool:
        return any(vars(self).values())


def of(scene: Scene, draws: Sequence[Mapping[str, Any]]) -> Changes:
    """What an edited scene changed; `draws` are the edits as a report describes them."""
    recorded = {instance_id: body for body in _seen(scene) for instance_id in body.instance_ids}
    left = [
        body for body in scene.bodies if not body.copy_of and body.instance_ids <= recorded.keys()
    ]
    now = {instance_id: body for body in left for instance_id in body.instance_ids}
    scales = {h: now[h].scale / recorded[h].scale for h in now if now[h].scale != recorded[h].scale}
    added = tuple(
        Added(asset.category, asset.name, asset.colour)
        for draw in draws
        for thing in (draw.get("edit") or {}).get("things", ())
        if (asset := library.get(thing["asset"]))
    )
    return Changes(
        sampled=_looks(scene, frozenset(recorded), _patterns(draws)),
        scales=scales,
        moved=frozenset(h for h in now if h not in scales and _elsewhere(now[h], recorded[h])),
        copied=frozenset(old for body in scene.bodies for old in body.copy_of),
        removed=frozenset(recorded) - frozenset(now),
        added=added,
    )


def recorded(scene: Scene) -> Scene:
    """The scene as it was before any edit."""
    return replace(scene, bodies=_seen(scene), recorded_bodies=None, appearance=(), sensor=())


def _seen(scene: Scene) -> tuple[Body, ...]:
    """The recorded bodies, without what was put in."""
    return tuple(body for body in scene.tracked if body.mesh is None)


def rearranged(scene: Scene) -> Scene:
    """What is left of the recorded things, as large as they are now and where they stand now, in their old colours."""
    known = frozenset().union(*(body.instance_ids for body in _seen(scene)))
    left = tuple(body for body in scene.bodies if not body.copy_of and body.instance_ids <= known)
    there = frozenset().union(*(body.instance_ids for body in left))
    roles = {
        name: instance_ids & there
        for name, instance_ids in scene.roles.items()
        if instance_ids & there
    }
    return replace(recorded(scene), bodies=left, roles=roles)


def _patterns(draws: Sequence[Mapping[str, Any]]) -> dict[int, str]:
    """By instance id, the word for the shipped texture that was laid on it last; own images have none."""
    return {
        surface["handle"]: shipped.pattern(edit["texture"])
        for draw in draws
        if "texture" in (edit := draw.get("edit") or {}) and not edit.get("digest")
        for surface in edit.get("surfaces", ())
    }


def _looks(
    scene: Scene, known: frozenset[int], patterns: Mapping[int, str]
) -> dict[int, str | None]:
    sampled: dict[int, str | None] = {}
    for appearance in scene.appearance:
        if appearance.instance_ids is None:  # light falls on all alike, and names no thing anew
            continue
        asked, texture = (getattr(appearance, name, None) for name in ("asked", "texture"))
        colour = None if asked is None else colours.nearest(np.array(asked))
        if texture is not None:
            colour = _prevailing(texture)
        for instance_id in appearance.instance_ids & known:
            sampled[instance_id] = (
                patterns.get(instance_id) if texture is not None and not colour else colour
            )
    return sampled


def _prevailing(texture: Texture) -> str | None:
    """The colour word for nearly all of an image, None for a pattern of several."""
    start, rows, columns = next(size for size in texture.sizes if max(size[1:]) <= COARSE)
    texels = texture.texels[start : start + rows * columns] / 255.0
    named = [colours.nearest(texel) for texel in texels]
    name = max(sorted(set(named)), key=named.count)
    return name if named.count(name) >= MOSTLY * len(named) else None


def _elsewhere(now: Body, before: Body) -> bool:
    return now is not before and not np.array_equal(now.to_world, before.to_world)
