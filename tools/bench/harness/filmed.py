"""A large recording whose every pixel is known: a patterned table, a ball that rolls over it and one that lies beside.

Seen by one camera with depth and masks; it looks straight down, or goes round while it looks at the middle.
"""

import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from rpaug_adapters.rlbench.pickles import dump, load
from rpaug_adapters.rlbench.read import LOW_DIM

from rpaug import Camera, CameraView, Episode, Robot
from rpaug.core import geometry, registry

KEY = "large/all_variations/episodes/episode0"
RADIUS, LYING, HEIGHT = 0.15, 0.06, 1.2  # metres: of the balls, and of the camera over the table
LEAN = 0.35  # metres: how far from the middle the moving camera goes round
FINE = (40.0, 170.0, 690.0)  # radians a metre: waves of the moving recording's table, 16 cm to 9 mm
ALBEDO = np.array([[0.7, 0.6, 0.5], [0.8, 0.2, 0.15], [0.2, 0.5, 0.2]])


def poses(frames: int, moves: bool) -> Float64[np.ndarray, "t 4 4"]:
    """Camera to world: still and straight down, or half a round about the table's middle."""
    turns = np.linspace(0, np.pi, frames) if moves else np.zeros(frames)
    made = np.tile(np.eye(4), (frames, 1, 1))
    for pose, turn in zip(made, turns, strict=True):
        eye = (
            np.array([LEAN * np.cos(turn), LEAN * np.sin(turn), HEIGHT])
            if moves
            else [0, 0, HEIGHT]
        )
        ahead = -np.asarray(eye) / np.linalg.norm(eye)
        down = np.array([0, -1.0, 0]) - ahead * (ahead @ [0, -1.0, 0])
        down /= np.linalg.norm(down)
        pose[:3, :3] = np.stack([np.cross(down, ahead), down, ahead], -1)
        pose[:3, 3] = eye
    return made


def balls(t: int, frames: int) -> dict[int, Float64[np.ndarray, "4"]]:
    """Middle and radius of each ball, by its handle."""
    along = -0.3 + 0.6 * t / max(frames - 1, 1)
    return {2: np.array([along, -0.1, RADIUS, RADIUS]), 3: np.array([-0.45, 0.22, LYING, LYING])}


def shot(
    camera: Camera, t: int, frames: int, waves: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Color, depth and handles of one frame."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    across, down = geometry.slopes(columns, rows, camera.K)
    turn, eye = camera.cam_to_world[t, :3, :3], camera.cam_to_world[t, :3, 3]
    z = -eye[2] / (turn[2, 0] * across + turn[2, 1] * down + turn[2, 2])
    x, y = (eye[k] + z * (turn[k, 0] * across + turn[k, 1] * down + turn[k, 2]) for k in (0, 1))
    ids, facing = np.ones(z.shape, np.int32), np.ones(z.shape)
    along = 1 + across**2 + down**2
    for handle, (*middle, radius) in balls(t, frames).items():
        local = (np.array(middle) - eye) @ turn
        reach = across * local[0] + down * local[1] + local[2]
        inside = reach**2 - along * (local @ local - radius**2)
        ball = inside > 0
        z = np.where(ball, (reach - np.sqrt(np.maximum(inside, 0))) / along, z)
        ids = np.where(ball, handle, ids).astype(np.int32)
        up = eye[2] + z * (turn[2, 0] * across + turn[2, 1] * down + turn[2, 2]) - middle[2]
        facing = np.where(ball, up / radius, facing)
    grain = 0.85 + sum(0.1 / len(waves) * np.sin(w * x) * np.sin(-0.775 * w * y) for w in waves)
    albedo = ALBEDO[ids - 1]
    albedo[ids == 1] *= grain[ids == 1, None]
    rgb = np.rint(255 * albedo * (0.3 + 0.7 * np.maximum(facing, 0))[..., None])
    return rgb.astype(np.uint8), z.astype(np.float32), ids


def recording(
    frames: int, width: int, height: int, moves: bool = False, part: slice = slice(None)
) -> Episode:
    """The episode: table (handle 1), the ball that rolls (2) and the one that lies (3); or a run of its frames."""
    K = np.array([[width * 0.8, 0, width / 2], [0, width * 0.8, height / 2], [0, 0, 1.0]])
    camera = Camera(K, poses(frames, moves), width, height)
    waves = FINE if moves else FINE[:1]
    times = range(frames)[part]
    shoot = lru_cache(4)(lambda t: shot(camera, times[t], frames, waves))
    part_camera = replace(camera, cam_to_world=camera.cam_to_world[part])
    view = CameraView(
        part_camera, lambda t: shoot(t)[0], lambda t: shoot(t)[1], lambda t: shoot(t)[2]
    )
    held = np.tile(np.eye(4), (len(times), 1, 1))
    if moves:  # the gripper rolls the ball, its tip in the ball's top
        held[:, :3, 3] = [np.add(balls(t, frames)[2][:3], [0, 0, RADIUS]) for t in times]
    robot = Robot(
        np.zeros((len(times), 7)),
        np.zeros((len(times), 7)),
        held,
        np.ones(len(times)),
    )
    return Episode(KEY, {"front": view}, robot, ("roll",), len(times))


def written(
    root: Path, frames: int, width: int, height: int, moves: bool = False, processes: int = 1
) -> Path:
    """The recording as an RLBench dataset under a new folder; runs of frames are written side by side."""
    size = -(-frames // processes)
    parts = [slice(start, min(start + size, frames)) for start in range(0, frames, size)]
    folders = [root.with_name(f"{root.name}_{k}") for k in range(len(parts))]
    write = partial(_write, frames=frames, width=width, height=height, moves=moves)
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        list(pool.map(write, folders, parts))
    whole = (folders[0] / KEY).rename(_made(root / KEY))
    demo = load(whole / LOW_DIM)
    for folder, part in zip(folders[1:], parts[1:], strict=True):
        for path in (folder / KEY).glob("front_*/*.png"):
            path.rename(whole / path.parent.name / f"{part.start + int(path.stem)}.png")
        demo._observations += load(folder / KEY / LOW_DIM)._observations  # type: ignore[attr-defined]
    (whole / LOW_DIM).write_bytes(dump(demo))
    for folder in folders:
        shutil.rmtree(folder)
    return root


def _made(place: Path) -> Path:
    place.parent.mkdir(parents=True)
    return place


def _write(root: Path, part: slice, frames: int, width: int, height: int, moves: bool) -> None:
    made = recording(frames, width, height, moves, part)
    registry.adapter("rlbench").write(made, root, made.key, dict)
