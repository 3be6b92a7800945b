"""COLMAP itself, on videos rendered in the twin: a model where the camera walks, a refusal where it only looks."""

import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from rpaug import Camera, Unsupported
from rpaug.scene.video import colmap, world
from rpaug.twin import cameras, tabletop
from rpaug.twin.look import Look
from rpaug.twin.motion import play
from rpaug.twin.renderer import Renderer
from rpaug.twin.tasks import TASKS

SIZE, LENGTH = 224, 12
RULE = colmap.ColmapSettings(threads=1, features=800, overlap=6)


def filmed(track: np.ndarray) -> Callable[[int], np.ndarray]:
    """The twin's table at rest, seen from each pose of a track."""
    job = TASKS["open_drawer"](np.random.default_rng(0))
    motion = play(tabletop.ARM, job.script, job.placing, 16)
    scene = tabletop.build(job.placing, np.random.default_rng(1), 5, [])
    camera = Camera(cameras.intrinsics("front", SIZE), track, SIZE, SIZE)
    with closing(Renderer(scene, Look(), SIZE)) as renderer:
        placed = {name: poses[0] for name, poses in motion.objects.items()}
        renderer.pose(motion.joint_positions[0], motion.opening[0], placed)
        far = cameras.FAR["front"]
        images = [
            renderer.render(camera, t, cameras.NEAR, far)[0].copy() for t in range(len(track))
        ]
    return images.__getitem__


def walk(step: float) -> np.ndarray:
    """Poses along an arc, or, with step 0, of a head that turns where it is."""
    track = []
    for k in range(LENGTH):
        heading = 180 + 3.0 * k - 1.5 * LENGTH
        at = (1.2 - 0.5 * step * abs(k - 6), step * (k - LENGTH / 2), 1.5)
        track.append(cameras._looking(at, heading, 28))
    return np.stack(track)


def test_a_walk_is_found() -> None:
    track = walk(0.05)
    found = colmap.reconstruct(filmed(track), range(LENGTH), settings=RULE)
    assert len(found.times) >= 0.95 * LENGTH
    truth, at = track[found.times, :3, 3], found.cam_to_world[:, :3, 3]
    motion, scale = world.aligned(at, truth)
    off = scale * at @ motion[:3, :3].T + motion[:3, 3] - truth
    way = np.linalg.norm(truth[-1] - truth[0])
    assert np.sqrt((off**2).sum(1).mean()) < 0.05 * way
    assert found.focal == pytest.approx(cameras.intrinsics("front", SIZE)[0, 0], rel=0.15)
    assert not found.faults(LENGTH)


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever thread comes to an image or a pair first, and however often its progress is read meanwhile."""
    monkeypatch.setattr(colmap, "WATCHED", 0.002)
    images = filmed(walk(0.05))
    models = [
        colmap.reconstruct(images, range(LENGTH), settings=replace(RULE, threads=threads))
        for threads in (1, 2, 3)
    ]
    for other in models[1:]:
        assert other.times.tolist() == models[0].times.tolist()
        assert other.cam_to_world.tobytes() == models[0].cam_to_world.tobytes()


def test_a_head_that_only_turns_is_refused() -> None:
    with pytest.raises(Unsupported, match="structure from motion"):
        colmap.reconstruct(filmed(walk(0.0)), range(LENGTH), settings=RULE)


def test_only_what_colmap_says_is_kept_from_the_terminal() -> None:
    """Minutes of mapping told nothing of how far they were, since progress goes to the same place."""
    program = (
        "import os, sys\n"
        "from rpaug.cli.progress import console\n"
        "from rpaug.scene.video import colmap\n"
        "with colmap._quiet():\n"
        "    os.write(2, b'its log\\n')\n"
        "    console.print('mapping, 3 of 9')\n"
        "print('after', file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stderr.splitlines() == ["mapping, 3 of 9", "after"]
