"""Whether recorded cameras agree about where things are, and which of them does not.

Two cameras that see one surface at one time must put it in one place. Each camera's points are held against the planes
that the other cameras recorded there, and the small rigid motion that would make it agree with them is its misfit. One
whose misfit is too large is named and left out, and the rest is judged again without it.

A camera that is off is off for all that it sees. Curved and grazing surfaces and the rounding of outlines are off for
some points only: others that the same motion would carry as far agree as they are. So a motion counts only where many
points tell of it and agree with it, and few do without it. What moves is left out: it may be two clocks that disagree.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, permutations

import numpy as np
from jaxtyping import Bool, Float64, Int32

from rpaug.core import geometry
from rpaug.core.types import CameraView, Episode
from rpaug.render import denoise
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded.plates import source_at, spread

FRAMES = 4  # times that are looked at
STRIDE = 2  # pixels: every other one in each direction
CLOSE = 0.04  # metres and share of depth: farther apart are two surfaces
FEWEST = 200  # points a camera must share with the others
ROUNDS = 15  # of reweighting
WIDENED = 6  # doublings of the scale to begin with
SCALE = 0.001  # metres: residuals beyond this count less and less (Cauchy weights)
FLAT = 1e-3  # of the strongest direction: motions that surfaces resist less cannot be told
SMOOTH = 0.003  # of depth: second differences beyond this are an edge
EXPLAINED = 0.25  # of what is off: a motion that explains less is none
QUARTILE = 0.75  # of the distances, for how far two cameras disagree
TELLING = 2.0  # times what counts as agreement: a point that the motion moves by more along its normal tells of it
AGREED = 3.0  # times as many telling points as without it must agree with the motion, or it is none
STILL = 0.002  # of depth: what changes by more from one frame to the next moves
NOISES = 4.0  # standard deviations of depth noise, from which on the same holds
RARE = 0.1  # of all points: rarer directions count no more than this
TOLERATED = 0.007  # metres that a camera's points may be off before it is named; curved surfaces leave up to 6 mm
TOLERATED_MOVING = (
    0.009  # for a camera that moves: real ones are about a pixel off where they say they are
)


_Pair = tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"]]


@dataclass(frozen=True)
class Misfit:
    """How far a camera's points are from where the other cameras saw them.

    `millimetres` is how far its motion towards agreement carries its points, in the mean; `milliradians` by how much
    that motion turns; `points` how many were compared. Motions that the surfaces seen cannot tell are left out.
    """

    camera: str
    millimetres: float
    milliradians: float
    points: int

    def __str__(self) -> str:
        return (
            f"{self.camera}: what it sees lies {self.millimetres:.0f} mm from where the other cameras see it; "
            "check its extrinsics"
        )


def check(
    episode: Episode, tolerated: float = TOLERATED, moving: float = TOLERATED_MOVING
) -> tuple[Misfit, ...]:
    """The cameras whose points are off by more than `tolerated` metres, or `moving` if they move, worst first.

    Blamed is the camera without which the others agree best, and so on until they agree; it is judged against those
    that are left. Of two that disagree both are named, since neither is more right. A camera that shares too little
    with the others, or has no depth, is not judged; nor is a motion that fewer than `FEWEST` points tell of.
    """
    views = {name: view for name, view in episode.views.items() if view.depth is not None}
    limits = {n: 1e3 * (tolerated if v.camera.fixed else moving) for n, v in views.items()}
    names = list(views)
    pairs = _compared(episode, list(permutations(names, 2)))
    blamed: list[str] = []
    while len(names) > 2 and _worst(pairs, names, limits) > 1:
        without = {name: _worst(pairs, [n for n in names if n != name], limits) for name in names}
        blamed.append(min(without, key=lambda name: without[name]))
        names.remove(blamed[-1])
    if len(names) == 2 and _worst(pairs, names, limits) > 1:
        blamed += names
    found = [m for name in blamed if (m := _misfit(pairs, name, names)) is not None]
    # One that was left out because it disagreed with another that is off is not off itself.
    found = [m for m in found if m.millimetres > limits[m.camera]]
    return tuple(sorted(found, key=lambda m: -m.millimetres))


def disagreement(episode: Episode, name: str, instance_ids: Collection[int]) -> float:
    """Metres that one camera's points of some instances are off the planes that still cameras recorded there.

    The upper quartile: most points lie where an error cannot be told. Infinite if too few are shared.
    """
    others = [n for n, v in episode.views.items() if v.camera.fixed and n != name and v.depth]
    found = _compared(episode, [(name, other) for other in others], instance_ids)
    off = np.abs(np.concatenate([np.zeros(0), *(off for _, _, off in found.values())]))
    return float(np.quantile(off, QUARTILE)) if len(off) >= FEWEST else np.inf


def _worst(
    pairs: Mapping[tuple[str, str], _Pair], names: Sequence[str], limits: Mapping[str, float]
) -> float:
    """The largest misfit among cameras, as a multiple of what is tolerated."""
    found = (_misfit(pairs, name, names) for name in names)
    return max((m.millimetres / limits[m.camera] for m in found if m is not None), default=0.0)


def _misfit(
    pairs: Mapping[tuple[str, str], _Pair], name: str, others: Sequence[str]
) -> Misfit | None:
    """One camera against others; None if they share too little."""
    shared = [pairs[name, other] for other in others if other != name]
    if sum(len(points) for points, _, _ in shared) < FEWEST:
        return None
    points, normals, off = (np.concatenate(part) for part in zip(*shared, strict=True))
    middle = points.mean(0)
    lever = max(float(np.sqrt(((points - middle) ** 2).sum(1).mean())), 1e-12)
    # Small motion (turn * lever, shift): its effect on each distance, all in metres.
    rows = np.concatenate([np.cross((points - middle) / lever, normals), normals], 1)
    # Rare directions count as much as common ones: most points lie on one table, which resists one shift only.
    spread_out = normals.T @ normals / len(normals) + RARE * np.eye(3)
    share = ((normals @ np.linalg.inv(spread_out)) * normals).sum(1)
    # Begun wide, since few points may tell of a motion that most, on one plane, cannot; and begun where the camera is
    # said to be, since a few outliers may pull the wide one away from there. The better of the two counts.
    found = [_settled(rows, off, share, widened) for widened in (0, WIDENED)]
    motion = min(found, key=lambda motion: _cost(rows, off, share, motion))
    left = _cost(rows, off, share, motion) / max(_cost(rows, off, share, np.zeros(6)), 1e-300)
    if left > 1 - EXPLAINED or not _borne_out(off, rows @ motion, share):
        motion = np.zeros(6)
    turn, shift = motion[:3] / lever, motion[3:]
    carried = np.cross(turn, points - middle) + shift
    return Misfit(
        camera=name,
        millimetres=1e3 * float(np.sqrt((carried**2).sum(1).mean())),
        milliradians=1e3 * float(np.linalg.norm(turn)),
        points=len(points),
    )


def _borne_out(
    off: Float64[np.ndarray, "n"], moved: Float64[np.ndarray, "n"], share: Float64[np.ndarray, "n"]
) -> bool:
    """Whether enough points that a motion moves along their normals agree with it, and far fewer without it."""
    near = max(SCALE, float(np.median(np.abs(off + moved))))
    telling = np.abs(moved) > TELLING * near
    without, within = (telling & (np.abs(one) < near) for one in (off, off + moved))
    return bool(within.sum() >= FEWEST and share[within].sum() > AGREED * share[without].sum())


def _settled(
    rows: Float64[np.ndarray, "n 6"],
    off: Float64[np.ndarray, "n"],
    share: Float64[np.ndarray, "n"],
    widened: int,
) -> Float64[np.ndarray, "6"]:
    """The motion that leaves least of `off`: reweighted least squares from none, the scale halved `widened` times."""
    motion = np.zeros(6)
    for step in range(ROUNDS):
        scale = SCALE * 2.0 ** max(0, widened - step)
        weight = share / (1.0 + ((off + rows @ motion) / scale) ** 2)
        values, axes = np.linalg.eigh((rows * weight[:, None]).T @ rows)
        keep = values > FLAT * values[-1]
        pull = axes[:, keep].T @ (rows.T @ (weight * off))
        motion = -axes[:, keep] @ (pull / values[keep])
    return motion


def _cost(
    rows: Float64[np.ndarray, "n 6"],
    off: Float64[np.ndarray, "n"],
    share: Float64[np.ndarray, "n"],
    motion: Float64[np.ndarray, "6"],
) -> float:
    """What the motion leaves, as those weights count it (Cauchy's loss)."""
    return float((share * np.log1p(((off + rows @ motion) / SCALE) ** 2)).sum())


def _compared(
    episode: Episode,
    pairs: Sequence[tuple[str, str]],
    instance_ids: Collection[int] | None = None,
) -> dict[tuple[str, str], _Pair]:
    """By pair of cameras: points of the first (of some instances), the normals of what the other saw there, and signed
    distances, all in metres."""
    found: dict[tuple[str, str], list[_Pair]] = {pair: [] for pair in pairs}
    for t in spread(episode.length)[:FRAMES]:
        seen = {name: _seen(episode.views[name], t, episode.length) for name in {*chain(*pairs)}}
        for name, other in pairs:
            found[name, other].append(_held(seen[name], seen[other], instance_ids))
    out = {}
    for pair, at in found.items():
        points, normals, off = (np.concatenate(part) for part in zip(*at, strict=True))
        out[pair] = points, normals, off
    return out


@dataclass(frozen=True)
class _CameraAt:
    """What one camera saw at one time: its pixels' points and normals in its own axes, and which of them rest."""

    plate: Source
    surface: Float64[np.ndarray, "h w 3"]
    normal: Float64[np.ndarray, "h w 3"]
    still: Bool[np.ndarray, "h w"]


def _seen(view: CameraView, t: int, length: int) -> _CameraAt:
    plate = source_at(view, t)
    surface = geometry.unproject(plate.depth.astype(np.float64), plate.K)
    return _CameraAt(plate, surface, _normals(surface, plate.ids), _still(view, t, length))


def _held(one: _CameraAt, other: _CameraAt, instance_ids: Collection[int] | None) -> _Pair:
    """One camera's points against the planes that another saw at the same time."""
    mine, theirs = one.plate, other.plate
    told = one.still & np.isfinite(mine.depth) & (mine.depth > 0)
    if instance_ids is not None:
        told &= np.isin(mine.ids, list(instance_ids))
    use = np.zeros(told.shape, bool)
    use[::STRIDE, ::STRIDE] = told[::STRIDE, ::STRIDE]
    # Relative to the camera, so that a scene far from the origin loses no digits.
    points = one.surface[use] @ mine.cam_to_world[:3, :3].T
    turn = theirs.cam_to_world[:3, :3]
    seen = (points - (theirs.cam_to_world[:3, 3] - mine.cam_to_world[:3, 3])) @ turn
    kept, row, column = _same(seen, mine.ids[use], theirs.depth, theirs.ids, theirs.K)
    normal, surface = other.normal[row, column], other.surface[row, column]
    off = ((seen[kept] - surface) * normal).sum(1)
    # Of a thin wall each may have seen another side: what faces the other camera must face this one.
    eye = (mine.cam_to_world[:3, 3] - theirs.cam_to_world[:3, 3]) @ turn
    facing = (surface * normal).sum(1) * ((surface - eye) * normal).sum(1) > 0
    # What moves tells of two clocks as much as of two places.
    good = np.isfinite(off) & facing & other.still[row, column]
    return points[kept][good], (normal @ turn.T)[good], off[good]


def _same(seen, ids, depth, instance_ids, K):
    """Which points lie where the other camera saw the same thing as near, and the pixels they fall in."""
    z = np.where(seen[:, 2] > 0, seen[:, 2], 1.0)
    r, c, inside = geometry.in_image(seen, K, depth.shape)
    inside &= (r > 0) & (r < depth.shape[0] - 1) & (c > 0) & (c < depth.shape[1] - 1)
    near = np.abs(depth[r, c] - z) < CLOSE * np.minimum(1.0, z)
    kept = inside & near & (instance_ids[r, c] == ids)
    return kept, r[kept], c[kept]


def _still(view: CameraView, t: int, length: int) -> Bool[np.ndarray, "h w"]:
    """Which pixels of a fixed camera keep their depth until the next frame; all of a camera that moves."""
    assert view.depth is not None
    depth = view.depth(t)
    if not view.camera.fixed or length == 1:
        return np.ones(depth.shape, bool)
    ids = view.ids(t) if view.ids else np.zeros(depth.shape, np.int32)
    near = max(STILL, NOISES * denoise.noise(depth, ids)) * depth
    return np.asarray(np.abs(view.depth(t + 1 if t + 1 < length else t - 1) - depth) <= near)


def _normals(
    surface: Float64[np.ndarray, "h w 3"], ids: Int32[np.ndarray, "h w"]
) -> Float64[np.ndarray, "h w 3"]:
    """Unit normals by central differences; not a number at the edge of a thing, or of a face of it."""
    across, down = np.full_like(surface, np.nan), np.full_like(surface, np.nan)
    across[:, 1:-1] = surface[:, 2:] - surface[:, :-2]
    down[1:-1] = surface[2:] - surface[:-2]
    normal = np.cross(across, down)
    bend = np.abs(surface[1:-1, 2:] + surface[1:-1, :-2] - 2 * surface[1:-1, 1:-1])[..., 2]
    fold = np.abs(surface[2:, 1:-1] + surface[:-2, 1:-1] - 2 * surface[1:-1, 1:-1])[..., 2]
    smooth = np.maximum(bend, fold) < SMOOTH * surface[1:-1, 1:-1, 2]
    for beside in (ids[1:-1, 2:], ids[1:-1, :-2], ids[2:, 1:-1], ids[:-2, 1:-1]):
        smooth &= beside == ids[1:-1, 1:-1]
    normal[1:-1, 1:-1][~smooth] = np.nan
    with np.errstate(invalid="ignore", divide="ignore"):
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)
