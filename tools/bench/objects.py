"""Removed, resized and inserted things against the twin's true re-recording of the same motion.

    python tools/bench/objects.py --what remove --seeds 3 --json remove.json --pictures looked-at
    python tools/bench/objects.py --what remove --seeds 3 --tier 3 --scenes fitted

remove: dB and depth where the thing was, where some camera saw the background at any time and where none did,
beside direct deletion (holes stay black) and inpainting each picture by itself; with --tier 3 also as fitted Gaussians
show it, all cameras and the fixed ones alone, beside deleting its Gaussians and nothing more. size: mask IoU, dB and
depth of the resized thing. insert: the same of a mesh that stands there, harmonised and not.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rpaug import twin
from rpaug.assets import library, sampled
from rpaug.compose import tuned, views
from rpaug.core import geometry, metrics
from rpaug.core.types import CameraView, Episode, Scene
from rpaug.operators.distractors import Distractors
from rpaug.operators.object_size import ObjectSize
from rpaug.operators.remove import Remove
from rpaug.pipeline import plan
from rpaug.providers import inpaint
from rpaug.scene import build
from rpaug.scene.targets.targets import Target

SAME_POINT = 0.004, 0.01  # metres and share of depth: a recorded pixel this close saw the point
EVERY = 4  # frames
TASKS = ("pick_block", "stack_cups", "put_in_box")
LOOSE = ("cylinder", "block_textured", "block_small", "block_plain")


@dataclass(frozen=True)
class Asked:
    """What is measured: so many seeds and frames, the painting, and the fit where Gaussians show it (tier 3)."""

    seeds: int
    look: twin.Look
    frames: int
    method: str
    tier: int
    steps: int
    scenes: Path | None
    pictures: Path | None

    def taken(self) -> Iterator[tuple[int, str, twin.Take]]:
        """Seed, task and recording."""
        for seed in range(self.seeds):
            task = TASKS[seed % len(TASKS)]
            yield seed, task, self.perform(task, seed)

    def perform(self, task: str, seed: int, **changed: Any) -> twin.Take:
        return twin.perform(task, seed, look=self.look, frames=self.frames, **changed)


@dataclass
class Pool:
    """Errors of pixels, gathered over images."""

    squares: list[np.ndarray] = field(default_factory=list)
    depths: list[np.ndarray] = field(default_factory=list)

    def add(
        self, rgb: np.ndarray, depth: np.ndarray, true: CameraView, t: int, where: np.ndarray
    ) -> None:
        off = rgb[where].astype(np.float64) - true.rgb(t)[where]
        self.squares.append((off**2).mean(-1))
        self.depths.append(np.abs(depth.astype(np.float64) - true.depth(t))[where])

    def row(self) -> dict[str, float]:
        square, depth = np.concatenate(self.squares), np.concatenate(self.depths)
        if not len(square):
            return {"pixels": 0, "psnr": np.nan, "depth_mm": np.nan}
        return {
            "pixels": len(square),
            "psnr": round(metrics.psnr(float(square.mean())), 2),
            "depth_mm": round(1000 * float(np.median(depth)), 3),
        }


def seen_before(episode: Episode, true: CameraView, t: int, gone: set[int]) -> np.ndarray:
    """Which pixels of the true view show a static point that some camera recorded at some time."""
    points = geometry.world_points(true.depth(t).astype(np.float64), true.camera, t)
    ids = true.ids(t)
    seen = np.zeros(ids.shape, bool)
    for view in episode.views.values():
        for when in {t, *range(0, episode.length, EVERY)}:
            pixel, z = geometry.project(points, view.camera, when)
            columns, rows = np.rint(np.nan_to_num(pixel)).astype(int).transpose(2, 0, 1)
            inside = (z > 0) & (columns >= 0) & (rows >= 0)
            inside &= (columns < view.camera.width) & (rows < view.camera.height)
            rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
            near = np.abs(view.depth(when)[rows, columns] - z) < SAME_POINT[0] + SAME_POINT[1] * z
            seen |= inside & near & (view.ids(when)[rows, columns] == ids)
    return seen & ~np.isin(ids, list(gone))


def remove(asked: Asked) -> Iterator[dict]:
    for seed, task, recorded in asked.taken():
        name = next(
            n
            for n in LOOSE[seed % len(LOOSE) :] + LOOSE
            if n in recorded.truth.handles and n != recorded.truth.manipulated
        )
        instance_id = recorded.truth.handles[name]
        true = asked.perform(task, seed, factor="removal", target=name).episode
        start = time.process_time()
        scene = build.build(recorded.episode, with_bodies=True)
        operator = Remove(target=Target(handle=instance_id), inpaint=asked.method)
        edit = operator.sample(scene, np.random.default_rng(0))
        held: dict[str, np.ndarray] = {}
        made = _rendered(operator.apply(scene, edit), held)
        shown = {"rpaug": made}
        if asked.tier >= 3:
            fitted = _fitted(scene, asked)
            shown |= _by_gaussians(operator.apply(fitted, edit))
        pools: dict[tuple[str, str], Pool] = {}
        rest = 0
        for camera, view in true.views.items():
            before = recorded.episode.views[camera]
            for t in range(0, asked.frames, EVERY):
                was = before.ids(t) == instance_id
                changed = (made.views[camera].rgb(t) != before.rgb(t)).any(-1)
                rest += int((changed & ~was & ~(before.rgb(t) != view.rgb(t)).any(-1)).sum())
                if not was.any():
                    continue
                known = seen_before(recorded.episode, view, t, {instance_id})
                ways = {
                    way: (one.views[camera].rgb(t), one.views[camera].depth(t))
                    for way, one in shown.items()
                } | {
                    "direct deletion": _deleted(made.views[camera], t, held[f"{camera}/{t}"] & was),
                    "inpainting each picture": _painted(before, t, was),
                }
                regions = {"seen": was & known, "never seen": was & ~known, "all": was}
                if asked.tier >= 3 and view.camera.fixed:
                    regions |= {"seen, fixed cameras": was & known}
                for way, (rgb, depth) in ways.items():
                    for kind, where in regions.items():
                        pools.setdefault((way, kind), Pool()).add(rgb, depth, view, t, where)
                if asked.pictures and t == EVERY:
                    images = [before.rgb(t), view.rgb(t), *(rgb for rgb, _ in ways.values())]
                    _draw(asked.pictures / f"remove-{seed}-{camera}.png", images, was)
        seconds = time.process_time() - start
        for (way, kind), pool in pools.items():
            row = {"what": "remove", "seed": seed, "task": task, "part": name}
            row |= {"method": way, "where": kind} | pool.row()
            yield row | {
                "other_pixels": rest if way == "rpaug" else 0,
                "seconds": round(seconds, 1),
            }


def _fitted(scene: Scene, asked: Asked) -> Scene:
    """The scene with Gaussians, kept in the folder for the next run."""
    from rpaug.gaussians import cached
    from rpaug.gaussians.descent import settings_for

    return cached.fitted(scene, asked.scenes, settings=settings_for(steps=asked.steps))[0]


def _by_gaussians(after: Scene) -> dict[str, Episode]:
    """What Gaussians alone show of an edited scene, and what is left of them without anything in the hole."""
    from rpaug.gaussians import gaussian_view

    def deleted(name: str) -> CameraView:
        seen: Callable[[int], Any] = lambda t: gaussian_view.blended(after, name, t)  # noqa: E731
        view = after.episode.views[name]
        return replace(view, rgb=lambda t: seen(t)[0], depth=lambda t: seen(t)[1])

    whole = views.edited(after, dict.fromkeys(after.episode.views, 3), lambda *_: None)
    bare = {name: deleted(name) for name in after.episode.views}
    return {
        "rpaug, Gaussians": whole,
        "deleting Gaussians": replace(after.episode, views=bare),
    }


def _draw(path: Path, images: list[np.ndarray], was: np.ndarray) -> None:
    """The images side by side around what was there, enlarged."""
    import cv2

    rows, columns = np.nonzero(was)
    at = np.s_[
        max(0, rows.min() - 12) : rows.max() + 13, max(0, columns.min() - 12) : columns.max() + 13
    ]
    large = [np.kron(image[at], np.ones((6, 6, 1), np.uint8)) for image in images]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate(large, 1)[..., ::-1])


def _rendered(scene: Scene, holes: dict[str, np.ndarray]) -> Episode:
    """The episode an edited scene shows; its hole masks are kept by camera/frame."""
    settled = plan.settle(plan.Plan(0, dict.fromkeys(scene.episode.views, 0), True), scene)

    def watch(shown: views.RenderedFrame) -> None:
        if shown.hole is not None:
            holes[f"{shown.camera}/{shown.t}"] = shown.hole

    return views.edited(scene, settled.representations, watch)


def _deleted(view: CameraView, t: int, hole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.where(hole[..., None], 0, view.rgb(t)).astype(np.uint8), np.where(
        hole, 0, view.depth(t)
    )


def _painted(view: CameraView, t: int, hole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    import cv2

    fine = np.clip(view.depth(t) * 8000, 0, 65535).astype(np.uint16)  # eighths of a millimetre
    depth = cv2.inpaint(fine, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA) / 8000
    return inpaint.paint("fsr", view.rgb(t), hole), depth


def size(asked: Asked) -> Iterator[dict]:
    """Things that stand around, what receives, and what is moved, within what its grasp bears."""
    for seed, task, recorded in asked.taken():
        truth = recorded.truth
        loose = next(
            n
            for n in LOOSE[seed % len(LOOSE) :] + LOOSE
            if n in truth.handles and n != truth.manipulated
        )
        drawn = np.random.default_rng(seed)
        wanted = {loose: drawn.uniform(0.75, 1.25), truth.manipulated: drawn.uniform(0.93, 1.07)}
        for name, scale in wanted.items():
            scale, instance_id = float(scale), truth.handles[name]
            true = asked.perform(task, seed, factor="object_size", target=name, value=scale)
            start = time.process_time()
            scene = build.build(recorded.episode, with_bodies=True)
            operator = ObjectSize(
                target=Target(handle=instance_id), range=(scale, scale), contact=0.02
            )
            made = _rendered(
                operator.apply(scene, operator.sample(scene, np.random.default_rng(0))), {}
            )
            pool, fixed, every = Pool(), [], []
            for camera, view in true.episode.views.items():
                for t in range(0, asked.frames, EVERY):
                    mine, goal = (
                        made.views[camera].ids(t) == instance_id,
                        view.ids(t) == instance_id,
                    )
                    pool.add(
                        made.views[camera].rgb(t), made.views[camera].depth(t), view, t, mine & goal
                    )
                    every.append(((mine & goal).sum(), (mine | goal).sum()))
                    if view.camera.fixed:
                        fixed.append(every[-1])
            iou, iou_fixed = (
                round(float(np.divide(*np.sum(pairs, 0))), 4) for pairs in (every, fixed)
            )
            yield (
                {
                    "what": "size",
                    "seed": seed,
                    "task": task,
                    "part": name,
                    "scale": round(scale, 3),
                    "iou": iou,
                    "iou_fixed": iou_fixed,
                }
                | pool.row()
                | {"seconds": round(time.process_time() - start, 1)}
            )


def insert(asked: Asked) -> Iterator[dict]:
    for seed, task, recorded in asked.taken():
        scene = build.build(recorded.episode, with_bodies=True)
        operator = Distractors(count=3)
        start = time.process_time()
        edit = operator.sample(scene, np.random.default_rng(seed))
        extras = tuple(extra(thing) for thing in edit["things"])
        after = operator.apply(scene, edit)
        made = {
            "harmonised": _rendered(after, {}),
            "as it comes": _rendered(operator.apply(scene, edit | {"ambience": None}), {}),
        } | {way: _rendered(one, {}) for way, one in _as_gaussians(after).items()}
        true = asked.perform(task, seed, factor="distractor", value=extras)
        for way, episode in made.items():
            for extra in extras:
                pool, pairs = Pool(), []
                for camera, view in true.episode.views.items():
                    for t in range(0, asked.frames, EVERY):
                        mine, goal = (
                            episode.views[camera].ids(t) == extra.handle,
                            view.ids(t) == extra.handle,
                        )
                        pairs.append(((mine & goal).sum(), (mine | goal).sum()))
                        pool.add(
                            episode.views[camera].rgb(t),
                            episode.views[camera].depth(t),
                            view,
                            t,
                            mine & goal,
                        )
                iou = round(float(np.divide(*np.sum(pairs, 0))), 4)
                yield (
                    {
                        "what": "insert",
                        "seed": seed,
                        "task": task,
                        "part": extra.name,
                        "method": way,
                        "iou": iou,
                    }
                    | pool.row()
                    | {"seconds": round(time.process_time() - start, 1)}
                )


def _as_gaussians(scene: Scene) -> dict[str, Scene]:
    """The scene with its inserted meshes shown by Gaussians, tuned to its light: of which no more is known, as of a
    file of them, and of which the mesh is known."""
    ambience = scene.ambience
    assert ambience is not None
    bodies = tuple(
        body
        if body.mesh is None
        else replace(
            body, splats=tuned.tuned(sampled.gaussians(body.mesh), body.to_world[0], ambience)
        )
        for body in scene.bodies
    )
    known = tuple(replace(body, outlined=body.splats is not None) for body in bodies)
    return {
        "as Gaussians": replace(scene, bodies=bodies),
        "as Gaussians of a known mesh": replace(scene, bodies=known),
    }


def extra(thing: dict) -> twin.look.Extra:
    mesh = library.mesh(thing["asset"])
    return twin.look.Extra(
        name=f"{thing['asset']}-{thing['handle']}", handle=thing["handle"], points=mesh.points, normals=mesh.normals,
        uv=mesh.uv, faces=mesh.faces, image=mesh.image, pose=np.array(thing["pose"]),
    )  # fmt: skip


WHAT: dict[str, Callable[[Asked], Iterator[dict]]] = {
    "remove": remove,
    "size": size,
    "insert": insert,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--what", choices=WHAT, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=17)
    parser.add_argument("--method", default="fsr")
    parser.add_argument("--shadows", action="store_true")
    parser.add_argument("--tier", type=int, choices=(1, 3), default=1)
    parser.add_argument("--steps", type=int, default=600, help="of the fit, for --tier 3")
    parser.add_argument("--scenes", type=Path, help="where fitted scenes are kept")
    parser.add_argument("--pictures", type=Path, help="a folder for what was removed, to look at")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    asked = Asked(
        seeds=given.seeds, look=twin.Look(shadows=given.shadows), frames=given.frames, method=given.method,
        tier=given.tier, steps=given.steps, scenes=given.scenes, pictures=given.pictures,
    )  # fmt: skip
    rows = []
    for row in WHAT[given.what](asked):
        rows.append(row)
        print("  ".join(f"{value}" for value in row.values()), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
