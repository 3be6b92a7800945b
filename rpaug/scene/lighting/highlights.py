"""Highlights: what surfaces mirror of the lamps, told by places that look different from elsewhere.

A matte surface looks the same from everywhere. What a place has more of in one camera than in another is mirrored
light: strength x sum over lamps of (normal . halfway)^exponent, halfway between the lamp and the eye (Blinn 1977),
added to what is matte (dichromatic model, Shafer 1985). Albedo and pattern cancel in the difference, so that lamps,
strengths and exponent come out of it alone; then each thing has its own color of mirrored light, white on dielectrics
and its own on metals, and its own exponent.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64, Int, Int32, UInt8

from rpaug.core import geometry, memo
from rpaug.core.image_cache import held
from rpaug.core.types import CameraView, Episode, Scene
from rpaug.scene.lighting import casting, rig
from rpaug.scene.lighting.two_views import SeenTwice, exposed, seen_twice

ALIKE = 0.03  # of white, by which a matte place looks different from elsewhere at most
OFTEN = 0.15  # of all places: from so many that do look different, highlights are sought
FEW = 100  # places that tell of an episode
MANY = 3000  # places, of which lamps are told
TELLING = 20  # places that tell of a thing
EXPLAINED = 0.5  # of what cameras' exposures leave different: lamps that explain less are not those mirrored
GAIN = 0.02  # of the misfit: what a lamp takes away at least
MOST_LAMPS = 3
EXPONENTS = (8.0, 16.0, 32.0, 64.0, 128.0)
OWN = (1.0, 0.25, 0.5, 0.71, 0.84, 1.19, 1.41, 2.0, 4.0)  # of the common exponent, a thing's
BETTER = 0.9  # of its misfit under the common exponent, from which a thing has its own
STEPS: tuple[float, ...] = tuple(np.repeat(np.deg2rad([6.0, 3.0, 1.5, 0.75]), 2).tolist())
SPREAD = 0.02  # of white: misfits beyond are robbed of weight
PASSES = 4
COLORED = 0.2  # radians from white: a color that is told from it
DIM = 1e-3  # cosine of what faces away
MOST_BYTES = 64 << 20  # of images without highlights that are kept

Logs = tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "n"]]


@dataclass(frozen=True)
class Lamps:
    """Lamps far away that are mirrored, and how narrowly surfaces do so more often than not."""

    directions: tuple[tuple[float, float, float], ...]
    strengths: tuple[float, ...]
    exponent: float

    def mirrored(
        self,
        normals: Float32[np.ndarray, "n 3"],
        towards: Float32[np.ndarray, "n 3"],
        exponent: float,
        reached: Sequence[Float32[np.ndarray, "n"] | float],
    ) -> Float32[np.ndarray, "n"]:
        """What surfaces mirror towards an eye, where each lamp reaches so much of them."""
        out = np.zeros(len(normals), np.float32)
        for direction, strength, share in zip(
            self.directions, self.strengths, reached, strict=True
        ):
            logs = _log_halfway(normals, towards, np.array(direction, np.float32))
            out += np.float32(strength) * share * np.exp(np.float32(exponent) * logs)
        return out

    @property
    def strongest(self) -> casting.Direction:
        return self.directions[int(np.argmax(self.strengths))]


@dataclass(frozen=True)
class Finish:
    """How a thing shines: the color of what it mirrors, over the lamps' strengths, and how narrowly."""

    color: tuple[float, float, float]
    exponent: float


@dataclass(frozen=True)
class Highlights:
    """Mirrored lamps, the finish of each thing that tells its own, and the directions along which lamps cast shadows:
    none, or one for each. What a lamp does not reach does not mirror it."""

    lamps: Lamps
    finishes: Mapping[int, Finish]
    shadows: tuple[casting.Direction, ...] = ()

    def turned(self, heading: float, higher: float) -> "Highlights":
        """All lamps turned about the vertical, and each that many times as high above the horizon."""
        directions = rig.turned_directions(self.lamps.directions, heading, higher)
        return Highlights(replace(self.lamps, directions=directions), self.finishes)

    def plain(self) -> dict[str, Any]:
        """Lamps and finishes as plain values."""
        finishes = [
            [one, list(found.color), found.exponent] for one, found in self.finishes.items()
        ]
        directions = [list(one) for one in self.lamps.directions]
        strengths, exponent = list(self.lamps.strengths), self.lamps.exponent
        return {
            "directions": directions,
            "strengths": strengths,
            "exponent": exponent,
            "finishes": finishes,
        }

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> "Highlights":
        """From plain values."""
        directions = tuple((float(x), float(y), float(z)) for x, y, z in plain["directions"])
        lamps = Lamps(directions, tuple(map(float, plain["strengths"])), float(plain["exponent"]))
        told = plain["finishes"]
        return cls(lamps, {int(one): Finish((r, g, b), power) for one, (r, g, b), power in told})

    def on(
        self,
        normals: Float32[np.ndarray, "n 3"],
        towards: Float32[np.ndarray, "n 3"],
        ids: Int[np.ndarray, "n"],
        reached: Sequence[Float32[np.ndarray, "n"]] | None = None,
    ) -> Float32[np.ndarray, "n 3"]:
        """What surfaces show mirrored towards an eye, 0..1 and beyond; nan on things that tell nothing of it. Each
        lamp reaches so much of them, all if None."""
        out = np.full((len(normals), 3), np.nan, np.float32)
        for one in np.unique(ids).tolist():
            if one in self.finishes:
                rows, finish = np.flatnonzero(ids == one), self.finishes[one]
                every = [1.0] * len(self.lamps.directions)
                here = every if reached is None else [share[rows] for share in reached]
                shine = self.lamps.mirrored(normals[rows], towards[rows], finish.exponent, here)
                out[rows] = shine[:, None] * np.array(finish.color, np.float32)
        return out


def find(scene: Scene) -> Highlights | None:
    """The highlights of a recording; None where places look the same from everywhere, or too little tells.

    Never in photographs, whose cameras see colors each in its own way, nor where light beyond white is known, whose
    sources lay their pictures over highlights too.
    """
    return _find(rig.recorded(scene)).highlights


def told(scene: Scene) -> tuple[float, float]:
    """Of places, the share that looks different from elsewhere, and of that difference the share that the likeliest
    lamps explain, 0..1."""
    found = _find(rig.recorded(scene))
    return found.differ, found.explained


@dataclass(frozen=True)
class _Sought:
    """What `told` says, and the highlights if they are believed."""

    differ: float = 0.0
    explained: float = 0.0
    highlights: Highlights | None = None


@memo.last
def _find(scene: Scene) -> _Sought:
    episode = scene.episode
    if any(view.inferred or view.radiance is not None for view in episode.views.values()):
        return _Sought()
    places = seen_twice(episode, list(casting.known(episode)))
    if places is None or len(places.ids) < FEW:
        return _Sought()
    differ = float((np.abs(places.difference.mean(1)) > ALIKE).mean())
    if differ <= OFTEN:
        return _Sought(differ)
    seen = rig.find(scene)
    along = () if seen is None else seen.directions
    reached = _reached_places(scene, places, along)
    step = max(1, len(places.ids) // MANY)
    lamps, explained = _MirrorFitter(places.every(step), [one[::step] for one in reached]).fitted(
        along
    )
    if lamps is None or explained < EXPLAINED:
        return _Sought(differ, explained)
    return _Sought(differ, explained, Highlights(lamps, _finishes(places, lamps, reached), along))


def metallic(scene: Scene, instance_id: int, albedo: tuple[float, float, float]) -> bool:
    """Whether a thing mirrors lamps in its own color, as metals do: where it is told from white at all, and nearer to
    the thing's than halfway."""
    found = find(scene)
    finish = None if found is None else found.finishes.get(instance_id)
    if finish is None or max(finish.color) <= 0:
        return False
    white = (1.0, 1.0, 1.0)
    own, apart = _between(finish.color, albedo), _between(albedo, white)
    return apart > COLORED and own < apart / 2 and own < _between(finish.color, white)


def _between(one: tuple[float, float, float], other: tuple[float, float, float]) -> float:
    """The angle between two colors."""
    cosine = np.dot(one, other) / (np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.arccos(np.clip(cosine, -1, 1)))


def matte(scene: Scene) -> Episode:
    """The recorded episode as it would be if nothing shone; itself where no highlights are known."""
    return scene.episode if find(scene) is None else _matte(rig.recorded(scene))


@memo.last
def _matte(scene: Scene) -> Episode:
    @partial(held, most=MOST_BYTES)
    def rgb(name: str, t: int) -> UInt8[np.ndarray, "h w 3"]:
        view = scene.episode.views[name]
        rows = np.arange(view.camera.height * view.camera.width)
        ids, places = casting.discs_of(view, t, rows)
        mirrored = on(scene, view, t, places.points, places.normals, ids)
        assert mirrored is not None
        shine = 255 * np.nan_to_num(mirrored).reshape(view.camera.height, view.camera.width, 3)
        return np.clip(np.rint(view.rgb(t) - shine), 0, 255).astype(np.uint8)

    views = {
        name: replace(view, rgb=partial(rgb, name)) if view.depth and view.ids else view
        for name, view in scene.episode.views.items()
    }
    return replace(scene.episode, views=views)


def seen_by(scene: Scene, view: CameraView, t: int) -> Callable[..., Any] | None:
    """`on` for one image, None without highlights: where things lie need not be known then."""
    return None if find(scene) is None else partial(on, scene, view, t)


def on(
    scene: Scene,
    view: CameraView,
    t: int,
    points: Float32[np.ndarray, "n 3"],
    normals: Float32[np.ndarray, "n 3"],
    ids: Int[np.ndarray, "n"],
) -> Float32[np.ndarray, "n 3"] | None:
    """What a view shows mirrored on surfaces of the world, 0..1 and beyond; nan on things that tell nothing of it.
    None without highlights."""
    found = find(scene)
    if found is None:
        return None
    reached = None
    if found.shadows:
        reached = _reached(rig.recorded(scene), t, found.shadows, points, normals)
    towards = geometry.towards(points, view.camera.cam_to_world[t, :3, 3])
    return found.on(normals, towards, ids, reached)


def shown(
    scene: Scene,
    name: str,
    t: int,
    bare: UInt8[np.ndarray, "h w 3"],
    shine: Float32[np.ndarray, "h w 3"],
) -> UInt8[np.ndarray, "h w 3"]:
    """An image of `matte` surfaces with what they mirror (`across`); the recorded bits where they are as recorded."""
    kept = (bare == matte(scene).views[name].rgb(t)).all(-1, keepdims=True)
    shone = np.clip(np.rint(bare + shine), 0, 255).astype(np.uint8)
    return np.where(kept, scene.episode.views[name].rgb(t), shone)


def across(
    scene: Scene,
    name: str,
    t: int,
    depth: Float32[np.ndarray, "h w"],
    ids: Int32[np.ndarray, "h w"],
) -> Float32[np.ndarray, "h w 3"] | None:
    """What a camera that stands as it was recorded sees mirrored all over an image, 0..255 and beyond, 0 where nothing
    tells. None without highlights."""
    if find(scene) is None:
        return None
    view = scene.episode.views[name]
    places = casting.lifted(depth, ids, view.camera, t, np.arange(ids.size))
    mirrored = on(scene, view, t, places.points, places.normals, ids.reshape(-1))
    assert mirrored is not None
    return np.asarray(255 * np.nan_to_num(mirrored).reshape(*ids.shape, 3), np.float32)


def _reached_places(
    scene: Scene, places: SeenTwice, along: tuple[casting.Direction, ...]
) -> list[Float32[np.ndarray, "n"]]:
    """How much of each place each lamp reaches; all of it where none are known to cast shadows."""
    out = [np.ones(len(places.ids), np.float32) for _ in range(len(along) or MOST_LAMPS)]
    for t in np.unique(places.times).tolist() if along else ():
        rows = places.times == t
        here = _reached(scene, t, along, places.points[rows], places.normals[rows])
        for one, share in zip(out, here, strict=True):
            one[rows] = share
    return out


def _reached(
    scene: Scene,
    t: int,
    along: tuple[casting.Direction, ...],
    points: Float32[np.ndarray, "n 3"],
    normals: Float32[np.ndarray, "n 3"],
) -> list[Float32[np.ndarray, "n"]]:
    places = casting.Discs(points, normals, np.zeros(len(points), np.float32))
    return [one.reached(places) for one in casting.casters(scene).maps(t, along)]


def _log_halfway(
    normals: Float32[np.ndarray, "n 3"],
    towards: Float32[np.ndarray, "n 3"],
    direction: Float32[np.ndarray, "3"],
) -> Float32[np.ndarray, "n"]:
    """Log of the cosine between normals and the middle of eye and lamp; that of all but 0 where no lamp can reach."""
    middle = towards + direction
    length = np.sqrt((middle * middle).sum(1))
    cosine = (normals * middle).sum(1) / np.maximum(length, np.float32(1e-6))
    faces = normals @ direction > 0
    return np.log(np.where(faces, np.clip(cosine, DIM, 1), DIM)).astype(np.float32)


class _MirrorFitter:
    """Finds the lamps by which places look different, one after another; all things shine alike here."""

    def __init__(self, places: SeenTwice, reached: Sequence[Float32[np.ndarray, "n"]]) -> None:
        self._places = places
        self._reached = reached
        self._value = places.difference.mean(1).astype(float)
        self._eyes = _eyes(places)

    def fitted(self, along: tuple[casting.Direction, ...] = ()) -> tuple[Lamps | None, float]:
        """The lamps, and the share that they explain of what looks different however long each camera exposes, 0..1.

        Lamps that cast shadows `along` some directions are those that are mirrored.
        """
        if along:
            lamps, exponent, strengths, _ = self._known([np.array(one) for one in along])
        else:
            lamps, exponent, strengths = self._sought()
        if not lamps:
            return None, 0.0
        terms = self._terms([self._logs(one) for one in lamps], exponent)
        off = np.abs(self._value - np.stack(terms, 1) @ strengths)
        left = off.sum() / max(np.abs(exposed(self._places)).sum(), 1e-9)
        directions = tuple((float(x), float(y), float(z)) for x, y, z in np.round(lamps, 5))
        found = Lamps(directions, tuple(np.round(strengths, 5).tolist()), round(exponent, 3))
        return found, max(1 - float(left), 0.0)

    def _known(
        self, lamps: list[np.ndarray]
    ) -> tuple[list[np.ndarray], float, Float64[np.ndarray, "k"], float]:
        logs = [self._logs(one) for one in lamps]
        misfits = [self._weigh(self._terms(logs, power))[1] for power in EXPONENTS]
        return self._bettered(lamps, EXPONENTS[int(np.argmin(misfits))])

    def _sought(self) -> tuple[list[np.ndarray], float, Float64[np.ndarray, "k"]]:
        axes = rig.upper_half()
        every = [self._logs(axis) for axis in axes]
        lamps: list[np.ndarray] = []
        exponent, strengths = 0.0, np.zeros(0)
        start = misfit = self._weigh([])[1]
        while len(lamps) < MOST_LAMPS:
            kept = [self._logs(one) for one in lamps]
            tried = [
                (self._weigh(self._terms([*kept, more], power), 2)[1], k, power)
                for power in ((exponent,) if lamps else EXPONENTS)
                for k, more in enumerate(every)
            ]
            _, best, power = min(tried)
            found, power, weights, less = self._bettered([*lamps, axes[best]], power)
            if misfit - less < GAIN * start:
                break
            lamps, exponent, strengths, misfit = found, power, weights, less
        return lamps, exponent, strengths

    def _bettered(
        self, directions: Sequence[np.ndarray], exponent: float
    ) -> tuple[list[np.ndarray], float, Float64[np.ndarray, "k"], float]:
        """Exponent and each direction in turn moved to where the misfit is least, in ever smaller steps."""
        lamps = list(directions)
        logs = [self._logs(one) for one in lamps]
        weights, least = self._weigh(self._terms(logs, exponent))
        for step in STEPS:
            for power in (exponent * (1 + 4 * step), exponent / (1 + 4 * step)):
                found, misfit = self._weigh(self._terms(logs, power))
                if misfit < least:
                    weights, least, exponent = found, misfit, power
            for number in range(len(lamps)):
                for turned in rig.around(lamps[number], step):
                    tried = list(logs)
                    tried[number] = self._logs(turned)
                    found, misfit = self._weigh(self._terms(tried, exponent))
                    if misfit < least:
                        weights, least, logs, lamps[number] = found, misfit, tried, turned
        return lamps, exponent, weights, least

    def _terms(self, logs: Sequence[Logs], exponent: float) -> list[Float32[np.ndarray, "n"]]:
        """How much more the first eye sees mirrored of each lamp, were its strength 1."""
        return [
            share * _more(one, exponent)
            for share, one in zip(self._reached[: len(logs)], logs, strict=True)
        ]

    def _logs(self, direction: Float64[np.ndarray, "3"]) -> Logs:
        lamp, normals = direction.astype(np.float32), self._places.normals
        first, second = (_log_halfway(normals, eye, lamp) for eye in self._eyes)
        return first, second

    def _weigh(
        self, terms: Sequence[np.ndarray], passes: int = PASSES
    ) -> tuple[Float64[np.ndarray, "k"], float]:
        """Strengths, none below 0, and the misfit: robust least squares."""
        basis = np.stack(terms, 1).astype(float) if terms else np.zeros((len(self._value), 0))
        trust, weights = np.ones(len(self._value)), np.zeros(len(terms))
        for _ in range(passes):
            weighted = trust[:, None] * basis
            normal = basis.T @ weighted + 1e-9 * np.eye(len(terms))
            weights = _not_negative(normal, weighted.T @ self._value)
            trust = 1 / (1 + ((self._value - basis @ weights) / SPREAD) ** 2)
        return weights, float(-np.log(trust).mean())


def _eyes(places: SeenTwice) -> tuple[np.ndarray, np.ndarray]:
    """Directions to both eyes."""
    return geometry.towards(places.points, places.first), geometry.towards(
        places.points, places.second
    )


def _more(logs: Logs, exponent: float) -> Float32[np.ndarray, "n"]:
    """How much more the first eye sees mirrored of a lamp of strength 1 than the second, where it reaches."""
    power = np.float32(exponent)
    return np.asarray(np.exp(power * logs[0]) - np.exp(power * logs[1]), np.float32)


def _finishes(
    places: SeenTwice, lamps: Lamps, reached: Sequence[Float32[np.ndarray, "n"]]
) -> dict[int, Finish]:
    """The finish of each thing of which enough places tell: the common exponent unless its own is clearly better."""
    finishes = {}
    for one in np.unique(places.ids).tolist():
        rows = np.flatnonzero(places.ids == one)
        if len(rows) < TELLING:
            continue
        first, second = (eye[rows] for eye in _eyes(places))
        shares = [share[rows] for share in reached[: len(lamps.directions)]]
        told = []
        for exponent in (lamps.exponent * factor for factor in OWN):
            here, there = (
                lamps.mirrored(places.normals[rows], eye, exponent, shares)
                for eye in (first, second)
            )
            color, misfit = _color(places.difference[rows], here - there)
            told.append((misfit, Finish(color, round(exponent, 3))))
        best = min(told, key=lambda entry: entry[0])
        finishes[one] = best[1] if best[0] < BETTER * told[0][0] else told[0][1]
    return finishes


def _color(
    difference: Float32[np.ndarray, "n 3"], more: Float32[np.ndarray, "n"]
) -> tuple[tuple[float, float, float], float]:
    """The color of what one thing mirrors, none of its channels below 0, and the misfit: robust least squares."""
    trust, color = np.ones(len(more)), np.zeros(3)
    for _ in range(PASSES):
        total = max(float((trust * more * more).sum()), 1e-9)
        color = np.maximum((trust * more) @ difference / total, 0)
        off = np.abs(difference - more[:, None] * color).mean(1)
        trust = 1 / (1 + (off / SPREAD) ** 2)
    red, green, blue = np.round(color, 4).tolist()
    return (red, green, blue), float(-np.log(trust).mean())


def _not_negative(
    normal: Float64[np.ndarray, "k k"], right: Float64[np.ndarray, "k"]
) -> Float64[np.ndarray, "k"]:
    """The least squares of which no part is negative: the most negative is left out until none is."""
    use = np.ones(len(right), bool)
    out = np.zeros(len(right))
    while use.any():
        found = np.linalg.solve(normal[np.ix_(use, use)], right[use])
        if found.min() >= 0:
            out[use] = found
            break
        use[np.flatnonzero(use)[found.argmin()]] = False
    return out
