"""Moved cameras drawn from surfels, against the twin's true re-recording from the moved cameras.

    python tools/bench/surfels.py --seeds 3 --json surfels.json

Prints PSNR in dB over all and over co-visible pixels, the depth error on co-visible pixels, the share of holes, and
the seconds of one thread per view, for surfels with ever more sources and beside the recorded image left as it was.
A pixel is co-visible if some recorded camera saw its point at that time, or at another time if it is static.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np

from rpaug.core.metrics import decibels
from rpaug.core.types import Body, CameraView, Scene
from rpaug.gaussians import gaussian_view
from rpaug.gaussians.descent import FitSettings, settings_for
from rpaug.gaussians.fit import fitted
from rpaug.pipeline.left_out import covisible
from rpaug.render import holes, zbuffer
from rpaug.render.zbuffer import Rendered
from rpaug.scene import build
from rpaug.scene.recorded import surfels
from rpaug.twin.look import Look
from rpaug.twin.record import Take, perform

HEADLIGHT = 0.25  # half as bright as each of the twin's lamps


@dataclass(frozen=True)
class Case:
    """One moved camera at one time: the recorded scene with that camera moved, and the truth."""

    scene: Scene
    kept: surfels.Surfels
    name: str
    t: int
    true: CameraView
    covisible: np.ndarray


def known_scene(take: Take) -> Scene:
    """The recorded scene with the bodies the twin knows: what follows is not blamed on tracking."""
    length = take.episode.length
    still = np.tile(np.eye(4), (length, 1, 1))
    moving = {name for name, track in take.poses.items() if (track != track[:1]).any()}
    moving |= {name for name in take.truth.bodies if name.startswith(("link", "hand", "finger"))}
    bodies = tuple(
        Body(frozenset(instance_ids), still, "unknown" if name in moving else "static")
        for name, instance_ids in take.truth.bodies.items()
    )
    cameras = {name: view.camera for name, view in take.episode.views.items()}
    return Scene(take.episode, cameras, bodies, {}, False, take.episode.descriptions)


def cases(
    task: str, seed: int, look: Look, frames: int, every: int, noise: float, tracked: bool
) -> Iterator[Case]:
    """Every bumped camera of one seed at every `every`-th frame."""
    recorded = perform(task, seed, look=look, frames=frames)
    moved = perform(task, seed, look=look, frames=frames, factor="camera_pose")
    exact = known_scene(recorded)
    scene = noisy(exact, noise, seed) if noise else exact
    if tracked:
        scene = replace(scene, bodies=build.build(scene.episode, with_bodies=True).bodies)
    kept, static = surfels.build(scene), surfels.build(exact).static
    for name in moved.truth.bumps:
        true = moved.episode.views[name]
        bumped = replace(scene, cameras={**scene.cameras, name: true.camera})
        for t in range(every // 2, frames, every):
            seen = covisible(exact, static, true, t)
            yield Case(bumped, kept, name, t, true, seen)


def noisy(scene: Scene, share: float, seed: int) -> Scene:
    """The scene with Gaussian noise on every depth, of standard deviation `share` of the depth."""

    def shaken(view: CameraView, salt: int) -> CameraView:
        assert view.depth is not None
        read = view.depth

        def depth(t: int) -> np.ndarray:
            drawn = np.random.default_rng([seed, salt, t]).standard_normal(read(t).shape)
            return (read(t) * (1 + share * drawn)).astype(np.float32)

        return replace(view, depth=depth)

    views = {name: shaken(view, k) for k, (name, view) in enumerate(scene.episode.views.items())}
    return replace(scene, episode=replace(scene.episode, views=views))


def unchanged(case: Case) -> Rendered:
    view = case.scene.episode.views[case.name]
    none = np.zeros(view.ids(case.t).shape, bool)
    rgb = (view.rgb(case.t) / 255).astype(np.float32)
    return Rendered(rgb, view.depth(case.t), view.ids(case.t), none.astype(np.int16), none, none)


def sources(case: Case, kept: surfels.Surfels, count: int | None, carve: bool = True) -> Rendered:
    found = list(surfels.sources(kept, case.scene, case.name, case.t))[:count]
    if not carve:
        found = [replace(source, carved=False) for source in found]
    camera = case.scene.cameras[case.name]
    size = (camera.width, camera.height)
    pose = camera.cam_to_world[case.t]
    drawn = zbuffer.render(camera.K, pose, size, found, witness=found[0], tolerance=kept.tolerance)
    return holes.fill(drawn)


def fitted_frame(scene: Scene, t: int, steps: int) -> Scene:
    """Gaussians fitted to what all cameras recorded at t alone."""

    def at(view: CameraView) -> CameraView:
        camera = replace(view.camera, cam_to_world=view.camera.cam_to_world[t : t + 1])
        rgb, depth, ids = view.rgb(t), view.depth(t), view.ids(t)
        return CameraView(camera, lambda _: rgb, lambda _: depth, lambda _: ids)

    views = {name: at(view) for name, view in scene.episode.views.items()}
    instance_ids = frozenset().union(*(np.unique(view.ids(0)).tolist() for view in views.values()))
    still = Scene(
        replace(scene.episode, views=views, length=1),
        {name: view.camera for name, view in views.items()},
        (Body(instance_ids, np.eye(4)[None], "static"),),
        {},
        False,
        (),
    )
    settings = FitSettings(steps=steps, threads=1, refine=False, checked_frames=1)
    return fitted(still, settings=settings)[0]


class PerFrame:
    """Gaussians optimised for the very moment; fitted once for all cameras of a moment."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.kept: surfels.Surfels | None = None  # of the recording that `done` belongs to
        self.done: dict[int, Scene] = {}

    def prepare(self, case: Case) -> Scene:
        if case.kept is not self.kept:
            self.kept, self.done = case.kept, {}
        if case.t not in self.done:
            self.done[case.t] = fitted_frame(case.scene, case.t, self.steps)
        return self.done[case.t]

    def __call__(self, case: Case) -> Rendered:
        camera = case.scene.cameras[case.name]
        now = replace(camera, cam_to_world=camera.cam_to_world[case.t : case.t + 1])
        there = replace(self.prepare(case), cameras={case.name: now})
        rgb, depth, ids = gaussian_view.render_view(there, case.name, 0)
        none = depth == 0
        return Rendered(
            (rgb / 255).astype(np.float32), depth, ids, -none.astype(np.int16), none, none
        )


class WholeEpisode:
    """Tier 3 as `rpaug fit` makes it: Gaussians fitted to all of an episode, on the bodies that the scene has."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self.kept: surfels.Surfels | None = None
        self.done: Scene | None = None

    def prepare(self, case: Case) -> None:
        if case.kept is not self.kept:
            settings = settings_for(steps=self.steps)
            self.kept, self.done = case.kept, fitted(case.scene, settings=settings)[0]

    def __call__(self, case: Case) -> Rendered:
        assert self.done is not None
        there = replace(self.done, cameras=case.scene.cameras)
        rgb, depth, ids = gaussian_view.render_view(there, case.name, case.t)
        none = depth == 0
        return Rendered(
            (rgb / 255).astype(np.float32), depth, ids, -none.astype(np.int16), none, none
        )


METHODS: dict[str, Callable[[Case], Rendered]] = {
    "recorded image unchanged": unchanged,
    "own camera": lambda c: sources(c, c.kept, 1),
    "all cameras now": lambda c: sources(c, c.kept, len(c.scene.cameras)),
    "all, plates, history, parts": lambda c: surfels.view(c.kept, c.scene, c.name, c.t),
    "the same, not carved": lambda c: sources(c, c.kept, None, carve=False),
}


def measure(method: Callable[[Case], Rendered], case: Case) -> dict[str, float]:
    if isinstance(method, PerFrame | WholeEpisode):
        method.prepare(case)
    start = time.thread_time()
    drawn = method(case)
    seconds = time.thread_time() - start
    squared = ((drawn.image.astype(float) - case.true.rgb(case.t)) ** 2).mean(-1) / 255**2
    error = np.abs(drawn.depth - case.true.depth(case.t))[case.covisible]
    return {
        "all": squared.mean(),
        "covisible": squared[case.covisible].mean(),
        "depth": float(np.median(error)),
        "far": float((error > 0.02).mean()),
        "holes": float(drawn.hole.mean()),
        "seconds": seconds,
    }


def summary(rows: list[dict[str, float]]) -> dict[str, float]:
    """Mean over views; PSNR of the mean squared error; the median of times and depth errors."""
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    return {
        "psnr_all_db": decibels(mean["all"]),
        "psnr_covisible_db": decibels(mean["covisible"]),
        "depth_median_mm": 1e3 * float(np.median([row["depth"] for row in rows])),
        "depth_over_20mm_percent": 100 * mean["far"],
        "holes_percent": 100 * mean["holes"],
        "milliseconds_per_view": 1e3 * float(np.median([row["seconds"] for row in rows])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="open_drawer")
    parser.add_argument(
        "--seeds", type=int, default=3, help="recordings, each with its own cameras"
    )
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--every", type=int, default=12, help="frames between the views compared")
    parser.add_argument("--noise", type=float, default=0.0, help="depth noise as a share of depth")
    parser.add_argument("--antialiased", action="store_true")
    parser.add_argument("--specular", action="store_true", help="and a lamp on every camera")
    parser.add_argument(
        "--tracked", action="store_true", help="bodies as rpaug tracks them, not as the twin knows"
    )
    parser.add_argument(
        "--gaussians", type=int, default=0, metavar="STEPS", help="also fit every frame by itself"
    )
    parser.add_argument(
        "--fit",
        type=int,
        default=0,
        metavar="STEPS",
        help="also fit the whole episode, once a seed",
    )
    parser.add_argument("--json", type=Path, help="write the table here too")
    given = parser.parse_args()
    numba.set_num_threads(1)
    look = Look(
        antialias=given.antialiased,
        specular=given.specular,
        headlight=HEADLIGHT if given.specular else 0.0,
    )
    methods = dict(METHODS)
    if given.gaussians:
        methods[f"Gaussians, {given.gaussians} steps a frame"] = PerFrame(given.gaussians)
    if given.fit:
        methods[f"Gaussians, {given.fit} steps an episode"] = WholeEpisode(given.fit)
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in methods}
    for seed in range(given.seeds):
        for case in cases(
            given.task, seed, look, given.frames, given.every, given.noise, given.tracked
        ):
            for name, method in methods.items():
                rows[name].append(measure(method, case))
    table = {name: summary(found) for name, found in rows.items()}
    if given.json:
        given.json.write_text(
            json.dumps({"views": len(rows["own camera"]), "table": table}, indent=1)
        )
    print(f"{len(rows['own camera'])} views")
    print(f"{'':30}all / co-visible dB   depth mm  >20 mm   holes   ms")
    for name, row in table.items():
        print(
            f"{name:30}{row['psnr_all_db']:5.1f} / {row['psnr_covisible_db']:4.1f}"
            f"{row['depth_median_mm']:17.3f}{row['depth_over_20mm_percent']:7.1f}%"
            f"{row['holes_percent']:7.1f}%{row['milliseconds_per_view']:6.1f}"
        )


if __name__ == "__main__":
    main()
