"""How each edited body gets from where it was recorded to where it is now."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int32

from rpaug.core import geometry, pixels
from rpaug.core.types import Body, Scene
from rpaug.render.outlines import BEFORE, TOUCHING, Footprints, grown
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded.plates import among


@dataclass(frozen=True)
class Carried:
    """One edited body at one time.

    `instance_ids` are recorded instance ids to be cut out where they were; `shows` maps recorded instance ids to
    those drawn
    anew, empty for a removed body; `motion` carries recorded world points, scaled by `scale` about the world's origin,
    to where they are drawn.
    """

    instance_ids: frozenset[int]
    shows: Mapping[int, int]
    motion: Float64[np.ndarray, "4 4"]
    scale: float = 1.0

    def carry(self, source: Source) -> Source:
        """A recording of the body, its surfels moved and named anew; nothing there was seen through."""
        ids, pose = source.ids, source.cam_to_world.copy()
        pose[:3, 3] *= self.scale  # a world and a camera that grow alike give the same image
        for old, new in self.shows.items():
            if old != new:
                ids = np.where(source.ids == old, np.int32(new), ids)
        return replace(
            source,
            ids=ids,
            depth=source.depth * np.float32(self.scale),
            lifted=None if source.lifted is None else self._loose(source.ids, source.lifted),
            cam_to_world=self.motion @ pose,
            carved=False,
            distant=False,
        )

    def _loose(self, ids: Int32[np.ndarray, "h w"], prints: Footprints) -> Footprints:
        """The body's footprints as it now is: where it touched what stays, it ends."""
        rest = ~among(ids, frozenset(self.shows))
        met = pixels.grown(rest, 1)
        edge = np.where((prints.edge == TOUCHING) & met, np.int8(BEFORE), prints.edge)
        return grown(replace(prints, edge=edge), self.scale)


def carried(scene: Scene, t: int) -> tuple[Carried, ...]:
    """The bodies of the scene that are not, at time t, as they were recorded: moved, copied or removed."""
    if scene.recorded_bodies is None:
        return ()
    recorded = {instance_id: body for body in scene.tracked for instance_id in body.instance_ids}
    solid = [body for body in scene.bodies if body.soft is None]
    present = {h for body in solid if not body.copy_of for h in body.instance_ids}
    gone = frozenset(recorded) - present
    edits = [Carried(gone, {}, np.eye(4))] if gone else []
    for body in solid:
        if body.mesh is not None:
            continue  # never recorded, so not carried from anywhere
        names = body.copy_of or {instance_id: instance_id for instance_id in body.instance_ids}
        step = motion(body, recorded[next(iter(names))], t)
        if body.copy_of:
            edits.append(Carried(frozenset(), names, step, body.scale))
        elif body.scale != 1.0 or not np.array_equal(step, np.eye(4)):
            edits.append(Carried(body.instance_ids, names, step, body.scale))
    return tuple(edits)


def motion(body: Body, recorded: Body, t: int) -> Float64[np.ndarray, "4 4"]:
    """From recorded world points, scaled about the world's origin, to where they are now."""
    if body.scale == 1.0 and np.array_equal(body.to_world[t], recorded.to_world[t]):
        return np.eye(4)
    # scale * (R p + c) has to become R' (scale * p) + c'.
    grown_track = recorded.to_world[t].copy()
    grown_track[:3, 3] *= body.scale
    return body.to_world[t] @ geometry.inverse(grown_track)
