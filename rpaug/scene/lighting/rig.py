"""The lamps that a recording was lit by, told by the shadows that they cast (Sato, Sato and Ikeuchi 2003).

Pixel = albedo x (ambient + sum of strength x reached x max(0, normal . direction)). Known surfaces say which places
each direction reaches, at each time. A thing's albedo is one number here, what its pattern varies by is noise; a
place that rests and grows darker for a time has its own. The lamps are those whose light explains most of what
brightness varies by, one after another.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float32, Float64, Int64

from rpaug.core import memo, sampling
from rpaug.core.jit import kernel
from rpaug.core.types import Camera, CameraView, Episode, Rig, Scene
from rpaug.scene.lighting import casting
from rpaug.scene.recorded import lit

DARKER = 0.85  # of its brightness at another time: what rests is in shadow
OFTEN = 0.004  # of what rests, at least, that a cast shadow passes over
TESTED = 4  # frames in which shadows that come and go are looked for
EXPLAINED = 0.5  # of what grows darker, that the lamps' shadows make up for, at least: more likely theirs than not

FRAMES = 4
PIXELS = 130  # of one image
DARKENED = 600  # places that rest and grow darker for a time, of all images
DARK, BRIGHT = 0.03, 0.98  # of the brightest channel: outside, nothing is measured
SEEN = 30  # pixels of a thing, from which it counts
DIRECTIONS = 160  # tried, over the upper half space
LOWEST = 0.17  # sine of a lamp's height above the horizon, at least
COARSE = 0.016  # metres, cells in which lamps are sought
MOST_LAMPS = 3
WEAK = 0.08  # of the ambient light and all lamps: what a lamp gives at least
GAIN = 0.02  # of the misfit: what a lamp takes away at least
STEPS: tuple[float, ...] = tuple(
    np.deg2rad([6.0, 3.0, 1.5, 0.75]).tolist()
)  # by which a direction is bettered
SPREAD = 0.08  # log brightness: misfits beyond are robbed of weight
PASSES = 4

NO_CAMERAS: Mapping[str, Camera] = MappingProxyType({})  # one object, so that scenes compare


def find(scene: Scene) -> Rig | None:
    """The lamps of an episode that has moving shadows; None without any, or where no depth tells what casts them."""
    return _find(recorded(scene)) if scene.bodies else None


def nothing_casts(scene: Scene) -> bool:
    """Whether things move in sight of a camera that stands still and no shadow goes along: then what is dark is no
    shadow. Not known, so False, where nothing moves."""
    found = recorded(scene)
    if not (found.bodies and found.moving):
        return False
    fell = _fell(found)
    return any(one.seen for one in fell) and not _often(fell)


def unexplained(scene: Scene) -> bool:
    """Whether shadows pass over what rests and no lamps were found that cast them."""
    return bool(scene.bodies) and find(scene) is None and _often(_fell(recorded(scene)))


@memo.of_episode
def shadows_wander(episode: Episode) -> bool:
    """Whether a shadow passes over anything at all, before it is known what moves: then it may be worth knowing."""
    masked = all(view.depth and view.ids for view in episode.views.values())
    return masked and _often(_darkened(episode, frozenset()))


def _often(fell: "Sequence[_Darkened]") -> bool:
    return _share(fell) > OFTEN


def _share(fell: "Sequence[_Darkened]") -> float:
    """Of what rests, the share that grows darker for a time."""
    return sum(len(one.rows) for one in fell) / max(sum(one.seen for one in fell), 1)


def nearest_at(lamps: Rig, direction: Float64[np.ndarray, "3"]) -> Rig:
    """The lamps with the one nearest to a direction exactly there."""
    nearest = int(np.argmax(np.array(lamps.directions) @ direction))
    x, y, z = direction.tolist()
    directions = list(lamps.directions)
    directions[nearest] = (x, y, z)
    return _level(lamps.ambient, directions, lamps.strengths)


def chosen(lamps: Rig, which: int | str) -> list[int]:
    """Indices of the lamp of that number, 1 for the strongest; of the "strongest", or of "all". Raises IndexError."""
    ordered = np.argsort([-one for one in lamps.strengths], kind="stable").tolist()
    if which == "all":
        return ordered
    return [ordered[0 if which == "strongest" else int(which) - 1]]


def with_ambient(lamps: Rig, share: float) -> Rig:
    """The lamps with such a share of all light that has no direction."""
    strengths = np.array(lamps.strengths) * (1 - share) / sum(lamps.strengths)
    return _level(share, lamps.directions, strengths.tolist())


def _level(
    ambient: float, directions: Sequence[tuple[float, float, float]], strengths: Sequence[float]
) -> Rig:
    """Lamps that light level ground by 1."""
    up = ambient + sum(one * towards[2] for one, towards in zip(strengths, directions, strict=True))
    return Rig(
        round(float(ambient / up), 5),
        tuple(
            (round(float(x), 5), round(float(y), 5), round(float(z), 5)) for x, y, z in directions
        ),
        tuple(round(float(one / up), 5) for one in strengths),
    )


def turned(lamps: Rig, heading: float, higher: float) -> Rig:
    """All lamps turned about the vertical, and each that many times as high above the horizon; level ground that all
    of them reach has the light it had."""
    return replace(lamps, directions=turned_directions(lamps.directions, heading, higher))


def turned_directions(
    directions: Sequence[casting.Direction], heading: float, higher: float
) -> tuple[casting.Direction, ...]:
    """Directions to lamps, turned alike."""
    moved = []
    for x, y, z in directions:
        height = np.clip(higher * np.arcsin(z), np.arcsin(LOWEST), np.pi / 2)
        turn = np.arctan2(y, x) + heading
        along = np.cos(height)
        moved.append(
            (float(along * np.cos(turn)), float(along * np.sin(turn)), float(np.sin(height)))
        )
    return tuple(moved)


def recorded(scene: Scene) -> Scene:
    """The scene as it was recorded, whatever was edited since: lamps and shadows are sought there."""
    bodies = tuple(body for body in scene.tracked if body.mesh is None and body.soft is None)
    return replace(
        memo.bare(scene),
        bodies=bodies,  # without what edits put in
        recorded_bodies=None,
        cameras=NO_CAMERAS,
        simulated=(),
    )


def told(scene: Scene) -> tuple[float, float]:
    """Of what rests, the share that a shadow passes over, and of what grows darker there, the share that the likeliest
    lamps explain, 0..1."""
    return (
        (_share(_fell(recorded(scene))), _likeliest(recorded(scene))[1])
        if scene.bodies
        else (0.0, 0.0)
    )


def _find(scene: Scene) -> Rig | None:
    lamps, explained = _likeliest(scene)
    return lamps if explained >= EXPLAINED else None


@memo.last
def _likeliest(scene: Scene) -> tuple[Rig | None, float]:
    """The lamps that explain most of what grows darker, and how much of it: None where no shadow wanders."""
    fell = _fell(scene)
    found = _Fitter(scene, _sample(scene, fell)).fitted() if _often(fell) else None
    return found, 0.0 if found is None else _explained(scene, fell, found)


@memo.last
def _fell(scene: Scene) -> "list[_Darkened]":
    return _darkened(scene.episode, scene.moving)


@dataclass(frozen=True, eq=False)
class _Darkened:
    """Of the `seen` pixels that rest in one camera, those that grow darker for a time, by how much, between when."""

    view: CameraView
    seen: int
    rows: Int64[np.ndarray, "n"]
    fall: Float32[np.ndarray, "n"]  # of log brightness
    times: Int64[np.ndarray, "t"]
    brightest: Int64[np.ndarray, "n"]  # which of the times
    darkest: Int64[np.ndarray, "n"]


def _darkened(episode: Episode, moving: frozenset[int]) -> list[_Darkened]:
    """Whether shadows pass over what rests: the cheap test, on a few frames of the cameras that stand still.

    Never in photographs, whose colors are no light times albedo, and which have no recorded masks.
    """
    if any(view.inferred for view in episode.views.values()):
        return []
    times = sampling.frames(episode.length, TESTED)
    found = []
    for view in casting.known(episode):
        if not view.camera.fixed:
            continue
        ids = np.stack([view.ids(t) for t in times])  # type: ignore[misc]
        bright = np.stack([view.rgb(t).max(-1) for t in times]).astype(np.float32) / 255
        rests = (ids == ids[0]).all(0) & ~np.isin(ids[0], sorted(moving))
        rests &= np.all([lit.inside(one) for one in ids], axis=0)
        high, low = bright.max(0), bright.min(0)
        told = rests & (high > DARK)
        dark = told & (low < DARKER * high)
        fall = np.log(high / np.maximum(low, DARK), where=dark, out=np.zeros_like(high))[dark]
        when = bright.argmax(0)[dark], bright.argmin(0)[dark]
        rows = np.flatnonzero(dark)
        found.append(_Darkened(view, int(told.sum()), rows, fall, np.array(times), *when))
    return found


def _explained(scene: Scene, fell: Sequence[_Darkened], lamps: Rig) -> float:
    """Of all that grew darker, the share that known surfaces in the way of these lamps make up for, 0..1."""
    told = total = 0.0
    for one in fell:
        light = np.log([_light(scene, one, t, lamps) for t in one.times.tolist()])
        each = np.arange(len(one.rows))
        fall = light[one.brightest, each] - light[one.darkest, each]
        told += float(np.clip(fall, 0, one.fall).sum())
        total += float(one.fall.sum())
    return told / total


def _light(scene: Scene, one: _Darkened, t: int, lamps: Rig) -> Float32[np.ndarray, "n"]:
    _, places = casting.discs_of(one.view, t, one.rows)
    maps = casting.casters(scene).maps(t, lamps.directions)
    return lamps.light(places.normals, [each.reached(places) for each in maps])


@dataclass(frozen=True)
class _Samples:
    """Pixels of several cameras and times: log brightness, whose albedo each has, and where it lies."""

    level: Float64[np.ndarray, "n"]
    owner: Int64[np.ndarray, "n"]
    time: Int64[np.ndarray, "n"]
    places: casting.Discs


def _sample(scene: Scene, fell: "Sequence[_Darkened]") -> _Samples:
    """Pixels of things, and places that grow darker for a time, at all times looked at."""
    parts = [_of_things(scene)]
    count = int(parts[0].owner.max(initial=-1)) + 1
    step = max(1, sum(len(one.rows) for one in fell) // DARKENED)
    for one in fell:
        rows = one.rows[::step]
        for t in one.times.tolist():
            _, places = casting.discs_of(one.view, t, rows)
            color = one.view.rgb(t).reshape(-1, 3)[rows] / 255.0
            level = np.log(np.maximum(color.mean(1), DARK))
            parts.append(
                _Samples(level, count + np.arange(len(rows)), np.full(len(rows), t), places)
            )
        count += len(rows)
    return _Samples(
        np.concatenate([one.level for one in parts]),
        np.concatenate([one.owner for one in parts]),
        np.concatenate([one.time for one in parts]),
        casting.joined([one.places for one in parts]),
    )


def _of_things(scene: Scene) -> _Samples:
    found = []
    for t in sampling.frames(scene.episode.length, FRAMES):
        for view in casting.known(scene.episode):
            rows = np.flatnonzero(lit.inside(view.ids(t)))  # type: ignore[misc]
            rows = rows[:: max(1, len(rows) // PIXELS)]
            ids, places = casting.discs_of(view, t, rows)
            color = view.rgb(t).reshape(-1, 3)[rows] / 255.0
            high = color.max(1)
            good = (ids > 0) & (high > DARK) & (high < BRIGHT)
            own = casting.Discs(places.points[good], places.normals[good], places.width[good])
            found.append((np.log(color[good].mean(1)), ids[good], np.full(good.sum(), t), own))
    level, ids, time = (np.concatenate([one[k] for one in found]) for k in range(3))
    places = casting.joined([one[3] for one in found])
    _, owner, count = np.unique(ids, return_inverse=True, return_counts=True)
    often = count[owner] >= SEEN
    _, owner = np.unique(owner[often], return_inverse=True)
    kept = casting.Discs(places.points[often], places.normals[often], places.width[often])
    return _Samples(level[often], owner, time[often], kept)


class _Fitter:
    def __init__(self, scene: Scene, samples: _Samples) -> None:
        self._samples = samples
        casters, places = casting.casters(scene), samples.places
        self._resting = _in_cells(casters.resting)
        self._by_time = []
        for t in np.unique(samples.time):
            rows, moving = np.flatnonzero(samples.time == t), casters.moving(int(t))
            own = casting.Discs(places.points[rows], places.normals[rows], places.width[rows])
            self._by_time.append((rows, own, _in_cells(moving)))

    def fitted(self) -> Rig | None:
        axes = upper_half()
        terms = [self._term(axis, COARSE) for axis in axes]
        chosen: list[np.ndarray] = []
        start = misfit = self._weigh([])[1]
        for _ in range(MOST_LAMPS):
            kept = [self._term(one, COARSE) for one in chosen]
            scores = [self._weigh([*kept, term], PASSES // 2)[1] for term in terms]
            tried = self._bettered([*chosen, axes[int(np.argmin(scores))]], STEPS[:2], COARSE)
            weights, less = self._weigh([self._term(one, COARSE) for one in tried])
            if misfit - less < GAIN * start or min(weights) < WEAK * (1 + sum(weights)):
                break
            chosen, misfit = tried, less
        if not chosen:
            return None
        chosen = self._bettered(chosen, STEPS[1:], casting.CELL)
        weights, _ = self._weigh([self._term(one, casting.CELL) for one in chosen])
        while min(weights) < WEAK * (1 + sum(weights)):
            del chosen[int(np.argmin(weights))]
            if not chosen:
                return None
            weights, _ = self._weigh([self._term(one, casting.CELL) for one in chosen])
        return _level(1.0, [(one[0], one[1], one[2]) for one in chosen], weights)

    def _bettered(
        self, directions: list[np.ndarray], steps: Sequence[float], cell: float
    ) -> list[np.ndarray]:
        """Each direction in turn moved to where the misfit is least, in ever smaller steps."""
        terms = [self._term(one, cell) for one in directions]
        least = self._weigh(terms)[1]
        for step in steps:
            for number in range(len(directions)):
                for turned in around(directions[number], step):
                    tried = list(terms)
                    tried[number] = self._term(turned, cell)
                    misfit = self._weigh(tried)[1]
                    if misfit < least:
                        least, terms, directions[number] = misfit, tried, turned
        return directions

    def _term(self, direction: np.ndarray, cell: float) -> Float32[np.ndarray, "n"]:
        """What a lamp in that direction gives each sample, were its strength 1."""
        places = self._samples.places
        out = np.maximum(places.normals @ direction.astype(np.float32), 0)
        resting = casting.light_map(self._resting[cell], direction, cell)
        for rows, own, moving in self._by_time:
            out[rows] *= casting.light_map(moving[cell], direction, cell, resting).reached(own)
        return out

    def _weigh(self, terms: list[np.ndarray], passes: int = PASSES) -> tuple[list[float], float]:
        """Strengths over the ambient light, and the misfit: robust Gauss-Newton in log brightness, things' albedos
        free."""
        samples = self._samples
        count = samples.owner.max() + 1
        basis = np.stack(terms, 1).astype(float) if terms else np.zeros((len(samples.level), 0))
        weights = np.full(len(terms), 0.7)
        trust = np.ones(len(samples.level))

        def centred(value):
            return _centred(value, samples.owner, count, trust)

        for _ in range(passes):
            light = 1 + basis @ weights
            off = centred(samples.level - np.log(light))
            trust = 1 / (1 + (off / SPREAD) ** 2)
            off = centred(samples.level - np.log(light))
            if not terms:
                continue
            slope = np.stack([centred(one / light) for one in basis.T], 1)
            normal = slope.T @ (trust[:, None] * slope) + 1e-6 * np.eye(len(terms))
            weights = np.clip(weights + np.linalg.solve(normal, slope.T @ (trust * off)), 0.0, 20.0)
        off = centred(samples.level - np.log(1 + basis @ weights))
        return weights.tolist(), float(np.log1p((off / SPREAD) ** 2).mean())


def _in_cells(discs: casting.Discs) -> dict[float, casting.Discs]:
    """Discs for maps of fine and of coarse cells."""
    return {casting.CELL: discs, COARSE: casting.thinned(discs, COARSE)}


@kernel
def _centred(
    value: Float64[np.ndarray, "n"],
    owner: Int64[np.ndarray, "n"],
    count: int,
    trust: Float64[np.ndarray, "n"],
) -> Float64[np.ndarray, "n"]:
    """Values less the weighted mean of those with the same owner."""
    total, weight = np.zeros(count), np.zeros(count)
    for n in range(len(value)):
        total[owner[n]] += trust[n] * value[n]
        weight[owner[n]] += trust[n]
    out = np.empty(len(value))
    for n in range(len(value)):
        out[n] = value[n] - total[owner[n]] / weight[owner[n]]
    return out


def around(direction: np.ndarray, step: float) -> list[np.ndarray]:
    """Directions a step away, to eight sides, above the horizon."""
    across = casting.crossed(direction, np.eye(3)[np.abs(direction).argmin()])
    across /= np.linalg.norm(across)
    beside = casting.crossed(direction, across)
    turns = np.pi / 4 * np.arange(8)
    found = [
        direction + np.tan(step) * (np.cos(turn) * across + np.sin(turn) * beside) for turn in turns
    ]
    return [one / np.linalg.norm(one) for one in found if one[2] > 0.1]


def upper_half() -> Float64[np.ndarray, "n 3"]:
    """Directions spread evenly over the upper half space, none too low (a Fibonacci lattice)."""
    number = np.arange(DIRECTIONS) + 0.5
    z = LOWEST + (1 - LOWEST) * number / DIRECTIONS
    turn = np.pi * (1 + 5**0.5) * number
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], -1)
