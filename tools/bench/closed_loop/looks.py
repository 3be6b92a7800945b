"""What is changed while a policy is tested or trained by truly rendered copies: one factor at a time, or all at once.

Seeds, textures and shapes of distractors differ from those of training, so nothing that is tested was ever trained on.
"""

from dataclasses import replace

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from rpaug.core import geometry
from rpaug.twin import factors, textures
from rpaug.twin.look import Extra, Look
from rpaug.twin.roaming import clear, occupied
from rpaug.twin.staging import StagedTask
from rpaug.twin.tabletop import TABLE
from rpaug.twin.world import World

SINGLE = (
    "object_color",
    "object_texture",
    "object_size",
    "distractor",
    "light_color",
    "table_color",
    "table_texture",
    "background_texture",
    "camera_pose",
)
CONDITIONS = ("none", *SINGLE, "all")
INVALIDATING = ("object_size",)  # recorded actions are not right for it
SIZES = (0.8, 1.12)  # wider than that and a block does not fit the fingers
DISTRACTORS = 2
ROOM = Look(texture_seed=7)  # where all demonstrations are recorded: one table, one floor
ROAM = 0.08  # metres each way that a task may lie elsewhere, among the same things strewn anew
FREE = 0.10  # metres between a distractor's middle and things, and from the gripper's way over the table
TEXTURES = {  # which images cover parts, (training, testing)
    "training": textures.KINDS[::2],
    "testing": textures.KINDS[1::2],
}


def draw(
    condition: str, world: World, job: StagedTask, use: str, rng: np.random.Generator, look: Look
) -> Look:
    """The look under one condition, for `use` in "training" or "testing"; "all" takes every factor at once."""
    names = SINGLE if condition == "all" else () if condition == "none" else (condition,)
    return mixed(names, world, job, use, rng, look)


def mixed(
    names: tuple[str, ...],
    world: World,
    job: StagedTask,
    use: str,
    rng: np.random.Generator,
    look: Look,
) -> Look:
    """The look with all the named factors changed."""
    for name in names:
        factor = factors.find(name)
        parts = factors.parts(factor, None, world, job)
        if name == "object_color":
            look = _colored(look, (job.manipulated, job.receiver), rng)
        elif name == "distractor":
            look = replace(look, extras=_distractors(world, job, use, rng))
        elif name == "object_size":
            look = factor.change(look, parts, rng.uniform(*SIZES), rng)
        elif factor.parts and name.endswith("texture"):
            look = _covered(factor, look, parts, use, rng)
        else:
            look = factor.change(look, parts, None, rng)
    return look


def _colored(look: Look, names: tuple[str | None, ...], rng: np.random.Generator) -> Look:
    for name in filter(None, names):
        look = factors.FACTORS["object_color"].change(look, (name,), None, rng)
    return look


def _covered(
    factor: factors.Factor,
    look: Look,
    parts: tuple[str, ...],
    use: str,
    rng: np.random.Generator,
) -> Look:
    drawn = factor.change(look, parts, None, rng)
    cover = replace(drawn.covers[parts[0]], kind=str(rng.choice(TEXTURES[use])))
    return factor.change(look, parts, cover, rng)


def _distractors(
    world: World, job: StagedTask, use: str, rng: np.random.Generator
) -> tuple[Extra, ...]:
    """Things that have nothing to do with the task, where nothing stands and the gripper does not pass."""
    taken = occupied(job.placing, job.script)
    out: list[Extra] = []
    for _ in range(200):
        at = rng.uniform((-0.02, -0.30), (0.48, 0.30))
        if not clear(at, taken, FREE):
            continue
        taken.append(at)
        out.append(_thing(len(out), at, use, rng))
        if len(out) == DISTRACTORS:
            break
    return tuple(out)


def _thing(number: int, at: Float[np.ndarray, "2"], use: str, rng: np.random.Generator) -> Extra:
    mesh = _shape(use, rng)
    low = mesh.vertices[:, 2].min()
    pose = geometry.rigid(
        np.array([0, 0, rng.uniform(0, 2 * np.pi)]), np.array([at[0], at[1], TABLE - low])
    )
    corners = mesh.vertices[mesh.faces.ravel()]
    return Extra(
        name=f"distractor{number}",
        handle=60_000 + number,
        points=corners,
        normals=np.repeat(mesh.face_normals, 3, axis=0),
        uv=np.full((len(corners), 2), 0.5),
        faces=np.arange(len(corners)).reshape(-1, 3),
        image=_plain(rng),
        pose=pose,
    )


def _shape(use: str, rng: np.random.Generator) -> trimesh.Trimesh:
    """About 4 to 10 cm large. What is tested on is never trained on."""
    size = rng.uniform(0.02, 0.045)
    if use == "training":
        return (
            trimesh.creation.box((size, 2 * size, size)),
            trimesh.creation.cylinder(size / 2, 2 * size, sections=24),
            trimesh.creation.icosphere(2, size),
        )[int(rng.integers(3))]
    return (
        trimesh.creation.cone(size, 2.5 * size, sections=24),
        trimesh.creation.torus(size, size / 3, major_sections=24, minor_sections=12),
        trimesh.creation.capsule(1.5 * size, size, count=(12, 12)),
        trimesh.creation.icosahedron().apply_scale(size * rng.uniform(0.5, 1.2, 3)),
    )[int(rng.integers(4))]


def _plain(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    return np.broadcast_to(rng.integers(20, 256, 3).astype(np.uint8), (8, 8, 3)).copy()
