"""A recorded thing left to physics: filled, let go among its surroundings, and shown as it then moves or deforms."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float64, UInt8

from rpaug.core.errors import Unsupported
from rpaug.core.types import Body, Gaussians, Scene
from rpaug.gaussians import gaussians
from rpaug.gaussians.gaussians import SPREAD
from rpaug.physics import bound, rigid
from rpaug.physics.colliders import Still, nothing, still
from rpaug.physics.filling import columns
from rpaug.physics.held import held
from rpaug.physics.materials import Law, Material
from rpaug.physics.rigid import Hinge, Rail, Rigid
from rpaug.physics.skin import surface
from rpaug.physics.soft import EDGE, Soft, too_stiff
from rpaug.physics.solids import Solid, solid
from rpaug.physics.surroundings import Surroundings, clear, surroundings, within
from rpaug.scene.placement import placing
from rpaug.scene.placement.standing import LIFTED

NEIGHBOURS = 8  # particles that carry one Gaussian
ROOM = 0.4  # metres around a thing that it may move in, if cells allow
BELOW = 6  # cells under the support
MOST_CELLS = 2_000_000
LEAST_CELL = 0.002  # metres
APART = (
    1.5  # cells: what stands still closer to a thing at rest is taken for a part of its own surface
)
LOWER = 0.25  # of a thing's height: what tells the outline of its foot
AROUND = 0.3  # metres around a rigid thing in which others stand in its way
MOST_COLUMNS = 1500
STILL = (
    3e-4  # metres and radians: what is as near to where it was recorded is shown as it was recorded
)
GENTLE = 1e-6  # newton seconds: less is no touch
GAINED = 0.05  # J/kg: so much more energy is noise; it lifts a thing by 5 mm
STICK = -1.0  # friction of what lets nothing go


@dataclass(frozen=True)
class SimulationSetting:
    """How a thing is let go: lifted by `height` metres, at `velocity` in m/s, under `gravity` in m/s2 downwards.

    `fps` are recorded frames a second, `particles` about how many fill it, `friction` is Coulomb's between it and
    what stands still, `grip` that between it and what moves. `loose` takes away what holds it.
    """

    material: Material
    height: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: float = 9.81
    fps: float = 20.0
    particles: int = 6000
    friction: float = 0.5
    grip: float = 1.0
    loose: bool = False


def simulated(
    scene: Scene, instance_ids: frozenset[int], how: SimulationSetting, acted: str | None
) -> Scene:
    """The scene with some instances, as one thing, simulated from its first frame on.

    `acted` says why the recorded actions depend on the thing, None if they do not. Raises Unsupported where too little
    of it was seen.
    """
    around = surroundings(scene, instance_ids, 1 / how.fps)
    shape = surface(scene, instance_ids)
    points = shape.means.astype(float)
    footprint = float(np.median(shape.scales[:, :2].max(1))) / SPREAD
    rail = (
        None
        if how.loose
        else held(scene, instance_ids, points, around.points, around.level, LIFTED)
    )
    found = columns(points, footprint, around.level, LIFTED)
    spacing = max((found.volume / how.particles) ** (1 / 3), LEAST_CELL / 2)
    cell = 2 * spacing
    rest, volume = found.filled(spacing)
    stiff = too_stiff(how.material, cell)
    if stiff is not None:
        shaped = None if rail else solid(points, footprint, found.bottom)
        hull = points if rail else _footed(points, found.bottom)
        after, account = _rigidly(scene, instance_ids, how, around, hull, rail, shaped)
    else:
        inside = rest, volume, spacing
        after, account = _softly(scene, instance_ids, how, around, shape, inside, rail is not None)
    touched = account.pop("touched")
    reasons = [acted] if acted else []
    reasons += ["the robot touches it in the simulation"] if touched else []
    given: dict[str, Any] = {
        "handles": sorted(instance_ids),
        "solver": "rigid" if stiff else "material points",
        **({"because": stiff} if stiff else {}),
        **({"held": rail.describe() if stiff else {"joint": "fixed"}} if rail else {}),
        **account,
        "actions_valid": not reasons,
        **({"reasons": reasons} if reasons else {}),
    }
    return replace(after, recorded_bodies=scene.tracked, simulated=(*scene.simulated, given))


def _softly(
    scene: Scene,
    instance_ids: frozenset[int],
    how: SimulationSetting,
    around: Surroundings,
    shape: Gaussians,
    inside: tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"], float],
    stuck: bool,
) -> tuple[Scene, dict[str, Any]]:
    rest, volume, spacing = inside
    up = np.array([0.0, 0.0, 0.0 if stuck else how.height])
    one = Soft(
        rest + up,
        volume,
        how.material,
        _room(rest + up, 2 * spacing, around, stuck),
        gravity=(0.0, 0.0, -how.gravity),
        boxes=around.boxes or nothing,
        friction=STICK if stuck else how.friction,
        grip=how.grip,
    )
    one.v[:] = how.velocity
    states = [(one.x.copy(), one.D.copy())]
    for _ in range(scene.episode.length - 1):
        one.run(1 / how.fps)
        states.append((one.x.copy(), one.D.copy()))
    flows = how.material.law in (Law.SAND, Law.PLASTICINE)
    neighbours = 1 if how.material.law is Law.SAND else NEIGHBOURS
    tied = bound.bind(shape, rest, spacing, neighbours, inside=flows)
    looks = bound.shown(tied, states)
    given = {
        "particles": len(rest),
        "cell_mm": round(2000 * spacing, 3),
        "steps": one.account.steps,
        "clamped": one.account.clamped,
        "crushed": one.account.crushed,
        "touched": bool(one.account.boxes[: around.robot].sum() > GENTLE),
    }
    return replace(scene, bodies=_split(scene, instance_ids, _deforming(looks))), given


def _rigidly(
    scene: Scene,
    instance_ids: frozenset[int],
    how: SimulationSetting,
    around: Surroundings,
    points: Float64[np.ndarray, "n 3"],
    rail: Rail | Hinge | None,
    shaped: Solid | None,
) -> tuple[Scene, dict[str, Any]]:
    up = np.array([0.0, 0.0, 0.0 if rail else how.height])
    bottom = around.level if around.level is not None else float(points[:, 2].min())
    thing = Rigid(
        points=points + up,
        density=how.material.density,
        level=None if rail else around.level,
        columns=np.zeros((0, 5)) if rail else _columns(points, around, bottom),
        boxes=around.boxes,
        gravity=(0.0, 0.0, -how.gravity),
        friction=how.friction,
        grip=how.grip,
        velocity=how.velocity,
        rail=rail,
        solid=None if shaped is None else shaped.lifted(up),
    )
    fall = thing.run(scene.episode.length, 1 / how.fps)
    if rail is None and fall.boxes.sum() <= GENTLE and thrown(fall.motions, points.mean(0), how):
        raise Unsupported(
            f"simulating {', '.join(map(str, sorted(instance_ids)))}: it is thrown about without anything that moves "
            "touching it: as depth has it, it begins inside of what stands around it"
        )
    motions = fall.motions.copy()
    motions[:, :3, 3] += motions[:, :3, :3] @ up

    def move(body: Body, mine: frozenset[int]) -> Body:
        track = motions @ body.to_world[0]
        as_recorded = (abs(track - body.to_world) < STILL).all((1, 2))
        track[as_recorded] = body.to_world[as_recorded]
        return replace(body, instance_ids=mine, to_world=track, motion="simulated")

    given = {
        "shape": "convex hull" if shaped is None else shaped.kind,
        "steps": fall.steps,
        "touched": bool(fall.boxes[: around.robot].sum() > GENTLE),
    }
    return replace(scene, bodies=_split(scene, instance_ids, move)), given


def thrown(
    motions: Float64[np.ndarray, "t 4 4"],
    middle: Float64[np.ndarray, "3"],
    how: SimulationSetting,
) -> bool:
    """Does the middle of what is let go ever have more energy than it began with?"""
    path = motions[:, :3, :3] @ middle + motions[:, :3, 3]
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * how.fps
    fallen = np.maximum(middle[2] - path[1:, 2], 0.0)
    given = np.square(how.velocity).sum() / 2 + how.gravity * fallen
    return bool((speed**2 / 2 > given + GAINED).any())


def _footed(points: Float64[np.ndarray, "n 3"], bottom: float) -> Float64[np.ndarray, "m 3"]:
    """Surface points with those of the lower part once more at the foot, which no camera sees."""
    height = points[:, 2] - bottom
    low = placing.hull(points[height < LOWER * height.max()])
    under = np.column_stack([low, np.full(len(low), bottom)])
    return np.concatenate([points[height >= 0], under])


def _room(
    rest: Float64[np.ndarray, "n 3"], cell: float, around: Surroundings, stuck: bool
) -> Still:
    """The box that the thing may move in, as large as the number of cells allows.

    What stands close to it at rest is left out, as a part of its own surface, unless that is what it is `stuck` to.
    """
    level, room = around.level, ROOM
    while True:
        low, high = rest.min(0) - room, rest.max(0) + room
        if level is not None:
            low[2] = min(level, rest[:, 2].min()) - BELOW * cell
        if np.prod((high - low) / cell) < MOST_CELLS or room < (EDGE + 2) * cell:
            break
        room *= 0.8
    points = around.points[within(around.points, low, high)]
    if level is not None:
        points = points[points[:, 2] > level + cell]
    if len(points) and not stuck:
        points = points[clear(points, rest, APART * cell)]
    return still(low, high, cell, level, points)


def _columns(
    points: Float64[np.ndarray, "n 3"], around: Surroundings, bottom: float
) -> Float64[np.ndarray, "c 5"]:
    low, high = points.min(0) - AROUND, points.max(0) + AROUND
    others = around.points[within(around.points, low, high)]
    others = others[others[:, 2] > bottom + rigid.STRIP]
    others = others[clear(others, points, rigid.STRIP)] if len(others) else others
    strip = rigid.STRIP
    while len(found := rigid.columns(others, bottom, strip)) > MOST_COLUMNS:
        strip *= 1.3
    return found


def _deforming(looks: Gaussians) -> Any:
    def bend(body: Body, held: frozenset[int]) -> Body:
        mine = gaussians.chosen(looks, np.isin(looks.ids, list(held)))
        return replace(body, instance_ids=held, soft=mine, motion="simulated")

    return bend


def _split(scene: Scene, instance_ids: frozenset[int], change: Any) -> tuple[Body, ...]:
    """The scene's bodies, those of some instances apart and changed; what else is rigid to them stays."""
    out: list[Body] = []
    for body in scene.bodies:
        held = body.instance_ids & instance_ids
        if not held or body.copy_of:
            out.append(body)
            continue
        out.append(change(body, held))
        if rest := body.instance_ids - held:
            out.append(replace(body, instance_ids=rest))
    return tuple(out)


def portrait(scene: Scene, instance_ids: frozenset[int]) -> UInt8[np.ndarray, "h w 3"]:
    """The thing cut out of the first frame of the camera that shows most of it. Raises Unsupported if none does."""
    best, most = None, 0
    for view in scene.episode.views.values():
        if view.ids is None:
            continue
        rows, columns_ = np.nonzero(np.isin(view.ids(0), list(instance_ids)))
        if len(rows) > most:
            window = np.s_[rows.min() : rows.max() + 1, columns_.min() : columns_.max() + 1]
            best, most = view.rgb(0)[window], len(rows)
    if best is None:
        raise Unsupported(
            f"simulating {sorted(instance_ids)}: no camera shows it in the first frame"
        )
    return best
