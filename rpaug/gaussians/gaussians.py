"""Gaussians lifted from recorded depth: flat on the surface, each as large as its pixel's footprint."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt8

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians import carrying, frame_residuals
from rpaug.gaussians.carrying import SH0
from rpaug.render.splat import Gradients, Splats
from rpaug.scene.lighting import irradiance
from rpaug.scene.sampled_frames import lift

CONJUGATE = np.array([1.0, -1, -1, -1])  # of a unit quaternion: its inverse
SPREAD = 0.5  # standard deviation over the spacing of the pixels: neighbours blend, gaps close
THIN = 0.1  # thickness over that
GRAZING = 0.25  # cosine below which a footprint is not stretched further
OPACITY = 0.95


@dataclass(frozen=True)
class LiftedImage:
    """One recorded image with all that lifts it: `use` marks the pixels to take."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]
    ids: Int32[np.ndarray, "h w"]
    K: Float64[np.ndarray, "3 3"]
    cam_to_world: Float64[np.ndarray, "4 4"]
    use: Bool[np.ndarray, "h w"]


def lifted(picture: LiftedImage, spacing: float = 1.0) -> Gaussians:
    """One Gaussian in world coordinates for each used pixel, `spacing` pixels apart from the next one used."""
    pose = picture.cam_to_world
    points, normals = lift(picture.depth, picture.ids, picture.K, pose)
    use = picture.use & (picture.depth > 0) & np.isfinite(picture.depth)
    at, z = points[use].astype(np.float64), picture.depth[use].astype(np.float64)
    sight = at - pose[:3, 3]
    sight /= np.maximum(np.linalg.norm(sight, axis=-1, keepdims=True), 1e-9)
    normal = normals[use].astype(np.float64)
    # Where no neighbour tells, the surface is taken to face the camera.
    normal = np.where(np.abs(normal).sum(-1, keepdims=True) > 0, normal, -sight)
    slope = np.clip(np.abs((normal * sight).sum(-1)), GRAZING, 1.0)
    size = SPREAD * spacing * z / picture.K[0, 0]
    return Gaussians(
        means=at.astype(np.float32),
        quats=quaternions(_frames(normal, sight)).astype(np.float32),
        scales=np.stack([size / slope, size, size * THIN], -1).astype(np.float32),
        opacities=np.full(len(at), OPACITY, np.float32),
        sh=((picture.rgb[use].astype(np.float32) / 255 - 0.5) / SH0)[:, None],
        ids=picture.ids[use].astype(np.int32),
    )


def _frames(
    normal: Float64[np.ndarray, "n 3"], sight: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3 3"]:
    """Rotations whose columns are the direction in which the surface tilts away, the other one, the normal."""
    tilt = sight - (sight * normal).sum(-1, keepdims=True) * normal
    length = np.linalg.norm(tilt, axis=-1, keepdims=True)
    axis = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    other = np.cross(normal, axis)
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    first = np.where(length > 1e-3, tilt / np.maximum(length, 1e-9), other)
    return np.stack([first, np.cross(normal, first), normal], -1)


def quaternions(rotations: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, "n 4"]:
    """Unit quaternions (w, x, y, z), by the largest of the four candidates (Shepperd 1978)."""
    r = rotations
    trace = np.trace(r, axis1=-2, axis2=-1)
    diagonal = np.einsum("nii->ni", r)
    pick = np.concatenate([trace[:, None], diagonal], -1).argmax(-1)
    antisymmetric = np.stack(
        [r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], -1
    )
    symmetric = r + np.swapaxes(r, -1, -2)
    q = np.zeros((len(r), 4))
    real = pick == 0
    q[real] = np.concatenate([1 + trace[real, None], antisymmetric[real]], -1)
    for k in range(3):
        row = pick == k + 1
        q[row, 0] = antisymmetric[row, k]
        q[row, 1:] = symmetric[row, k]
        q[row, 1 + k] = 1 + 2 * diagonal[row, k] - trace[row]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def turned(by: Float[np.ndarray, "4"], quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """The quaternion product by * quats: first `quats`, then `by`."""
    w, x, y, z = by
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]], quats.dtype)
    return quats @ left.T


def normals(quats: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"]:
    """The third axis of each rotation, of quaternions of any length: where a flat Gaussian faces."""
    w, x, y, z = (quats / np.maximum(np.linalg.norm(quats, axis=-1, keepdims=True), 1e-12)).T
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], -1)


def moved(gaussians: Gaussians, motion: Float[np.ndarray, "4 4"]) -> Gaussians:
    """The same Gaussians carried by one rigid motion (constant colors stay as they are)."""
    by = quaternions(motion[None, :3, :3])[0]
    means = geometry.transform(motion, gaussians.means.astype(np.float64))
    return replace(
        gaussians,
        means=means.astype(np.float32),
        quats=turned(by, gaussians.quats).astype(np.float32),
        frame_residuals=frame_residuals.moved(
            gaussians.frame_residuals, motion[:3, :3], turned(by, np.eye(4))
        ),
    )


def placed(scene: Scene, t: int) -> Gaussians:
    """The scene's Gaussians in the world at t. Raises Unsupported if it has none."""
    if scene.gaussians is None:
        raise Unsupported("this scene has no Gaussians: rpaug fit, or --tier 3, makes them")
    return standing_at(scene.gaussians, scene.bodies, t, scene.irradiance)


def standing_at(
    gaussians: Gaussians,
    bodies: Sequence[Body],
    t: int,
    light: Float64[np.ndarray, "9"] | None = None,
) -> Gaussians:
    """Gaussians of these bodies in the world at t, lit as they stand there."""
    then = frame_residuals.at(gaussians, t)
    where = Placement.of(then.ids, bodies, light).place(Splats.of(then), t)
    assert where.quats is not None
    return replace(then, means=where.means, quats=where.quats, sh=where.sh)


def joined(parts: Iterable[Gaussians]) -> Gaussians:
    """All Gaussians of several sets."""
    parts = list(parts)
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in Gaussians.ARRAYS
    }
    return Gaussians(**arrays, frame_residuals=frame_residuals.joined(parts))


def chosen(gaussians: Gaussians, keep: np.ndarray) -> Gaussians:
    """The Gaussians that `keep` (mask or indices) names."""
    arrays = {name: getattr(gaussians, name)[keep] for name in Gaussians.ARRAYS}
    rows = np.arange(len(gaussians))[keep]
    return Gaussians(
        **arrays,
        frame_residuals=frame_residuals.kept(gaussians.frame_residuals, rows, len(gaussians)),
    )


@dataclass(frozen=True)
class Placement:
    """Where the Gaussians of each moving body are over time: rows, body-to-world motions, and their turns."""

    rows: tuple[Int[np.ndarray, "m"], ...]
    motions: tuple[Float64[np.ndarray, "t 4 4"], ...]
    turns: tuple[Float64[np.ndarray, "t 4"], ...]
    light: Float64[np.ndarray, "9"] = field(default_factory=irradiance.even)

    @staticmethod
    def of(
        ids: Int32[np.ndarray, "n"],
        bodies: Sequence[Body],
        light: Float64[np.ndarray, "9"] | None = None,
    ) -> "Placement":
        """Bodies that stand still need no placing: their frame is the world."""
        moving = [body for body in bodies if (body.to_world != np.eye(4)).any()]
        rows = [np.flatnonzero(np.isin(ids, list(body.instance_ids))) for body in moving]
        kept = [(r, body.to_world) for r, body in zip(rows, moving, strict=True) if len(r)]
        return Placement(
            tuple(r for r, _ in kept),
            tuple(motion for _, motion in kept),
            tuple(quaternions(motion[:, :3, :3]) for _, motion in kept),
            irradiance.even() if light is None else light,
        )

    def place(self, splats: Splats, t: int) -> Splats:
        """Splats given in their bodies' frames, in the world at t."""
        assert splats.quats is not None
        means, quats, sh = splats.means.copy(), splats.quats.copy(), splats.sh.copy()
        for rows, motion, turn in zip(self.rows, self.motions, self.turns, strict=True):
            carrying.carry(rows, motion[t], turn[t], self.light, means, quats, sh)
        return replace(splats, means=means, quats=quats, sh=sh)

    def take_back(self, placed: Splats, t: int) -> Splats:
        """Splats in the world at t, in their bodies' frames: undoes `place`."""
        assert placed.quats is not None
        means, quats, sh = placed.means.copy(), placed.quats.copy(), placed.sh.copy()
        for rows, motion, turn in zip(self.rows, self.motions, self.turns, strict=True):
            back, turn_back = geometry.inverse(motion[t]), turn[t] * CONJUGATE
            carrying.carry_back(rows, back, turn_back, self.light, means, quats, sh)
        return replace(placed, means=means, quats=quats, sh=sh)

    def pull_back(
        self, gradients: Gradients, splats: Splats, placed: Splats, t: int
    ) -> tuple[Gradients, Float64[np.ndarray, "9"]]:
        """Gradients by `placed` as gradients by `splats`, and by the light; changes its argument."""
        assert gradients.quats is not None
        assert placed.quats is not None
        light = np.zeros(irradiance.TERMS)
        for rows, motion, turn in zip(self.rows, self.motions, self.turns, strict=True):
            back = np.ascontiguousarray(motion[t, :3, :3].T)
            carrying.pull(
                rows, back, turn[t] * CONJUGATE, self.light, splats.sh, placed.quats,
                gradients.means, gradients.quats, gradients.sh, light,
            )  # fmt: skip
        return gradients, light
