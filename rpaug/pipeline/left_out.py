"""Views kept back from a recording, with the truth beside them: what a tier is judged on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.types import CameraView, Episode, Scene
from rpaug.render import holes, zbuffer
from rpaug.scene.build import build
from rpaug.scene.recorded import surfels

SAME_POINT = 0.004, 0.01  # metres and share of depth: a recorded pixel this close saw the point
OTHER_TIMES = 5  # frames between the recordings that may have seen a static point


@dataclass(frozen=True)
class Sight:
    """One view to be shown: camera `name` of `scene` at `t`, its truth, and which pixels some recording shows.

    A camera that was left out is in `scene.cameras` but not in `scene.episode`.
    """

    scene: Scene
    name: str
    t: int
    true: CameraView
    covisible: Bool[np.ndarray, "h w"]


def left_out(episode: Episode, name: str, every: int) -> tuple[Scene, list[Sight]]:
    """The scene without one camera, and what that camera recorded as views to be shown.

    Raises Unsupported if nothing is left, or there is no depth.
    """
    rest = {other: view for other, view in episode.views.items() if other != name}
    truth = episode.views[name]
    if not rest or truth.depth is None or truth.ids is None:
        raise Unsupported(f"{name}: leaving it out takes another camera, and depth and masks")
    scene = build(replace(episode, views=rest), with_bodies=True)
    there = replace(scene, cameras={**scene.cameras, name: truth.camera})
    return scene, list(sights(there, {name: truth}, range(every // 2, episode.length, every)))


def sights(scene: Scene, truths: dict[str, CameraView], times: Sequence[int]) -> Iterator[Sight]:
    """Every true view at these times."""
    static = frozenset().union(
        *(body.instance_ids for body in scene.tracked if body.motion == "static")
    )
    for name, true in truths.items():
        for t in times:
            yield Sight(scene, name, t, true, covisible(scene, static, true, t))


def covisible(
    scene: Scene, static: frozenset[int], true: CameraView, t: int
) -> Bool[np.ndarray, "h w"]:
    """Which pixels of the true view show a point that the episode recorded: now, or at another time if static."""
    assert true.depth is not None
    assert true.ids is not None
    points = geometry.world_points(true.depth(t).astype(np.float64), true.camera, t)
    ids = true.ids(t)
    seen = np.zeros(ids.shape, bool)
    still = np.isin(ids, list(static))
    for when in (t, *(set(range(0, scene.episode.length, OTHER_TIMES)) - {t})):
        for view in scene.episode.views.values():
            assert view.depth is not None
            assert view.ids is not None
            left = ~seen if when == t else ~seen & still
            pixel, z = geometry.project(points[left], view.camera, when)
            columns, rows = np.rint(pixel).astype(int).T
            inside = (z > 0) & (columns >= 0) & (rows >= 0)
            inside &= (columns < view.camera.width) & (rows < view.camera.height)
            rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
            near = np.abs(view.depth(when)[rows, columns] - z) < SAME_POINT[0] + SAME_POINT[1] * z
            seen[left] = inside & near & (view.ids(when)[rows, columns] == ids[left])
    return seen


def anchor(sight: Sight) -> str:
    """The recording to draw from first: the camera's own, or else the one that looks most nearly the same way."""
    scene, t = sight.scene, sight.t
    views = scene.episode.views
    if sight.name in views:
        return sight.name
    way = scene.cameras[sight.name].cam_to_world[t][:3, 2]
    return max(views, key=lambda other: float(views[other].camera.cam_to_world[t][:3, 2] @ way))


def shown_by_surfels(kept: surfels.Surfels, sight: Sight) -> surfels.Rendered:
    """What surfels show of it, holes filled, from a camera that recorded anything or from one that was left out."""
    camera = sight.scene.cameras[sight.name]
    found = list(surfels.sources(kept, sight.scene, anchor(sight), sight.t))
    drawn = zbuffer.render(
        camera.K, camera.cam_to_world[sight.t], (camera.width, camera.height), found,
        witness=found[0], tolerance=kept.tolerance,
    )  # fmt: skip
    return holes.fill(drawn)
