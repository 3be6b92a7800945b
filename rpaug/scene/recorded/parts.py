"""Moving bodies at other times: what of them cannot be seen now, carried along by their pose.

A robot's part that is outside the frame now, or turned away, was seen at some other time. Where the body's track can be
trusted, a recording of that time shows it now as well, drawn from a camera that moved along with the body.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.types import Body, Scene
from rpaug.render.window import RIM, trimmed
from rpaug.render.zbuffer import Source, lift
from rpaug.scene.recorded.plates import among, source_at, spread

CANDIDATES = 16  # frames, spread over the episode, that are looked at
MOST = 4  # recordings kept of a body
CELL = 0.01  # metres: how finely it is told what is new in a recording
FINENESS = (np.inf, 0.2, 0.1)  # of a cell: a pixel this small, or smaller, shows it anew
NEW = 0.08  # of all cells: a recording that adds less is not kept
TRUSTED = 0.003  # metres: residual of a track up to which its poses carry surfels


@dataclass(frozen=True)
class PartRecording:
    """A recording of a body at another time: its surfels, and the pose that the body had then."""

    instance_ids: frozenset[int]
    source: Source
    to_world: Float64[np.ndarray, "4 4"]

    def at(self, to_world: Float64[np.ndarray, "4 4"]) -> Source:
        """The surfels with the body where it is now."""
        carried = to_world @ geometry.inverse(self.to_world)
        return replace(self.source, cam_to_world=carried @ self.source.cam_to_world)


_Seen = tuple[PartRecording, set[int]]


def trusted(body: Body) -> bool:
    """Whether a body's track is good enough to carry its surface."""
    moves = body.motion not in ("static", "unknown")
    return moves and not body.ambiguous and body.residual <= TRUSTED


def recorded(scene: Scene, noise: float, tolerance: float, rim: int) -> tuple[PartRecording, ...]:
    """A few recordings of each trusted body that together show most of what was ever seen of it.

    Reads `CANDIDATES` frames of each camera, and none if no body can be trusted. Of each recording only the body and
    `rim` pixels around it are kept.
    """
    bodies = [body for body in scene.tracked if trusted(body)]
    seen: dict[frozenset[int], list[_Seen]] = {body.instance_ids: [] for body in bodies}
    for t in spread(scene.episode.length)[:CANDIDATES] if bodies else ():
        for view in scene.episode.views.values():
            source = source_at(view, t, noise, carved=True, mixed=scene.antialiased)
            for body in bodies:
                if (found := _seen(source, body, t)) is not None:
                    seen[body.instance_ids].append(found)
    kept = [part for found in seen.values() for part in _most_telling(found)]
    return tuple(
        replace(part, source=trimmed(lift(part.source, tolerance), max(RIM, rim))) for part in kept
    )


def _seen(source: Source, body: Body, t: int) -> _Seen | None:
    """What a recording shows of the body, and which cells of the body's own frame that fills, each so finely."""
    use = among(source.ids, body.instance_ids) & np.isfinite(source.depth) & (source.depth > 0)
    use &= True if source.use is None else source.use
    if not use.any():
        return None
    points = geometry.unproject(np.where(use, source.depth, 0).astype(np.float64), source.K)[use]
    own = geometry.inverse(body.to_world[t]) @ source.cam_to_world
    cells = np.floor(geometry.transform(own, points) / CELL).astype(np.int64) & 0xFFFFF
    packed = cells[:, 0] << 40 | cells[:, 1] << 20 | cells[:, 2]
    pitch = points[:, 2] / source.K[0, 0]
    finer = [packed[pitch <= CELL * share] | n << 60 for n, share in enumerate(FINENESS)]
    part = PartRecording(body.instance_ids, replace(source, use=use), body.to_world[t])
    return part, set(np.concatenate(finer).tolist())


def _most_telling(seen: list[_Seen]) -> Iterator[PartRecording]:
    """Greedily the recordings that add most, while they add enough."""
    every = {cell for _, cells in seen for cell in cells}
    known: set[int] = set()
    for _ in range(min(MOST, len(seen))):
        part, cells = max(seen, key=lambda one: len(one[1] - known))
        if len(cells - known) < NEW * len(every):
            return
        known |= cells
        yield part
