"""How far off cameras are that the robot's outline tells, without a board, on the twin with scripted models.

    python -m tools.bench.calibrate [--seeds 6] [--first 0] [--quality middle] [--focal] [--json]

Of each seed's recording the fixed cameras' colors, the joints and the gripper's poses are kept; where cameras stand is
hidden, with --focal their intrinsics too. The robot, fingers among it, is outlined as a model of that quality would
(`tools.bench.scripted`); the file given for it has no fingers that move. *told* is how far off one may be, as said.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rpaug import twin
from rpaug.core.types import CameraView, Episode
from rpaug.pipeline import calibrate
from rpaug.providers.models_settings import Models
from rpaug.scene.tracking import outline_starts
from rpaug.twin import mjcf, panda, tabletop
from rpaug.twin.look import Look
from rpaug.twin.world import World
from tools.bench import rgb_only, scripted

ARM = "link", "hand", "finger"  # what the robot's parts are called


@dataclass(frozen=True)
class Row:
    """One camera: how far off it is and was said to be, in metres and degrees; or why it was refused."""

    seed: int
    task: str
    camera: str
    metres: float
    degrees: float
    told_metres: float
    told_degrees: float
    focal: float  # share that it is off
    refused: str = ""


def arm_file(folder: Path) -> Path:
    """The twin's arm as an MJCF file."""
    bodies = panda.bodies(tabletop.ARM.base)
    handles = {part.name: k + 1 for k, part in enumerate(p for b in bodies for p in b.parts)}
    path = folder / "panda.xml"
    path.write_text(mjcf.to_xml(World(bodies, {}, handles), Look(), 64))
    return path


def hidden(episode: Episode, focal: bool) -> Episode:
    """The fixed cameras' colors, nothing said of where they stand, and with `focal` nothing of their lenses."""
    bare = rgb_only.bare(episode)
    if focal:
        return bare

    def unplaced(name: str) -> CameraView:
        camera = replace(bare.views[name].camera, K=episode.views[name].camera.K)
        return replace(bare.views[name], camera=replace(camera, assumed=False, unplaced=True))

    return replace(bare, views={name: unplaced(name) for name in bare.views})


def rows(
    seed: int, quality: str, focal: bool, size: int, frames: int, folder: Path
) -> Iterator[Row]:
    """All fixed cameras of one seed."""
    task = tuple(twin.TASKS)[seed % len(twin.TASKS)]
    take = twin.perform(task, seed, frames=frames, size=size)
    episode = hidden(take.episode, focal)
    robot = {"robot": [h for name, h in take.truth.handles.items() if name.startswith(ARM)]}
    drawn = replace(take.episode, views={n: take.episode.views[n] for n in episode.views})
    path = folder / f"{seed}.json"
    path.write_text(json.dumps(scripted.outlines(drawn, robot, scripted.QUALITIES[quality], seed)))
    found = calibrate.of_episode(episode, arm_file(folder), Models(text=f"outlines:{path}"))
    for name, reason in found.refused.items():
        yield Row(seed, task, name, np.nan, np.nan, np.nan, np.nan, np.nan, reason)
    for name, one in found.cameras.items():
        true = take.episode.views[name].camera
        pose = true.cam_to_world[0]
        yield Row(
            seed,
            task,
            name,
            float(np.linalg.norm(one.cam_to_world[:3, 3] - pose[:3, 3])),
            float(np.degrees(outline_starts.turn(one.cam_to_world, pose))),
            one.place,
            float(np.degrees(one.direction)),
            float(one.lens.K[0, 0] / true.K[0, 0] - 1),
        )


def main() -> None:
    """The figures, camera by camera and in the middle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--quality", choices=scripted.QUALITIES, default="middle")
    parser.add_argument("--focal", action="store_true")
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    start, found = time.process_time(), list[Row]()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.seeds):
            args = seed, given.quality, given.focal, given.size, given.frames, Path(folder)
            for row in rows(*args):
                found.append(row)
                if not given.json:
                    sys.stdout.write(f"{vars(row)}\n")
                    sys.stdout.flush()
    if given.json:
        json.dump([vars(row) for row in found], sys.stdout, indent=1)
        return
    told = [row for row in found if not row.refused]
    middle = np.median([(1e3 * row.metres, row.degrees) for row in told], 0)
    worst = np.max([(1e3 * row.metres, row.degrees) for row in told], 0)
    within = np.mean([row.metres <= row.told_metres for row in told])
    seconds = (time.process_time() - start) / len(found)
    sys.stdout.write(
        f"{len(told)} of {len(found)} cameras; median {middle[0]:.1f} mm, {middle[1]:.2f} degrees; worst "
        f"{worst[0]:.1f} mm, {worst[1]:.2f} degrees; within what was told {100 * within:.0f} %; {seconds:.0f} s each\n"
    )


if __name__ == "__main__":
    main()
