"""Stylising on the twin, beside vanilla NNFM (ARF on the whole scene) and beside itself without the outer term.

    python tools/bench/nnfm.py [--vgg FILE] [--seeds 3] [--style paint] [--sheet FOLDER] [--json]

Seeds take three tasks in turn; the manipulated thing is stylised. `--vgg` is a
state dict of VGG16; torchvision's in torch's cache if not given.
`match`: mean cosine distance to the nearest feature of the style, over the first and the last round of views; `outside
dB`: PSNR over the pixels that are not the target's, Gaussian renders against the recording (the fit alone shows what it
was before); `target dB`: the same over the target, which should have changed; `changed`: pixels that the composite
changes outside the mask; `two cameras`: median difference, in grey levels, of one place seen by two cameras, recorded
and edited; `CPU s`: of the stylising, the fit apart.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from rpaug import twin
from rpaug.assets.textures import shipped
from rpaug.core import geometry
from rpaug.core.files import encode_png, write_atomic
from rpaug.core.metrics import psnr
from rpaug.core.types import Episode, Scene
from rpaug.gaussians import fit, nnfm
from rpaug.gaussians.descent import FitSettings
from rpaug.gaussians.gaussian_view import SHARP, render_view, standing, view_of
from rpaug.gaussians.gaussians import SH0, Placement
from rpaug.operators.stylize import Stylised
from rpaug.pipeline.contracts import shown
from rpaug.providers import features
from rpaug.render.splat import Splats, rasterise
from rpaug.scene import build

TASKS = ("open_drawer", "slide_block", "stack_cups")
NEAR = 0.25  # of a pixel: how near two cameras' pixels must lie to count as one place


@dataclass(frozen=True)
class Row:
    """One method's figures on one seed."""

    seed: int
    task: str
    method: str
    match_first: float | None
    match_last: float | None
    outside_db: float
    target_db: float
    changed: int | None
    two_cameras_recorded: float | None
    two_cameras: float | None
    seconds: float


def vanilla(
    scene: Scene,
    views: list[tuple[str, int]],
    picture: np.ndarray,
    network: features.VGG16,
    settings: nnfm.StyleSettings,
    seed: int,
) -> tuple[Scene, list[float]]:
    """ARF as published, in every Gaussian's color: features of whole views, nothing held to the recording."""
    assert scene.gaussians is not None
    style = nnfm.style_of(network, picture, settings.picture)
    placement = Placement.of(scene.gaussians.ids, scene.bodies, scene.irradiance)
    splats = Splats.of(scene.gaussians)
    old = 0.5 + SH0 * scene.gaussians.sh[:, 0]
    free = torch.from_numpy(transferred(old, style.colors.numpy())).requires_grad_()
    adam = torch.optim.Adam([free], settings.rate)
    rng, order, losses = np.random.default_rng(seed), [], []
    for step in range(settings.steps):
        order = order or rng.permutation(len(views)).tolist()
        name, t = views[order.pop()]
        for group in adam.param_groups:
            group["lr"] = settings.rate * nnfm.cosine(step / settings.steps, settings.last_rate)
        placed = placement.place(splats, t)
        assert placed.quats is not None
        assert placed.scales is not None
        arrays = (placed.means, placed.opacities, placed.quats, placed.scales)
        means, opacities, quats, scales = map(torch.from_numpy, arrays)
        sh = ((free - 0.5) / SH0)[:, None]
        eye = view_of(standing(scene, name), t)
        image = rasterise(
            means, opacities, sh, eye, quats=quats, scales=scales, settings=SHARP
        ).color.permute(2, 0, 1)[None]
        found = network.features(nnfm.resized(image, settings.size), nnfm.LAYERS)
        seen = torch.cat([found[layer] for layer in nnfm.LAYERS], 1)[0].flatten(1)
        loss = nnfm.matching(seen, style.features)
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            free.clamp_(0, 1)
        losses.append(float(loss.detach()))
    sh = scene.gaussians.sh.copy()
    sh[:, 0] = (free.detach().numpy() - 0.5) / SH0
    return replace(scene, gaussians=replace(scene.gaussians, sh=sh)), losses


def transferred(old: np.ndarray, palette: np.ndarray) -> np.ndarray:
    """ARF's color transfer: an affine map that gives the colors the palette's mean and covariance."""

    def root(matrix: np.ndarray, power: float) -> np.ndarray:
        values, vectors = np.linalg.eigh(matrix)
        return (vectors * np.maximum(values, 1e-5) ** power) @ vectors.T

    linear = root(np.cov(palette.T), 0.5) @ root(np.cov(old.T), -0.5)
    return np.clip((old - old.mean(0)) @ linear.T + palette.mean(0), 0, 1).astype(np.float32)


def errors(
    scene: Scene, views: list[tuple[str, int]], instance_ids: frozenset[int]
) -> tuple[float, float]:
    """PSNR of Gaussian renders against the recording, outside and inside the target."""
    apart: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for name, t in views:
        view = scene.episode.views[name]
        assert view.ids is not None
        off = (render_view(scene, name, t)[0].astype(float) - view.rgb(t)) ** 2
        inside = np.isin(view.ids(t), list(instance_ids))
        apart[True].append(off[inside].ravel())
        apart[False].append(off[~inside].ravel())
    outside, inside = (np.concatenate(apart[which]).mean() for which in (False, True))
    return tuple(psnr(float(value)) for value in (outside, inside))  # type: ignore[return-value]


def agreement(
    before: Episode, after: Episode, views: list[tuple[str, int]], instance_ids: frozenset[int]
) -> tuple[float, float]:
    """Median difference of one place's color in two cameras, in grey levels: recorded, and edited."""
    recorded, edited = [], []
    for name, t in views:
        for other in before.views:
            if other == name:
                continue
            for first, second in pairs(before, name, other, t, instance_ids):
                for episode, kept in ((before, recorded), (after, edited)):
                    one = episode.views[name].rgb(t).reshape(-1, 3)[first].astype(float)
                    two = episode.views[other].rgb(t).reshape(-1, 3)[second].astype(float)
                    kept.append(np.abs(one - two).ravel())
    return float(np.median(np.concatenate(recorded))), float(np.median(np.concatenate(edited)))


def pairs(
    episode: Episode, name: str, other: str, t: int, instance_ids: frozenset[int]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Flat indices of pixels that show the same place of the target in two cameras."""
    one, two = episode.views[name], episode.views[other]
    assert one.depth is not None
    assert two.depth is not None
    assert one.ids is not None
    points = geometry.world_points(one.depth(t), one.camera, t).reshape(-1, 3)
    own = np.isin(one.ids(t).ravel(), list(instance_ids))
    at, _ = geometry.project(points, two.camera, t)
    place = np.rint(np.nan_to_num(at, nan=-1, posinf=-1, neginf=-1)).astype(int)
    size = two.camera.width, two.camera.height
    good = np.flatnonzero(own & ((place >= 0) & (place < size)).all(-1))
    there = geometry.world_points(two.depth(t), two.camera, t)
    column, row = place[good].T
    width = two.depth(t)[row, column] / two.camera.K[0, 0]
    near = np.linalg.norm(there[row, column] - points[good], axis=-1) < NEAR * width
    if near.any():
        yield good[near], (row * two.camera.width + column)[near]


def measure(
    seed: int, style: str, steps: int, network: features.VGG16, sheet: Path | None
) -> list[Row]:
    """All methods on one seed."""
    task = TASKS[seed % len(TASKS)]
    episode = twin.perform(task, seed, frames=20, size=128, look=twin.Look(shadows=True)).episode
    scene = build.build(episode, with_bodies=True)
    start = time.process_time()
    scene, _ = fit.fitted(scene, settings=FitSettings(steps=steps))
    rows: list[Row] = []
    instance_ids = scene.roles["manipulated"]
    picture = shipped.image(style)
    made: dict[str, Scene] = {}
    fitted = time.process_time() - start
    for method, settings in (
        ("rpaug", nnfm.StyleSettings()),
        ("no outer term", nnfm.StyleSettings(outside=0.0)),
    ):
        start = time.process_time()
        styled = nnfm.stylise(scene, instance_ids, picture, network, seed, settings)
        seconds = time.process_time() - start
        views = [(window.camera, window.t) for window in styled.windows]
        laid = Stylised(instance_ids, styled.old, styled.new)
        assert scene.gaussians is not None
        sh = scene.gaussians.sh.copy()
        sh[styled.rows, 0] = (styled.colors - 0.5) / SH0
        made[method] = replace(scene, gaussians=replace(scene.gaussians, sh=sh))
        after = shown(replace(scene, appearance=(laid,)))
        changed = sum(
            int(((after.views[n].rgb(t) != v.rgb(t)).any(-1) & ~np.isin(v.ids(t), list(instance_ids))).sum())
            for n, v in episode.views.items() for t in range(episode.length) if v.ids
        )  # fmt: skip
        losses = [loss.match for loss in styled.losses]
        rows.append(
            row(
                seed,
                task,
                method,
                losses,
                len(views),
                errors(made[method], views, instance_ids),
                changed,
                agreement(episode, after, views, instance_ids),
                seconds,
            )
        )
        if method == "rpaug" and sheet is not None:
            write_atomic(
                sheet / f"nnfm-{seed}-{task}.png", encode_png(contact(episode, after, views))
            )
    start = time.process_time()
    made["vanilla"], losses = vanilla(scene, views, picture, network, nnfm.StyleSettings(), seed)
    seconds = time.process_time() - start
    rows.append(
        row(
            seed,
            task,
            "vanilla NNFM",
            losses,
            len(views),
            errors(made["vanilla"], views, instance_ids),
            None,
            None,
            seconds,
        )
    )
    rows.append(
        row(
            seed,
            task,
            "the fit alone",
            None,
            0,
            errors(scene, views, instance_ids),
            None,
            None,
            fitted,
        )
    )
    return rows


def row(
    seed: int,
    task: str,
    method: str,
    losses: list[float] | None,
    views: int,
    db: tuple[float, float],
    changed: int | None,
    two: tuple[float, float] | None,
    seconds: float,
) -> Row:
    first, last = (
        (None, None) if losses is None else (np.mean(losses[:views]), np.mean(losses[-views:]))
    )
    return Row(seed, task, method, first and float(first), last and float(last), *db, changed,
               *(two or (None, None)), seconds)  # fmt: skip


def contact(before: Episode, after: Episode, views: list[tuple[str, int]]) -> np.ndarray:
    """Each view recorded and edited, twice as large."""
    columns = [np.vstack([e.views[name].rgb(t) for e in (before, after)]) for name, t in views]
    image = np.hstack(columns)
    return cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vgg", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--style", default="paint", choices=sorted(shipped.NAMES))
    parser.add_argument("--fit-steps", type=int, default=1500)
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    network = features.load(arguments.vgg)
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        rows += measure(seed, arguments.style, arguments.fit_steps, network, arguments.sheet)
    if arguments.json:
        print(json.dumps([asdict(one) for one in rows], indent=1))
        return
    print(f"{'seed':>4} {'task':12}{'method':14}{'match':>15}{'outside dB':>12}{'target dB':>11}"
          f"{'changed':>9}{'two cameras':>14}{'CPU s':>8}")  # fmt: skip
    for one in rows:
        match = f"{one.match_first:.3f} -> {one.match_last:.3f}" if one.match_first else ""
        two = (
            f"{one.two_cameras_recorded:.1f}, {one.two_cameras:.1f}"
            if one.two_cameras is not None
            else ""
        )
        changed = "" if one.changed is None else str(one.changed)
        print(f"{one.seed:>4} {one.task:12}{one.method:14}{match:>15}{one.outside_db:12.2f}{one.target_db:11.2f}"
              f"{changed:>9}{two:>14}{one.seconds:8.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
