"""What of the flowing Gaussians is there at one time, as ordinary ones beside the rigid ones."""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32

from rpaug.core import geometry
from rpaug.core.types import Gaussians, Gaussians4, Scene
from rpaug.gaussians import gaussians4
from rpaug.gaussians.gaussians import chosen, joined, moved, quaternions
from rpaug.render.splat import Splats, View
from rpaug.scene.recorded.carry import Carried, carried


def standing(flowing: Gaussians4, t: float) -> Gaussians:
    """The Gaussians of frame t, relative to the flowing ones' origin, their weight in time part of the opacity."""
    cut = gaussians4.at(flowing, t)
    variances, turn = np.linalg.eigh(cut.covariances)
    turn[:, :, 0] *= np.sign(np.linalg.det(turn))[:, None]
    return Gaussians(
        means=cut.means.astype(np.float32),
        quats=quaternions(turn).astype(np.float32),
        scales=np.sqrt(np.maximum(variances, 1e-18)).astype(np.float32),
        opacities=(flowing.opacities[cut.rows] * cut.weights).astype(np.float32),
        sh=flowing.sh[cut.rows],
        ids=flowing.ids[cut.rows],
    )


def some(flowing: Gaussians4, keep: Bool[np.ndarray, "n"]) -> Gaussians4 | None:
    """Those that `keep` marks, None if that is none of them."""
    if not keep.any():
        return None
    names = ("means", "left", "right", "scales", "opacities", "sh", "ids")
    rows: dict[str, Any] = {name: getattr(flowing, name)[keep] for name in names}
    return replace(flowing, **rows)


def edited(now: Gaussians, scene: Scene, t: int, origin: Float64[np.ndarray, "3"]) -> Gaussians:
    """Gaussians relative to `origin`, moved, copied or left out as the scene's bodies were."""
    edits = carried(scene, t)
    if not edits:
        return now
    gone = [instance_id for edit in edits for instance_id in edit.instance_ids]
    rest = chosen(now, ~np.isin(now.ids, gone))
    return joined([rest, *(_carried(now, edit, origin) for edit in edits if edit.shows)])


def _carried(now: Gaussians, edit: Carried, origin: Float64[np.ndarray, "3"]) -> Gaussians:
    motion = edit.motion.copy()
    motion[:3, 3] = geometry.transform(edit.motion, origin) - origin
    mine = chosen(now, np.isin(now.ids, list(edit.shows)))
    if edit.scale != 1.0:
        # Grown about the world's origin, which is where `motion` expects it.
        grown = edit.scale * (mine.means + origin) - origin
        size = mine.scales * np.float32(edit.scale)
        mine = replace(mine, means=grown.astype(np.float32), scales=size)
    mine = moved(mine, motion)
    return replace(mine, ids=np.array([edit.shows[int(i)] for i in mine.ids], np.int32))


def beside(
    splats: Splats,
    ids: Int32[np.ndarray, "n"],
    flowing: Gaussians,
    origin: Float64[np.ndarray, "3"],
) -> tuple[Splats, Int32[np.ndarray, "m"]]:
    """Splats in the world and their instance ids, with those of one time of the flowing Gaussians after them."""
    assert splats.quats is not None
    assert splats.scales is not None
    more = Splats.of(flowing)
    every = Splats(
        # In double: the rasteriser takes them relative to the camera, wherever the world's origin is.
        means=np.concatenate([splats.means.astype(np.float64), more.means + origin]),
        opacities=np.concatenate([splats.opacities, more.opacities]),
        sh=np.concatenate([splats.sh, more.sh]),
        quats=np.concatenate([splats.quats, more.quats]),
        scales=np.concatenate([splats.scales, more.scales]),
    )
    return every, np.concatenate([ids, flowing.ids])


def shapes(
    quats: Float[np.ndarray, "n 4"], scales: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3 3"]:
    """Covariances in square metres of 3D Gaussians."""
    w, x, y, z = (quats / np.maximum(np.linalg.norm(quats, axis=1, keepdims=True), 1e-12)).T
    turn = np.empty((len(quats), 3, 3))
    turn[:, 0] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1)
    turn[:, 1] = np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1)
    turn[:, 2] = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)
    shaped = turn * scales[:, None, :]
    return shaped @ np.swapaxes(shaped, 1, 2)


def seen_by(gaussians: Gaussians, view: View) -> Splats:
    """The Gaussians that reach into a picture, by covariances."""
    local = geometry.transform(view.world_to_camera, gaussians.means.astype(np.float64))
    z = np.maximum(local[:, 2], 1e-6)
    reach = 4.0 * gaussians.scales.max(1) * view.K[0, 0] / z + 2.0
    column, row = geometry.to_image(local, z, view.K)
    near = (column > -reach) & (column < view.width + reach)
    near &= (row > -reach) & (row < view.height + reach) & (local[:, 2] > 0)
    mine = chosen(gaussians, near)
    rows, columns = gaussians4.UPPER
    covariances = shapes(mine.quats, mine.scales)[:, rows, columns].astype(np.float32)
    return Splats(mine.means, mine.opacities, mine.sh, covariances=covariances)
