"""What a copy must not contradict, found before it is rendered: that its roles are what its edits took them for.

A role is a belief. Where an edit goes by it, the recording itself can refute it: things stand on the table, and an edit
of what the robot works with changes what cameras see where the robot works.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float64

from rpaug.compose import views
from rpaug.core import geometry, memo, sampling
from rpaug.core.interfaces import Edit
from rpaug.core.pixels import grown
from rpaug.core.types import Body, Effect, Episode, Scene
from rpaug.pipeline import plan
from rpaug.pipeline.recipe import Option
from rpaug.scene.recorded import surface
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import observed, targets

RISE = 0.05  # metres: what stands on a surface was seen down to less than this above it
REACH = 0.3  # metres around the gripper's path and what it acts on: the workspace
LEAST = 0.01  # of the pixels that an edit changes in an image: fewer in the workspace are strays
LOOKED = 5  # frames in which a change is looked for
BEARS = 0.8, 0.3  # share of level surface, and metres along and across: what may bear others itself

Points = Float64[np.ndarray, "n 3"]


def faults(recorded: Scene, made: Scene, done: Sequence[tuple[Option, Edit]]) -> list[str]:
    """What refutes the roles that these edits went by; `made` is the scene after them, `recorded` the one before."""
    found = [fault for option, edit in done for fault in of_paint(recorded, option, edit)]
    aims = {target.role for option, _ in done for target in plan.targets(option.operator)}
    if "table" in aims or any(body.mesh is not None for body in made.bodies):
        found += of_place(recorded, made)
    return found


def of_paint(recorded: Scene, option: Option, edit: Edit) -> Iterator[str]:
    """What is wrong with an edit of a role's look, taken alone on the recorded scene.

    In no camera may it change anything but the role's own instances, and some camera must see it change something of
    them in the workspace; of the background, which is elsewhere by its nature, anything at all.
    """
    aims = [target for target in plan.targets(option.operator) if target.role]
    named = {str(target.role) for target in aims}
    alone = option.operator.effect == Effect.RGB and not option.operator.needs.gaussians
    if not alone or all(_settled(recorded, role) for role in named):
        return
    ids = [*frozenset().union(*(targets.find(recorded, target) for target in aims))]
    painted = option.operator.apply(recorded, edit)
    shown = views.edited(painted, dict.fromkeys(painted.episode.views, 0), lambda frame: None)
    length, seen, beside = recorded.episode.length, False, 0
    middle_first = sorted(sampling.frames(length, LOOKED), key=lambda t: abs(2 * t - length))
    for t in middle_first:
        for name, view in recorded.episode.views.items():
            if seen and t != middle_first[0]:
                break
            changed = (view.rgb(t) != shown.views[name].rgb(t)).any(-1)
            if view.ids is not None:
                own = np.isin(view.ids(t), ids)
                beside += int((changed & ~(grown(own, 1) if recorded.antialiased else own)).sum())
            counted = changed if "background" in named else changed & _at_work(recorded, name, t)
            seen |= bool(counted.sum() > LEAST * changed.sum())
    what = f"{option.name}: the {' and '.join(sorted(named))}"
    if beside:
        yield f"{what}: {beside} pixels change beside it"
    if not seen:
        yield f"{what}: no camera sees a change of it where the robot works"


def of_place(recorded: Scene, made: Scene) -> Iterator[str]:
    """Why things cannot stand where they are put: on what is taken for the table nothing stands that the robot moves,
    or they do not stand on it."""
    top = _top(recorded)
    if top is None:
        return
    if away := _unborne(recorded):
        yield away
    for body in made.bodies:
        if body.mesh is not None and body.soft is None and body.motion == "static":
            points = geometry.transform(body.to_world[0], body.mesh.points)
            height = float(points[:, 2].min()) - top
            if abs(height) > RISE and not _within(points, _points(recorded, "receiver")):
                listed = ", ".join(map(str, sorted(body.instance_ids)))
                yield f"instance {listed} was put {_side(height)} the table"


@memo.last
def _unborne(scene: Scene) -> str:
    """Why what the robot acts on cannot stand on the table, empty if it can or nothing is known of it.

    It stands there through whatever is below it: the receiver, and small things. A table that a person settled is not
    doubted, and what the gripper holds from the first frame stands nowhere.
    """
    top, group = _top(scene), _acted_on(scene)
    if top is None or not len(group) or _settled(scene, "table"):
        return ""
    path = scene.episode.robot.gripper_to_world
    if path is not None and _within(path[:1, :3, 3], _points(scene, "manipulated")):
        return ""
    others = [
        points
        for body in scene.tracked
        for one in body.instance_ids - scene.roles["table"]
        if len(points := _surface(scene, one)[0]) and not _bears(*_surface(scene, one))
    ]
    low, high = _box(group)
    more = True
    while more:
        more = False
        for points in others:
            below, above = _box(points)
            over = (below[:2] < high[:2]).all() and (low[:2] < above[:2]).all()
            if over and below[2] < low[2] - 1e-6 and above[2] > low[2] - RISE:
                low, high, more = np.minimum(low, below), np.maximum(high, above), True
    if low[2] - top > RISE:
        return f"what the robot moves was seen no lower than {_side(low[2] - top)} the table"
    if top - high[2] > RISE:
        return f"what the robot moves lies {_side(high[2] - top)} the table"
    return ""


def _settled(scene: Scene, role: str) -> bool:
    """Whether a person said what the role is: then it is not doubted."""
    return role in scene.beliefs and scene.beliefs[role].confidence == 1


def _side(height: float) -> str:
    return f"{100 * abs(height):.0f} cm {'above' if height > 0 else 'below'}"


def _top(scene: Scene) -> float | None:
    """The height of the table's level surface, metres; None where none was seen."""
    found = [_surface(scene, one) for one in sorted(scene.roles.get("table", ()))]
    level = [points[_level(normals), 2] for points, normals in found]
    heights = np.concatenate(level) if level else np.zeros(0)
    return float(np.median(heights)) if len(heights) else None


def _bears(points: Points, normals: Points) -> bool:
    """Is it so level and broad that others stand on it, as on a table?"""
    level, broad = BEARS
    low, high = _box(points)
    faces = np.linalg.norm(normals, axis=-1) > 0
    return bool(_level(normals).sum() > level * faces.sum() and (high - low)[:2].min() > broad)


def _level(normals: Points) -> Bool[np.ndarray, "n"]:
    return np.abs(normals[:, 2]) > 0.95


def _acted_on(scene: Scene) -> Points:
    """What was seen of the manipulated and of its receiver, where that is not the table."""
    found = _points(scene, "manipulated")
    if scene.roles.get("receiver") == scene.roles.get("table"):
        return found
    return np.concatenate([found, _points(scene, "receiver")])


def _points(scene: Scene, role: str) -> Points:
    """What was seen of a role, in the world at the first frame."""
    found = [_surface(scene, one)[0] for one in sorted(scene.roles.get(role, ()))]
    return np.concatenate([np.zeros((0, 3)), *found])


def _surface(scene: Scene, instance_id: int) -> tuple[Points, Points]:
    """Points and normals of what was seen of an instance, in the world at the first frame."""
    body = next((body for body in scene.tracked if instance_id in body.instance_ids), None)
    if body is None:
        return np.zeros((0, 3)), np.zeros((0, 3))
    return _seen(scene.episode, body, instance_id)


@memo.of_episode
def _seen(episode: Episode, body: Body, instance_id: int) -> tuple[Points, Points]:
    points, normals = observed.surface(look(episode), instance_id, body)
    return geometry.transform(body.to_world[0], points), normals @ body.to_world[0][:3, :3].T


def _box(points: Points) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    low, high = np.percentile(points, [1, 99], axis=0)
    return low, high


def _within(points: Points, others: Points) -> bool:
    """Do they lie between the others, or on them?"""
    if not len(others):
        return False
    (low, high), (below, above) = _box(points), _box(others)
    return bool(
        (low[:2] < above[:2]).all() and (below[:2] < high[:2]).all() and low[2] < above[2] + RISE
    )


@memo.last
def _workspace(scene: Scene) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]] | None:
    """The box around the gripper's path and what it acts on, None where the path is not known."""
    path = scene.episode.robot.gripper_to_world
    return None if path is None else _box(np.concatenate([path[:, :3, 3], _acted_on(scene)]))


def _at_work(scene: Scene, name: str, t: int) -> Bool[np.ndarray, "h w"]:
    """Pixels that show the workspace, the box around the gripper's path and what it acts on; all of them where depth or
    path are not known."""
    box = _workspace(scene)
    return _within_box(scene.episode, name, t, box and tuple(tuple(side) for side in box))


@memo.of_episode
def _within_box(
    episode: Episode, name: str, t: int, box: tuple[tuple[float, ...], ...] | None
) -> Bool[np.ndarray, "h w"]:
    view = episode.views[name]
    depth = surface.depth_of(view, t)
    if depth is None or box is None or not view.camera.placed:
        return np.ones((view.camera.height, view.camera.width), bool)
    low, high = map(np.array, box)
    points = geometry.world_points(depth.astype(np.float64), view.camera, t)
    return (depth > 0) & (points > low - REACH).all(-1) & (points < high + REACH).all(-1)
