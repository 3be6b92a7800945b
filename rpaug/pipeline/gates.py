"""Gates: what an edited copy must measure up to before it is kept.

All figures are taken from rendered frames, beside the recorded ones. A figure is None where the edit leaves nothing to
measure; then its gate passes.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float64, Int32, UInt8
from pydantic import BaseModel, ConfigDict, Field

from rpaug.compose import views
from rpaug.core import color_space
from rpaug.core.pixels import differing, grown
from rpaug.core.types import Appearance, CameraView, Episode, Scene
from rpaug.scene.lighting import albedo
from rpaug.scene.tracking import agreement

MOMENTS = 8  # pairs of neighbouring frames that flicker and agreement are measured at
STILL = 1e-3  # metres of depth up to which a pixel shows the same place in the next frame
ADVANCE = 0.5  # pixels to the next frame from which a thing moves: what it covers anew over its area's root
WORST = 0.1  # of the pixels of what moves: those of the frames in which most of it is invented
CURE = ": that share of what moves is invented, nobody recorded it from there; the robot's file shows it (arms: [FILE])"
CURES = {"moving": CURE, "torn": CURE}
FAINT = 0.02  # brightest channel below which no hue can be told
DARKER = 4.0  # times as a paint may be than the recorded light makes it: shading decides, but no blue drawer is black


def _limit(default: float, words: str) -> Any:
    return Field(default=default, description=words)


Limit = Annotated[float, Field(ge=0)] | None


class Gates(BaseModel):
    """Limits a copy must keep, None for none, and how many draws it gets to do so.

    The `self_check` (`rpaug.pipeline.self_check`) holds roles against the recording before anything is rendered.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    tries: Annotated[int, Field(ge=1, le=100, strict=True)] = _limit(
        3, "How often a copy is drawn, at most, until it keeps the limits."
    )
    outside: Annotated[int, Field(ge=0)] | None = _limit(0, "Changed pixels where no edit reaches.")
    reprojection: Limit = _limit(
        5.0, "Millimetres, the median, between one camera's points and the next one's surface."
    )
    holes: Limit = _limit(0.15, "Share of invented pixels in a moved camera.")
    moving: Limit = _limit(0.1, "Share of invented pixels among those of what moves.")
    torn: Limit = _limit(0.2, "The same in the frames that have most of them.")
    flicker: Limit = _limit(2.0, "Grey levels by which pixels at rest change more than recorded.")
    color: Limit = _limit(
        5.0, "CIEDE2000 between the color that a thing was to take and what it shows."
    )
    self_check: bool = True

    @property
    def limits(self) -> frozenset[str]:
        """The figures that are measured: those with a limit."""
        return frozenset(one.name for one in fields(Figures) if getattr(self, one.name) is not None)

    def faults(self, figures: "Figures") -> list[str]:
        """Which limits the figures exceed, in words."""
        found = []
        for name, value in asdict(figures).items():
            limit = getattr(self, name)
            if value is not None and limit is not None and value > limit:
                found.append(f"{name} {value:.4g}, at most {limit:g}{CURES.get(name, '')}")
        return found


UNASKED = Gates(outside=None, reprojection=None, flicker=None, color=None)
"""What a recipe that moves cameras is held to where it has no gates of its own: most of what is shown was recorded."""


@dataclass(frozen=True)
class Figures:
    """What one copy measures; None where there is nothing to measure, or no limit.

    `outside` counts changed pixels, over all frames of cameras shown by their recorded pixels, where no edit reaches.
    `reprojection` is the median distance in millimetres between the points of one camera and the surface the next one
    sees there. `holes` is the share of invented pixels in the moved camera that has most, `moving` the share of them
    among the pixels that show the robot and what else moves, over all frames, and `torn` the same over the frames in
    which it is largest, down to a tenth of those pixels. `flicker` is by how many
    grey levels more than in the recording fixed cameras' pixels change between two frames in which they show the
    same place. `color` is the CIEDE2000 difference between the color a thing was to take and the one it shows. Its
    brightness is shading's to decide, unless it is far darker than the light on the recorded thing would make it.
    """

    outside: int | None = None
    reprojection: float | None = None
    holes: float | None = None
    moving: float | None = None
    torn: float | None = None
    flicker: float | None = None
    color: float | None = None

    def describe(self) -> dict[str, float]:
        """What was measured, rounded."""
        return {k: round(v, 4) for k, v in asdict(self).items() if v is not None}


@runtime_checkable
class PlainPaint(Protocol):
    """An appearance that gives its instance ids one color in place of an old one, display sRGB 0..1."""

    @property
    def instance_ids(self) -> frozenset[int]: ...
    @property
    def old(self) -> tuple[float, float, float]: ...
    @property
    def asked(self) -> tuple[float, float, float]: ...


def measure(
    scene: Scene,
    made: Episode,
    representations: Mapping[str, int],
    outside: int,
    holes: Mapping[str, Bool[np.ndarray, "h w"]],
    moving: Mapping[tuple[str, int], tuple[int, int]],
    limits: Collection[str],
) -> Figures:
    """The figures of an edited scene and the episode it shows, those that have `limits`.

    `outside` was counted frame by frame (`beyond`); `holes` are masks by camera/frame, `moving` counts by camera and
    frame: of the pixels that show what moves, those that nobody recorded, and all. Sensor effects change every
    pixel anew in every frame: with them neither `outside` nor `flicker` can be told.
    """
    told = set(limits) - ({"outside", "flicker"} if scene.sensor else set())
    if not any(tier > 0 for tier in representations.values()):
        told -= {"reprojection"}
    ways: dict[str, Callable[[], float | None]] = {
        "outside": lambda: outside,
        "reprojection": lambda: agreement.median_mm(made.views.values(), _moments(made.length)),
        "holes": lambda: _holes(holes),
        "moving": lambda: _moving(moving),
        "torn": lambda: _moving(moving, WORST),
        "flicker": lambda: _flicker(scene, made),
        "color": lambda: _color(scene),
    }
    return Figures(**{name: way() for name, way in ways.items() if name in told})  # type: ignore[arg-type]


def beyond(
    scene: Scene,
    before: UInt8[np.ndarray, "h w 3"],
    after: UInt8[np.ndarray, "h w 3"],
    ids: Int32[np.ndarray, "h w"] | None,
) -> int:
    """Pixels of one recorded image that changed though no appearance edit reaches them.

    On the outlines of anti-aliased things an edit reaches one pixel further.
    """
    if scene.relit is not None:
        return 0  # a shadow may fall on anything
    instance_ids: set[int] = set()
    for edit in scene.appearance:
        if edit.instance_ids is None:
            return 0
        instance_ids |= edit.instance_ids
    reach = np.zeros(before.shape[:2], bool) if ids is None else np.isin(ids, list(instance_ids))
    if scene.antialiased:
        reach = grown(reach, 1)
    return int(np.count_nonzero(differing(before, after) & ~reach))


def _moments(length: int) -> list[int]:
    """Frames t, evenly spread, whose next frame is there too."""
    return sorted(set(np.linspace(0, length - 2, MOMENTS).round().astype(int).tolist()) - {-1})


def _holes(holes: Mapping[str, Bool[np.ndarray, "h w"]]) -> float | None:
    shares: dict[str, list[float]] = {}
    for key, mask in holes.items():
        shares.setdefault(key.rsplit("/", 1)[0], []).append(float(mask.mean()))
    return max((float(np.mean(found)) for found in shares.values()), default=None)


def _moving(counts: Mapping[tuple[str, int], tuple[int, int]], part: float = 1.0) -> float | None:
    """Of the worst camera, over the frames with the largest shares that hold this part of the pixels; None where
    nothing that moves is seen."""
    frames: dict[str, list[tuple[int, int]]] = {}
    for (camera, _), pair in counts.items():
        frames.setdefault(camera, []).append(pair)
    found = []
    for pairs in frames.values():
        unseen, all = np.array(sorted(pairs, key=lambda one: -one[0] / max(one[1], 1))).T.cumsum(1)
        if all[-1]:
            last = int(np.searchsorted(all, part * all[-1]))
            found.append(float(unseen[last] / all[last]))
    return max(found, default=None)


def _flicker(scene: Scene, made: Episode) -> float | None:
    """Mean over fixed cameras, moments and still pixels; where a camera stands as recorded, over edited pixels only."""
    edited, recorded = [], []
    for name, view in made.views.items():
        old = scene.episode.views[name]
        if not view.camera.fixed or view is old:
            continue
        for t in _moments(made.length):
            touched = differing(view.rgb(t), old.rgb(t)) | (view.camera is not old.camera)
            if touched.any():
                edited.append(_change(view, t, touched))
                recorded.append(_change(old, t, touched))
    if not sum(map(len, edited)) or not sum(map(len, recorded)):
        return None
    more = np.concatenate(edited).mean() - np.concatenate(recorded).mean()
    return max(0.0, float(more))


def _change(view: CameraView, t: int, touched: Bool[np.ndarray, "h w"]) -> Float64[np.ndarray, "n"]:
    """Grey levels from frame t to the next, of the `touched` pixels that are still."""
    where = touched & _still(view, t)
    return np.abs(view.rgb(t + 1)[where].astype(np.int16) - view.rgb(t)[where]).mean(-1)


def _still(view: CameraView, t: int) -> Bool[np.ndarray, "h w"]:
    """Pixels that show the same place of the same thing in frames t and t + 1.

    A ball's pattern rolls on in pixels whose id and depth stay: what advances is left out, where there is depth.
    """
    still = np.ones((view.camera.height, view.camera.width), bool)
    if view.ids is not None:
        still &= view.ids(t) == view.ids(t + 1)
    if view.depth is not None:
        nearer = view.depth(t) - view.depth(t + 1)
        still &= np.abs(nearer) < STILL
        if view.ids is not None:
            still &= ~np.isin(view.ids(t), _advancing(view.ids(t), view.ids(t + 1), nearer > STILL))
    return still


def _advancing(
    now: Int32[np.ndarray, "h w"], then: Int32[np.ndarray, "h w"], nearer: Bool[np.ndarray, "h w"]
) -> Int32[np.ndarray, "n"]:
    """Ids of what comes in front of something else; what is only uncovered lies farther than what hid it."""
    covered, counts = np.unique(then[(now != then) & nearer], return_counts=True)
    areas = np.array([(then == instance_id).sum() for instance_id in covered])
    return covered[counts > ADVANCE * np.sqrt(areas)]


def _color(scene: Scene) -> float | None:
    """The largest difference of any thing that was painted, in the recorded views, without the edits after it."""
    found: list[float | None] = []
    lights: list[Appearance] = []
    lit = _shown(scene, lights)
    for number, edit in enumerate(scene.appearance):
        if edit.instance_ids is None:
            lights.append(edit)
            lit = _shown(scene, lights)
        earlier = scene.appearance[:number]
        paint: Appearance | None = edit
        while isinstance(paint, PlainPaint):
            beneath = getattr(paint, "beneath", None)
            shown, before = _shown(scene, (*earlier, paint)), None
            if getattr(paint, "part", ()):
                before = _shown(scene, earlier if beneath is None else (*earlier, beneath))
            found += [_difference(shown, before, lit, one, paint) for one in paint.instance_ids]
            paint = beneath
    return max((value for value in found if value is not None), default=None)


def _shown(scene: Scene, appearance: Sequence[Appearance]) -> Episode:
    """The recorded episode under some appearance edits; frames that were asked for are kept."""
    plain = replace(
        scene,
        appearance=tuple(appearance),
        sensor=(),
        cameras={name: view.camera for name, view in scene.episode.views.items()},
        bodies=scene.tracked,
        recorded_bodies=None,
        relit=None,
    )
    shown = views.edited(plain, dict.fromkeys(scene.episode.views, 0), lambda *ignored: None)
    kept = {
        name: replace(view, rgb=cache(view.rgb), radiance=None)
        for name, view in shown.views.items()
    }
    return replace(shown, views=kept)


def _difference(
    shown: Episode, before: Episode | None, lit: Episode, instance_id: int, edit: PlainPaint
) -> float | None:
    """Of what differs from the episode before, of the whole instance if that is None. `lit` shows the old color."""
    seen, old = albedo.pixels(shown, instance_id), albedo.pixels(lit, instance_id)
    if before is not None:
        mine = (seen != albedo.pixels(before, instance_id)).any(1)
        seen, old = seen[mine], old[mine]
    if not len(seen):
        return None
    got, wanted = np.array(albedo.estimate(seen).rgb), np.array(edit.asked)
    if got.max() > FAINT:
        was = np.array(edit.old)
        light = float(was @ albedo.estimate(old).rgb / max(float(was @ was), 1e-6))
        brighter = min(wanted @ got / (got @ got), DARKER / max(light, 1e-6))
        got = np.clip(brighter * got, 0, 1)
    return float(color_space.ciede2000(color_space.to_lab(wanted), color_space.to_lab(got)))


def described(figures: Figures, faults: Iterable[str], attempt: int) -> dict[str, Any]:
    """What the report says: figures, limits exceeded, and the number of the draw, from 0."""
    faults = list(faults)
    return {
        "passed": not faults,
        "attempt": attempt,
        "figures": figures.describe(),
        "faults": faults,
    }
