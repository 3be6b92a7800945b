"""All figures of one edited episode against its truth."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool

from rpaug.core import metrics, pixels
from rpaug.core.types import CameraView, Episode
from rpaug.scene.tracking import agreement
from rpaug.twin import Take

FAR = 0.02  # metres of depth error that count as another surface
MIXED = 2  # pixels an anti-aliased outline may mix colors over
STRIDE = 4  # every so many frames are compared across cameras, and by SSIM and color difference


@dataclass(frozen=True)
class Scores:
    """Higher is better for the first five, lower for the others; nan where there was nothing to measure.

    Errors are taken in the changed region: of cameras that were moved every pixel, of the others the
    instance ids that truly changed and whatever else truly looks different. `psnr_scaled` is taken after the
    one factor on the edit that suits the truth best: no image tells how bright an albedo is, so estimates
    are judged by it. `psnr_seen` leaves invented pixels out, of which `holes` is the share. `outside`
    counts pixels that the edit changes and that no true change reaches. `flicker` is the mean change of
    the error between two frames, in grey levels, where a fixed camera sees the same instance id.
    `reprojection` is the median distance between one camera's points and the surface another saw there.
    """

    psnr: float  # dB
    psnr_scaled: float  # dB
    psnr_seen: float  # dB
    ssim: float
    iou: float
    ciede2000: float
    holes: float  # share of pixels
    depth: float  # millimetres, median
    depth_far: float  # share of pixels
    outside: float  # pixels
    flicker: float  # grey levels
    reprojection: float  # millimetres, median
    seconds: float  # of CPU, for the whole episode

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """What is measured, in order."""
        return tuple(entry.name for entry in fields(cls))


HIGHER = frozenset({"psnr", "psnr_scaled", "psnr_seen", "ssim", "iou"})


def regions(
    recorded: Take, true: Take, antialias: bool
) -> Iterator[tuple[str, int, Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]]:
    """Camera, frame, the changed region, and what an edit may touch (a little more if anti-aliased)."""
    for name, view in true.episode.views.items():
        for t in range(true.episode.length):
            if name in true.truth.bumps:
                inside = np.ones(view.rgb(t).shape[:2], bool)
            elif true.truth.bumps:
                inside = np.zeros(view.rgb(t).shape[:2], bool)
            else:
                assert view.ids is not None
                inside = np.isin(view.ids(t), true.truth.changed)
                inside |= (view.rgb(t) != recorded.episode.views[name].rgb(t)).any(-1)
            yield name, t, inside, pixels.grown(inside, MIXED if antialias else 0)


def measure(
    recorded: Take,
    edited: Episode,
    true: Take,
    holes: Mapping[str, Bool[np.ndarray, "h w"]],
    antialias: bool,
    seconds: float,
) -> Scores:
    """The figures of one episode, all cameras and frames pooled; `holes` are masks by camera/frame."""
    squares, alike, color, deep, flicker, invented = [], [], [], [], [], []
    products = np.zeros(3)  # edit x edit, edit x truth, truth x truth
    outside, masks = 0, []
    before: dict[str, _Seen] = {}
    for name, t, inside, reach in regions(recorded, true, antialias):
        mine, truly = edited.views[name], true.episode.views[name]
        image, goal = mine.rgb(t), truly.rgb(t)
        if name not in true.truth.bumps:
            outside += int(((image != recorded.episode.views[name].rgb(t)).any(-1) & ~reach).sum())
        off = image.astype(np.float64) - goal
        if truly.camera.fixed:
            assert truly.ids is not None
            now = off, truly.ids(t), inside
            if name in before:
                flicker.append(_change(before[name], now))
            before[name] = now
        if not inside.any():
            continue
        squares.append((off[inside] ** 2).mean(-1))
        products += _products(image[inside], goal[inside])
        invented.append(holes.get(f"{name}/{t}", np.zeros_like(inside))[inside])
        if t % STRIDE == 0:
            alike.append(metrics.ssim(image, goal)[inside])
            color.append(metrics.difference(image[inside], goal[inside]))
        deep.append(_depths(mine, truly, t)[inside])
        assert mine.ids is not None
        assert truly.ids is not None
        masks.append((mine.ids(t), truly.ids(t)))
    depth, square, hole = (np.concatenate(parts) for parts in (deep, squares, invented))
    return Scores(
        psnr=metrics.psnr(float(square.mean())),
        psnr_scaled=metrics.psnr(_scaled(products) / (3 * len(square))),
        psnr_seen=metrics.psnr(float(square[~hole].mean())) if not hole.all() else float("nan"),
        holes=float(hole.mean()),
        ssim=_mean(alike),
        iou=metrics.mean_iou(masks),
        ciede2000=_mean(color),
        depth=float(1000 * np.median(depth)),
        depth_far=float((depth > FAR).mean()),
        outside=float(outside),
        flicker=_mean(flicker),
        reprojection=_across(edited),
        seconds=seconds,
    )


def _products(mine: np.ndarray, truly: np.ndarray) -> np.ndarray:
    a, b = mine.astype(np.float64), truly.astype(np.float64)
    return np.array([(a * a).sum(), (a * b).sum(), (b * b).sum()])


def _scaled(products: np.ndarray) -> float:
    """Least squared error of any multiple of the edit."""
    own, cross, goal = products
    return float(goal - cross**2 / max(own, 1.0))


_Seen = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Error, instance ids and changed region of one image."""


def _change(before: _Seen, now: _Seen) -> np.ndarray:
    (first, old, was), (second, new, inside) = before, now
    same = was & inside & (old == new)
    return np.abs(second[same] - first[same]).ravel()


def _depths(mine: CameraView, truly: CameraView, t: int) -> np.ndarray:
    assert mine.depth is not None
    assert truly.depth is not None
    return np.abs(mine.depth(t).astype(np.float64) - truly.depth(t))


def _across(episode: Episode) -> float:
    """Median over pairs of neighbouring cameras and some frames, in millimetres."""
    views = list(episode.views.values())
    found = []
    for first, second in zip(views, views[1:] + views[:1], strict=True):
        for t in range(0, episode.length, STRIDE):
            assert first.depth is not None
            assert second.depth is not None
            assert first.ids is not None
            assert second.ids is not None
            depths, ids = (first.depth(t), second.depth(t)), (first.ids(t), second.ids(t))
            found.append(agreement.reprojection(depths, ids, (first.camera, second.camera), t))
    return 1000 * float(np.median(np.concatenate(found)))


def _mean(parts: list[np.ndarray]) -> float:
    values = np.concatenate(parts) if parts else np.empty(0)
    return float(values.mean()) if len(values) else float("nan")
