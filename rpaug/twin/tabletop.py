"""The tabletop: a Panda, a table, walls, a floor, and what tasks put there: cabinet, stove, blocks, cups and more."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from rpaug.core import geometry
from rpaug.twin import panda, textures
from rpaug.twin.world import WHITE, Geom, Part, TwinBody, World, draw_instance_ids

TABLE = 0.752  # metres, the height of RLBench's table
ARM = panda.Panda(geometry.rigid(np.zeros(3), np.array([-0.29, 0.0, TABLE])))

DEPTH, WIDTH, HEIGHT = 0.24, 0.28, 0.21  # of the cabinet: along the drawer's way, across, up
WALL = 0.012
GRIP = np.array([0.184, 0.0, 0.165])  # middle of the grip in the cabinet's frame
GRIP_RADIUS = 0.008

CUP_SMALL, CUP_LARGE = (0.026, 0.003, 0.100), (0.044, 0.004, 0.060)  # radius, wall, height
FLOOR_OF_CUP = 0.006
BUTTON_TOP, BUTTON_TRAVEL = 0.042, 0.010  # above the table, and how far down it is pressed
BOX, BOX_FLOOR = (0.090, 0.095, 0.070), 0.008  # outer half extents and height; thickness
STOVE, PLATE = (
    (0.130, 0.150, 0.060),
    (-0.030, 0.070, 0.004),
)  # half extents, height; x, radius, height
KNOB_AT, KNOB = (0.095, 0.060), (0.024, 0.026)  # x and +-y on the stove; radius, height
LID, LID_OPEN = 0.006, float(np.deg2rad(55.0))  # thickness of the box's lid; how far it stands open
BLOCK = (0.032, 0.055, 0.045)  # half extents: the narrow side fits the gripper
RACK = (0.009, 0.16, 0.36)  # radius of its bars, half its width, height
POST = (0.030, 0.10)  # radius and height
RED = (0.80, 0.07, 0.06)


def build(
    placing: Mapping[str, Float[np.ndarray, "4 4"]],
    rng: np.random.Generator,
    texture_seed: int,
    soft: Sequence[Part] = (),
) -> World:
    """The furnished world: of the things, those that `placing` says where to stand, and all `soft` parts; `rng`
    draws the handles."""
    bodies = (
        _room(),
        *panda.bodies(ARM.base),
        *(_cabinet(placing["cabinet"]) if "cabinet" in placing else ()),
        *((_stove(placing["stove"]),) if "stove" in placing else ()),
        *(
            TwinBody(name, (part,), placing[name], movable=True)
            for name, part in _things().items()
            if name in placing
        ),
        *(TwinBody(part.name, (part,)) for part in soft),
    )
    return World(bodies, _pictures(texture_seed), draw_instance_ids(bodies, rng))


def upright(x: float, y: float, height: float = 0.0, yaw: float = 0.0) -> Float[np.ndarray, "4 4"]:
    """The pose of something that stands on the table, turned by `yaw` about the vertical."""
    return geometry.rigid(np.array([0, 0, yaw]), np.array([x, y, TABLE + height]))


def resting_height(name: str) -> float:
    """How far above the table a thing's frame is when it stands; for a block, the cylinder and the pad its middle."""
    lowest = [
        geom.start[2] - geom.size[2] if geom.shape == "box" else geom.start[2]
        for geom in _things()[name].geoms
    ]
    return -min(lowest)


def _room() -> TwinBody:
    """Table, floor and three walls: nothing of it ever moves, yet each has its own handle."""
    wall = 0.05

    def panel(name: str, size: tuple[float, ...], middle: tuple[float, float, float]) -> Part:
        shapes = (Geom("box", size, middle, texture="plaster"),)
        return Part(name, shapes, (0.62, 0.72, 0.80), casts=False)

    top = 0.02
    table = (
        Geom("box", (0.62, 0.72, top), (0.20, 0, TABLE - top), texture="wood"),
        Geom(
            "box", (0.05, 0.05, (TABLE - 2 * top) / 2), (-0.3, 0.6, TABLE / 2 - top), texture="wood"
        ),
        Geom(
            "box",
            (0.05, 0.05, (TABLE - 2 * top) / 2),
            (-0.3, -0.6, TABLE / 2 - top),
            texture="wood",
        ),
        Geom(
            "box", (0.05, 0.05, (TABLE - 2 * top) / 2), (0.7, 0.6, TABLE / 2 - top), texture="wood"
        ),
        Geom(
            "box", (0.05, 0.05, (TABLE - 2 * top) / 2), (0.7, -0.6, TABLE / 2 - top), texture="wood"
        ),
    )
    return TwinBody(
        "room",
        (
            Part("table", table),
            Part("floor", (Geom("box", (2.2, 2.2, 0.01), (0.3, 0, -0.01), texture="tiles"),)),
            panel("wall_back", (wall, 1.7, 1.3), (-1.5, 0, 1.3)),
            panel("wall_left", (1.85, wall, 1.3), (0.3, 1.7, 1.3)),
            panel("wall_right", (1.85, wall, 1.3), (0.3, -1.7, 1.3)),
            panel("wall_far", (wall, 1.7, 1.3), (2.15, 0, 1.3)),
        ),
    )


def _cabinet(pose: Float[np.ndarray, "4 4"]) -> tuple[TwinBody, TwinBody]:
    """A box that is open in the upper front, and the drawer in it; x is the way the drawer opens, z = 0 its foot."""
    d, w, h, t = DEPTH / 2, WIDTH / 2, HEIGHT, WALL / 2
    image_cache = 0.10

    def board(half: tuple[float, float, float], middle: tuple[float, float, float]) -> Geom:
        return Geom("box", half, middle, texture="oak")

    frame = (
        board((d, w, t), (0, 0, h - t)),
        board((d, w, t), (0, 0, t)),
        board((d, t, h / 2 - WALL), (0, w - t, h / 2)),
        board((d, t, h / 2 - WALL), (0, t - w, h / 2)),
        board((t, w - WALL, h / 2 - WALL), (t - d, 0, h / 2)),
        board((d - WALL, w - WALL, t), (t, 0, image_cache - t)),
        board((t, w - WALL, image_cache / 2 - WALL), (d - t, 0, image_cache / 2)),
    )
    gap, low, high = 0.004, image_cache + 0.004, h - WALL - 0.016
    side = w - WALL - gap - t
    tray = (
        board((t, w - 0.002, 0.052), (d + t + 0.001, 0, 0.152)),
        board((d - WALL, t, (high - low) / 2), (t, side, (low + high) / 2)),
        board((d - WALL, t, (high - low) / 2), (t, -side, (low + high) / 2)),
        board((t, side - t, (high - low) / 2), (WALL + t - d, 0, (low + high) / 2)),
        board((d - WALL - t, side - t, 0.004), (WALL, 0, low + 0.004)),
    )
    x, y, z = GRIP
    post = 0.05
    start = d + WALL + 0.001
    grip = (
        Geom("capsule", (GRIP_RADIUS,), (x, y - 0.06, z), (x, y + 0.06, z)),
        Geom("cylinder", (0.006,), (start, y - post, z), (x, y - post, z)),
        Geom("cylinder", (0.006,), (start, y + post, z), (x, y + post, z)),
    )
    return (
        TwinBody("cabinet", (Part("cabinet", frame, (0.80, 0.72, 0.62)),), pose, movable=True),
        TwinBody(
            "drawer",
            (Part("drawer", tray, (0.95, 0.90, 0.82)), Part("grip", grip, (0.30, 0.31, 0.34))),
            pose,
            movable=True,
        ),
    )


def _stove(pose: Float[np.ndarray, "4 4"]) -> TwinBody:
    """A cooktop with one hot plate, and two knobs on its far edge that have handles of their own."""
    x, y, height = STOVE
    at, radius, thick = PLATE
    steel = Geom("box", (x, y, height / 2), (0, 0, height / 2), color=(0.80, 0.81, 0.83))
    plate = Geom(
        "cylinder", (radius,), (at, 0, height), (at, 0, height + thick), color=(0.16, 0.15, 0.15)
    )
    knobs = tuple(
        Part(
            name,
            (Geom("cylinder", KNOB[:1], foot, (*foot[:2], height + KNOB[1])),),
            (0.20, 0.20, 0.22),
        )
        for name, foot in (
            ("knob_left", (KNOB_AT[0], KNOB_AT[1], height)),
            ("knob_right", (KNOB_AT[0], -KNOB_AT[1], height)),
        )
    )
    return TwinBody("stove", (Part("stove", (steel, plate)), *knobs), pose, movable=True)


def _things() -> dict[str, Part]:
    """What can be taken, pressed, or put something on or into."""
    x, y, z = BLOCK
    single = (
        ("block_plain", Geom("box", BLOCK), RED),
        ("block_two_coloured", Geom("box", BLOCK, texture="halves"), WHITE),
        ("block_textured", Geom("box", (y, y, y), texture="marble"), WHITE),
        ("block_small", Geom("box", (z, z, x)), (0.16, 0.30, 0.74)),
        ("cylinder", Geom("cylinder", (z,), (0, 0, -0.06), (0, 0, 0.06)), (0.20, 0.62, 0.28)),
        ("pad", Geom("box", (0.07, 0.07, 0.006)), (0.85, 0.82, 0.78)),
        # So thin that a block can slide onto it.
        ("patch", Geom("box", (0.06, 0.08, 0.0004)), (0.22, 0.60, 0.36)),
        ("button", Geom("cylinder", (0.022,), (0, 0, 0.012), (0, 0, BUTTON_TOP)), RED),
    )
    return {name: Part(name, (geom,), tint) for name, geom, tint in single} | {
        name: Part(name, geoms, tint)
        for name, geoms, tint in (
            ("button_base", _frame(0.040, 0.040, 0.032, 0.015, 0.002), (0.72, 0.72, 0.76)),
            ("box", _frame(*BOX, 0.008, BOX_FLOOR, texture="oak"), (0.92, 0.86, 0.76)),
            ("lid", (_lid(),), (0.62, 0.70, 0.86)),
            ("cup_small", _cup(*CUP_SMALL), (0.20, 0.42, 0.78)),
            ("cup_large", _cup(*CUP_LARGE), (0.90, 0.62, 0.18)),
            ("rack", _rack(*RACK), (0.45, 0.47, 0.52)),
            ("post", (Geom("cylinder", POST[:1], (0, 0, 0), (0, 0, POST[1])),), (0.35, 0.36, 0.40)),
        )
    }


def _frame(
    x: float, y: float, height: float, wall: float, base: float, texture: str | None = None
) -> tuple[Geom, ...]:
    """An open box on the table: outer half extents, height, thickness of walls and base."""
    half, up = wall / 2, (height - base) / 2

    def board(size: tuple[float, ...], middle: tuple[float, float, float]) -> Geom:
        return Geom("box", size, middle, texture=texture)

    return (
        board((x, y, base / 2), (0, 0, base / 2)),
        *(board((x, half, up), (0, s * (y - half), base + up)) for s in (-1, 1)),
        *(board((half, y - wall, up), (s * (x - half), 0, base + up)) for s in (-1, 1)),
    )


def _lid() -> Geom:
    """A board as wide as the box; its frame's origin is the hinge, along y, and closed it reaches back along -x."""
    x, y, _ = BOX
    return Geom("box", (x, y, LID / 2), (-x, 0, LID / 2), texture="oak")


def _cup(radius: float, wall: float, height: float, staves: int = 12) -> tuple[Geom, ...]:
    """Flat staves around a bottom; `radius` is to the outside of a stave's middle."""
    middle, base = radius - wall / 2, FLOOR_OF_CUP / 2
    across = radius * np.tan(
        np.pi / staves
    )  # so that staves meet outside; inside they overlap unseen
    ring = tuple(
        Geom(
            "box",
            (wall / 2, float(across), height / 2),
            (float(middle * np.cos(turn)), float(middle * np.sin(turn)), height / 2),
            yaw=float(turn),
        )
        for turn in 2 * np.pi * np.arange(staves) / staves
    )
    return (Geom("cylinder", (radius - wall,), (0, 0, 0), (0, 0, 2 * base)), *ring)


def _rack(radius: float, half: float, height: float) -> tuple[Geom, ...]:
    """A bar on two feet."""
    top = height + radius
    ends = [(0.0, -half, top), (0.0, half, top)]
    return (
        Geom("capsule", (radius,), ends[0], ends[1]),
        *(Geom("cylinder", (radius,), (0, y, 0), (0, y, top)) for _, y, _ in ends),
        *(Geom("box", (0.06, 0.015, 0.006), (0, y, 0.006)) for _, y, _ in ends),
    )


@lru_cache(4)  # a motion is often recorded again with one factor changed
def _pictures(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "wood": textures.grain(rng, (0.72, 0.52, 0.30), 10, 0.13),
        "oak": textures.grain(rng, (0.78, 0.68, 0.54), 8, 0.08),
        "plaster": textures.grain(rng, (0.80, 0.82, 0.84), 1, 0.07),
        "tiles": textures.tiles(rng, (0.72, 0.70, 0.66), 12),
        "halves": textures.halves((0.85, 0.20, 0.15), (0.90, 0.78, 0.20)),
        "marble": textures.marble(rng, (0.30, 0.42, 0.62), (0.88, 0.84, 0.72)),
    }
