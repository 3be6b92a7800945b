"""Record an episode of the twin, and the same motion again with one factor truly changed."""

import json
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rpaug.core import progress, registry
from rpaug.core.errors import RpaugError
from rpaug.core.files import encode_png
from rpaug.core.types import Camera, CameraView, Episode, Robot
from rpaug.twin import cameras, factors, tabletop
from rpaug.twin.look import Look
from rpaug.twin.motion import Motion, play
from rpaug.twin.panda import OPEN
from rpaug.twin.renderer import Renderer
from rpaug.twin.roaming import roamed
from rpaug.twin.soft_tasks import SOFT_TASKS
from rpaug.twin.staging import StagedTask
from rpaug.twin.tasks import TASKS
from rpaug.twin.truth import Truth, changed_tints, laid, mean_albedos
from rpaug.twin.world import Part, World

LARGEST = 2048  # pixels a side
_OPEN_FROM = 0.95  # of the full opening: RLBench's rule for gripper_open


@dataclass(frozen=True)
class Take:
    """An episode in memory with the truth about it: `poses` are body-to-world tracks by body name, `shapes` the
    vertices in the world of what bends, by part name."""

    episode: Episode
    truth: Truth
    poses: Mapping[str, Float[np.ndarray, "t 4 4"]]
    shapes: Mapping[str, Float[np.ndarray, "t v 3"]] = field(default_factory=dict)

    def side(self) -> dict[str, bytes]:
        """The files that lie beside the episode's own: the facts, and the images laid on parts."""
        tiles = {laid.file: encode_png(laid.cover.image) for laid in self.truth.covers.values()}
        return {
            "truth.json": (json.dumps(self.truth.describe(), indent=1) + "\n").encode(),
            **tiles,
        }


def perform(
    task: str,
    seed: int,
    *,
    episode: int = 0,
    factor: str | None = None,
    target: str | None = None,
    value: Any = None,
    look: Look | None = None,
    size: int = 128,
    frames: int = 60,
    roam: float = 0.0,
) -> Take:
    """One episode in memory: number `episode` of `seed`, `frames` long, seen in `size` x `size` pixels.

    Seed and episode draw the layout, the motion, the handles and the textures, whatever the look.
    With `roam` the whole task lies elsewhere on the table, by up to so many metres each way (`roaming.roamed`).
    `factor` changes that look, as `factors.FACTORS` lists, on the part `target`: a name, "manipulated"
    or "receiver" (None: the factor's usual parts), to `value` or, where that is None, to a draw from
    the seed. Raises RpaugError for unknown names and for what cannot roam, Unsupported without OpenGL or with too few
    frames.
    """
    if not 8 <= size <= LARGEST:
        raise RpaugError(f"size {size}: the twin renders 8 to {LARGEST} pixels a side")
    old = look or Look()
    job, world, drawn = stage(task, seed, episode, old, roam)
    motion = play(tabletop.ARM, job.script, job.placing, frames)
    shapes = {} if job.soft is None else {job.soft.name: job.soft.track(motion)}
    changed, new = _changed(factor, target, value, old, job, world, drawn)
    truth = Truth(
        task=task,
        seed=seed,
        episode=episode,
        variation=job.variation,
        manipulated=job.manipulated,
        handles=world.handles,
        bodies={b.name: tuple(world.handles[p.name] for p in b.parts) for b in world.bodies},
        key_frames=motion.keys,
        factor=factor,
        tints=changed_tints(world, old, new),
        albedos=mean_albedos(world, new),
        old=old,
        new=new,
        receiver=job.receiver,
        changed=tuple(world.handles[name] for name in changed),
        covers=laid(world, new, motion.objects),
        roam=roam,
    )
    key = f"{task}/all_variations/episodes/episode{episode}"
    made = Episode(
        key=key,
        views=_views(key, world, new, motion, shapes, size),
        robot=_robot(motion),
        descriptions=job.descriptions,
        length=motion.length,
    )
    return Take(made, truth, motion.objects, shapes)


def _changed(
    factor: str | None,
    target: str | None,
    value: Any,
    old: Look,
    job: StagedTask,
    world: World,
    drawn: np.random.Generator,
) -> tuple[tuple[str, ...], Look]:
    """The parts that a factor changes, and the look after it."""
    if not factor:
        return (), old
    found = factors.find(factor)
    changed = factors.parts(found, target, world, job)
    return changed, found.change(old, changed, value, drawn)


def stage(
    task: str, seed: int, episode: int, look: Look, roam: float = 0.0
) -> tuple[StagedTask, World, np.random.Generator]:
    """The task as that seed and episode draw it, its world, and the generator that draws what a factor changes.

    With `roam` it lies elsewhere on the table, by up to so many metres each way. Raises RpaugError for an unknown
    task, and for one that cannot roam.
    """
    known = {**TASKS, **SOFT_TASKS}
    if task not in known:
        raise RpaugError(f"no task is called {task!r}; there are: {', '.join(known)}")
    layout, handles, textures, drawn = (np.random.default_rng([seed, episode, k]) for k in range(4))
    job = known[task](layout)
    if roam:
        job = roamed(job, tabletop.ARM, roam, layout)
    texture_seed = look.texture_seed
    if texture_seed is None:
        texture_seed = int(textures.integers(2**32))
    parts = [] if job.soft is None else [Part(job.soft.name, (), flex=job.soft.flex)]
    return job, tabletop.build(job.placing, handles, texture_seed, parts), drawn


def record(
    task: str,
    seed: int,
    out: Path,
    *,
    factor: str | None = None,
    target: str | None = None,
    value: Any = None,
    look: Look | None = None,
    size: int = 128,
    frames: int = 60,
    episodes: int = 1,
    roam: float = 0.0,
) -> list[Take]:
    """Write `episodes` episodes to OUT/<task>/all_variations/episodes/episode<i>, `truth.json` beside each one's files.

    The arguments are those of `perform`. Returns the takes, their episodes as read back. Raises BadInput if an
    episode is there already.
    """
    adapter = registry.adapter("rlbench")
    takes = []
    for number in range(episodes):
        take = perform(
            task,
            seed,
            episode=number,
            factor=factor,
            target=target,
            value=value,
            look=look,
            size=size,
            frames=frames,
            roam=roam,
        )
        adapter.write(take.episode, Path(out), take.episode.key, take.side)
        progress.told(take.episode.key, progress.COPY, 1, 1)
        takes.append(replace(take, episode=adapter.read(Path(out), take.episode.key)))
    return takes


def _views(
    key: str,
    world: World,
    look: Look,
    motion: Motion,
    shapes: Mapping[str, Float[np.ndarray, "t v 3"]],
    size: int,
) -> dict[str, CameraView]:
    rig = cameras.rig(motion.gripper_to_world, size, look.bumps)
    reels = {name: _blank(motion.length, size) for name in rig}
    with closing(Renderer(world, look, size)) as renderer:
        for t in range(motion.length):
            progress.told(key, progress.FRAMES, t, motion.length)
            renderer.pose(
                motion.joint_positions[t],
                motion.opening[t],
                {name: track[t] for name, track in motion.objects.items()},
                {name: track[t] for name, track in shapes.items()},
            )
            for name, camera in rig.items():
                frame = renderer.render(camera, t, cameras.NEAR, cameras.FAR[name])
                for reel, image in zip(reels[name], frame, strict=True):
                    reel[t] = image
    return {name: _view(camera, *reels[name]) for name, camera in rig.items()}


def _blank(length: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Room for color, depth and handles of a whole episode in one camera."""
    shape = (length, size, size)
    return np.empty((*shape, 3), np.uint8), np.empty(shape, np.float32), np.empty(shape, np.int32)


def _view(camera: Camera, rgb: np.ndarray, depth: np.ndarray, ids: np.ndarray) -> CameraView:
    for reel in (rgb, depth, ids):
        reel.flags.writeable = False
    return CameraView(camera, rgb.__getitem__, depth.__getitem__, ids.__getitem__)


def _robot(motion: Motion) -> Robot:
    """What RLBench stores of the robot; forces are zero, because the motion is played back and not simulated."""
    t = motion.length
    state = [motion.objects[name][:, :3].reshape(t, 12) for name in sorted(motion.objects)]
    return Robot(
        motion.joint_positions,
        motion.joint_velocities,
        motion.gripper_to_world,
        (motion.opening > _OPEN_FROM * OPEN).astype(np.float64),
        {
            "joint_forces": np.zeros((t, 7)),
            "gripper_touch_forces": np.zeros((t, 6)),
            "gripper_joint_positions": np.stack([motion.opening, motion.opening], 1),
            "task_low_dim_state": np.concatenate(state, 1),
        },
    )
