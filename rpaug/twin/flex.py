"""Things that bend: sheets and soft bodies as meshes, and how they move by MuJoCo's flex simulation."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from rpaug.twin.motion import STEP
from rpaug.twin.world import Flex, Print

# The corners of a cell, numbered by bits (x, y, z), cut in five tetrahedra; mirrored from cell to cell, so that
# neighbours share their diagonals.
_EVEN = ((0, 1, 2, 4), (3, 1, 7, 2), (5, 1, 4, 7), (6, 2, 7, 4), (1, 2, 4, 7))
_ODD = ((1, 0, 5, 3), (2, 0, 3, 6), (4, 0, 6, 5), (7, 3, 5, 6), (0, 3, 6, 5))


@dataclass(frozen=True)
class FlexPhysics:
    """What a flex is made of: kilograms in all, simulated seconds per step, weight, MJCF elements for its stiffness."""

    mass: float
    step: float
    gravity: float  # metres per second squared, downwards
    stiffness: str


FABRIC = FlexPhysics(0.08, 0.001, 9.81, '<edge equality="true" damping="0.002"/>')
# Heavier than rubber, so that explicit steps stay stable, and weightless for it.
RUBBER = FlexPhysics(1.0, 0.0005, 0.0, '<elasticity young="1e5" poisson="0.3" damping="0.002"/>')


def sheet(
    corner: Float[np.ndarray, "3"],
    right: Float[np.ndarray, "3"],
    down: Float[np.ndarray, "3"],
    cells: tuple[int, int],
    printed: Print,
) -> Flex:
    """A rectangle from its upper left corner, `cells` to the right and down, each cut in two triangles."""
    across, along = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1))
    points = corner + across[..., None] * right + along[..., None] * down
    number = np.arange(across.size).reshape(across.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, d, c), (a, c, b))])
    size = np.linalg.norm(right), np.linalg.norm(down)
    tiles = np.stack([across * size[0], along * size[1]], -1).reshape(-1, 2) / printed.side
    return Flex(points.reshape(-1, 3), faces, tiles, printed)


def hand(at: Float[np.ndarray, "3"], cell: Float[np.ndarray, "3"], printed: Print) -> Flex:
    """A palm with four fingers and a thumb, upright, one cell thick, facing -x; `at` is the middle of its foot.

    `cell` is a cell's depth (x), width (y) and height (z) in metres.
    """
    cells = [(y, z) for y in range(7) for z in range(5)]
    cells += [(y, z) for y in (0, 2, 4, 6) for z in range(5, 11 if y in (2, 4) else 9)]
    cells += [(y, 2) for y in (7, 8, 9)]
    number: dict[tuple[int, int, int], int] = {}
    elements = []
    for y, z in cells:
        corners = [
            number.setdefault((bits & 1, y + (bits >> 1 & 1), z + (bits >> 2)), len(number))
            for bits in range(8)
        ]
        elements += [[corners[i] for i in four] for four in (_ODD if (y + z) % 2 else _EVEN)]
    places = np.array(list(number), float)
    points = (places - [0.5, 3.5, 0]) * cell + at
    tetrahedra = np.array(elements)
    sides = points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]
    inside_out = np.linalg.det(sides) < 0
    tetrahedra[inside_out] = tetrahedra[inside_out][:, [0, 2, 1, 3]]
    return Flex(points, tetrahedra, points[:, 1:] / printed.side, printed)


def simulate(
    flex: Flex,
    physics: FlexPhysics,
    *,
    length: int,
    pinned: Bool[np.ndarray, "v"],
    forces: Float[np.ndarray, "t v 3"],
    driven: Float[np.ndarray, "t v 3"] | None = None,
    rod: Float[np.ndarray, "t 2 3"] | None = None,
    radius: float = 0.01,
) -> Float[np.ndarray, "t v 3"]:
    """Where the vertices are at each of `length` frames, `STEP` seconds apart, starting at rest.

    `pinned` vertices stay where they are or, if `driven` is given, go where that says. `forces` are newtons on
    each vertex. A `rod` from one end to the other, `radius` thick, pushes what it runs into.
    """
    model = mujoco.MjModel.from_xml_string(
        _xml(flex, physics, pinned & (driven is None), rod, radius)
    )
    data = mujoco.MjData(model)
    body = model.flex_vertbodyid
    slots = model.jnt_qposadr[np.maximum(model.body_jntadr[body], 0)][:, None] + np.arange(3)
    steps = round(STEP / physics.step)
    out = [flex.points]
    moving = np.flatnonzero(body > 0)
    for t in range(1, length):
        for k in range(steps):
            share = (k + 1) / steps
            data.xfrc_applied[body[moving], :3] = _mixed(forces, t, share)[moving]
            if rod is not None:
                _lay(data, _mixed(rod, t, share))
            if driven is not None:
                data.qpos[slots[pinned]] = (_mixed(driven, t, share) - flex.points)[pinned]
                data.qvel[slots[pinned]] = ((driven[t] - driven[t - 1]) / STEP)[pinned]
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_flex(model, data)
        out.append(data.flexvert_xpos.copy())
    return np.array(out)


def gusts(
    points: Float[np.ndarray, "v 3"],
    length: int,
    direction: Float[np.ndarray, "3"],
    strength: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "t v 3"]:
    """Forces of a draught: three waves of drawn rhythm that run over the points, newtons on each vertex."""
    seconds = STEP * np.arange(length)[:, None]
    total = np.zeros((length, len(points)))
    for _ in range(3):
        period, phase = rng.uniform(0.6, 1.6), rng.uniform(0, 2 * np.pi)
        wave = rng.normal(0, 8.0, 3)  # radians per metre
        total += np.sin(2 * np.pi * seconds / period + phase + points @ wave)
    return strength * total[..., None] * direction


def _mixed(track: Float[np.ndarray, "t *n"], t: int, share: float) -> Float[np.ndarray, "*n"]:
    return (1 - share) * track[t - 1] + share * track[t]


def _lay(data: mujoco.MjData, ends: Float[np.ndarray, "2 3"]) -> None:
    """Put the rod, whose own axis is z, from one end to the other."""
    way = ends[1] - ends[0]
    data.mocap_pos[0] = ends.mean(0)
    mujoco.mju_quatZ2Vec(data.mocap_quat[0], way / np.linalg.norm(way))


def _xml(
    flex: Flex,
    physics: FlexPhysics,
    pinned: Bool[np.ndarray, "v"],
    rod: Float[np.ndarray, "t 2 3"] | None,
    radius: float,
) -> str:
    pins = f'<pin id="{_text(np.flatnonzero(pinned))}"/>' if pinned.any() else ""
    touch = int(rod is not None)
    half = 0.0 if rod is None else float(np.linalg.norm(rod[0, 1] - rod[0, 0]) / 2)
    tool = "" if rod is None else (
        f'<body mocap="true"><geom type="capsule" size="{radius} {half}"/></body>'
    )  # fmt: skip
    return f"""<mujoco>
        <option timestep="{physics.step}" integrator="Euler" gravity="0 0 {-physics.gravity}"/>
        <worldbody>{tool}
        <flexcomp name="flex" type="direct" dim="{flex.dim}" mass="{physics.mass}" radius="0.002"
            point="{_text(flex.points)}" element="{_text(flex.elements)}">{pins}
        <contact contype="{touch}" conaffinity="{touch}" selfcollide="none"/>{physics.stiffness}</flexcomp>
        </worldbody></mujoco>"""


def _text(numbers: np.ndarray) -> str:
    return " ".join(map(repr, np.asarray(numbers).ravel().tolist()))
