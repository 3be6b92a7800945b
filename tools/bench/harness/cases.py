"""How each factor is recorded, and how its truth is put to the operator that imitates it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.assets import library
from rpaug.core import geometry
from rpaug.core.interfaces import Edit
from rpaug.core.types import Episode
from rpaug.operators import insert as inserting
from rpaug.operators.distractors import Distractors
from rpaug.operators.shadows import Shadows
from rpaug.scene import build
from rpaug.scene.lighting import albedo, light, rig, shadows
from rpaug.twin import LAMPS, RIG, Laid, Take, TwinLamp
from rpaug.twin.look import Extra
from rpaug.twin.mjcf import AMBIENT
from tools.bench.harness import baselines, truths
from tools.bench.harness.truths import CYLINDER

TOLD, ESTIMATED = "rpaug", "rpaug, estimated"


Colors = dict[int | None, tuple[Any, Any]]
"""Old and new color by instance id; None stands for all pixels."""


@dataclass(frozen=True)
class Ask:
    """One way to ask for the true change: the operator's fields, once or several times, and the edit where no draw of
    theirs is the true one."""

    method: str
    steps: tuple[Mapping[str, Any], ...]
    edit: Edit | None = None


@dataclass(frozen=True)
class FactorCase:
    """A factor's operator, what it is asked, and which parts are changed under which lamps.

    `ask` gets the recording, its truly changed version, and a folder for images. `colors` gives what a 2D recoloring
    goes by, old and new by handle: the old ones known, or read off the recording as `rpaug, estimated` does.
    `targets` are taken in turn. `value` draws the true change where the twin does not, `truth` makes it where it is no
    factor of the twin, and `baseline` is what is done to single pictures by those who know as much. Some are measured
    under cast `shadows` alone: they need lamps told.
    """

    operator: str
    ask: Callable[[Take, Take, Path], tuple[Ask, ...]]
    colors: Callable[[Take, Take, bool], Colors] | None = None
    lamps: tuple[TwinLamp, ...] = RIG
    targets: tuple[str | None, ...] = (None,)
    value: Callable[[Take], Any] | None = None
    truth: Callable[[Take], Take] | None = None
    baseline: tuple[str, Callable[[Take, Take], Episode]] | None = None
    shadows: bool = False


def _recolor(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    (instance_id,) = true.truth.changed
    fields = {"target": {"handle": instance_id}, "color": {"rgb": true.truth.albedos[instance_id]}}
    given = fields | {"albedo": recorded.truth.albedos[instance_id]}
    return Ask(TOLD, (given,)), Ask(ESTIMATED, (fields,))


def _table_color(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    (instance_id,) = true.truth.changed
    new = true.truth.albedos[instance_id]
    fields = {"target": {"handle": instance_id}, "range": (new, new)}
    given = fields | {"albedo": recorded.truth.albedos[instance_id]}
    return Ask(TOLD, (given,)), Ask(ESTIMATED, (fields,))


def _texture(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    """The very image in its very place, on the parts that some camera shows."""
    laid = next(iter(true.truth.covers.values()))
    (folder / laid.file).write_bytes(true.side()[laid.file])
    shown = sorted(_seen(recorded) & set(true.truth.changed))
    fields = {
        "textures": str(folder),
        "texture": laid.file,
        "scale": laid.cover.side,
        "mapping": "box",
        "repeat": "wrap",
        **_frame(laid),
    }
    given = [
        fields | {"target": {"handle": instance_id}, "albedo": recorded.truth.albedos[instance_id]}
        for instance_id in shown
    ]
    return Ask(TOLD, tuple(given)), Ask(ESTIMATED, (fields | {"target": {"handle": shown}},))


def _light_color(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    old, new = true.truth.light
    given, estimated = {"range": (new, new), "recorded": old}, {"range": (new, new)}
    return Ask(TOLD, (given,)), Ask(ESTIMATED, (estimated,))


def _lamp_color(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    """The lamp that stands nearest to where the changed one truly does, of those that are found."""
    lamp = _changed_lamp(recorded, true)
    known = shadows.relit(build.build(recorded.episode, with_bodies=True))
    number = 1
    if known is not None:
        nearest = int(np.argmax(np.array(known.recorded.directions) @ _towards(lamp)))
        number += rig.chosen(known.recorded, "all").index(nearest)
    old = recorded.truth.new.light
    new = tuple(np.multiply(old, lamp.gain).tolist())
    return (Ask(ESTIMATED, ({"range": (new, new), "recorded": old, "lamp": number},)),)


def _level_ground(recorded: Take, true: Take, known: bool) -> Colors:
    """What white level ground looks like before and after."""
    lamp, up = _changed_lamp(recorded, true), [_towards(one)[2] for one in recorded.truth.new.lamps]
    share = LAMPS[0] * _towards(lamp)[2] / (AMBIENT + LAMPS[0] * sum(up))
    return {None: ((1.0, 1.0, 1.0), tuple(1 + share * (np.array(lamp.gain) - 1)))}


def _changed_lamp(recorded: Take, true: Take) -> TwinLamp:
    both = zip(recorded.truth.new.lamps, true.truth.new.lamps, strict=True)
    (found,) = (new for old, new in both if new != old)
    return found


def _light_direction(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    (old,), (new,) = true.truth.old.lamps, true.truth.new.lamps
    fields = {"to": _towards(new)}
    share = AMBIENT / (AMBIENT + LAMPS[0])
    given = fields | {"recorded": _towards(old), "ambient": share}
    return Ask(TOLD, (given,)), Ask(ESTIMATED, (fields,))


def _camera_pose(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    edit = {
        name: {"turn": list(bump.turn), "shift": list(bump.shift)}
        for name, bump in true.truth.bumps.items()
    }
    return (Ask(TOLD, ({"camera": list(edit)},), edit),)


def _remove(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    return (Ask(TOLD, ({"target": {"handle": list(true.truth.changed)}},)),)


def _object_size(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    (instance_id,) = true.truth.changed
    scale = _scale(true)
    return (Ask(TOLD, ({"target": {"handle": instance_id}, "range": (scale, scale)},)),)


def _scale(true: Take) -> float:
    (scale,) = true.truth.new.scales.values()
    return scale


def _drawn_place(take: Take) -> tuple[float, ...]:
    """Where `move` puts the cylinder, as a shift in its frame. Raises RpaugError where no place is free."""
    return truths.shift(take, truths.drawn(truths.moving(take), take)["motion"])


def _move(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    (instance_id,) = true.truth.changed
    fields = {"target": {"handle": instance_id}, "turn": 0.0}
    return (Ask(TOLD, (fields,), truths.drawn(truths.moving(recorded), recorded)),)


def _duplicate(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    fields = {"target": {"handle": recorded.truth.handles[CYLINDER]}, "turn": 0.0}
    return (Ask(TOLD, (fields,), truths.drawn(truths.doubling(recorded), recorded)),)


def _spread(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    return (Ask(TOLD, ({"turn": 0.0},), truths.drawn(truths.SPREADING, recorded)),)


def _shadows_fainter(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    return (Ask(ESTIMATED, ({"depth": (truths.FAINTER, truths.FAINTER)},)),)


def _shadows_turned(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    """The lamps that it finds, turned as the true ones."""
    fields = {"depth": (1.0, 1.0), "turn": truths.TURNED}
    edit = truths.drawn(Shadows(depth=(1.0, 1.0)), recorded)
    lamps = shadows.rig_of(edit["lamps"]["recorded"])
    now = shadows.plain(rig.turned(lamps, truths.TURNED, 1.0))
    return (Ask(ESTIMATED, (fields,), edit | {"lamps": edit["lamps"] | {"now": now}}),)


def drawn_things(take: Take) -> tuple[Extra, ...]:
    """Two things of the library where `distractors` would put them."""
    scene = build.build(take.episode, with_bodies=True)
    drawn = Distractors().sample(scene, np.random.default_rng(take.truth.seed))
    return tuple(map(_extra, drawn["things"]))


def _extra(thing: Edit) -> Extra:
    mesh = library.mesh(thing["asset"])
    return Extra(
        name=f"{thing['asset']}-{thing['handle']}", handle=thing["handle"], points=mesh.points, normals=mesh.normals,
        uv=mesh.uv, faces=mesh.faces, image=mesh.image, pose=np.array(thing["pose"]),
    )  # fmt: skip


def _distractors(recorded: Take, true: Take, folder: Path) -> tuple[Ask, ...]:
    """The very things in their very places; how they are lit is estimated."""
    things = [
        {
            "asset": extra.name.rpartition("-")[0],
            "scale": 1.0,
            "handle": extra.handle,
            "pose": extra.pose.tolist(),
        }
        for extra in true.truth.new.extras
    ]
    found = inserting.light(build.build(recorded.episode, with_bodies=True))
    return (Ask(TOLD, ({},), {"things": things, **found}),)


def _albedos(recorded: Take, true: Take, known: bool) -> Colors:
    old, new = recorded.truth.albedos, true.truth.albedos
    shown = [
        instance_id for instance_id in true.truth.changed if known or instance_id in _seen(recorded)
    ]
    return {
        instance_id: (
            old[instance_id] if known else _guess(recorded, instance_id),
            new[instance_id],
        )
        for instance_id in shown
    }


def _guess(recorded: Take, instance_id: int) -> tuple[float, float, float]:
    return albedo.estimate(albedo.pixels(recorded.episode, instance_id)).rgb


def _lights(recorded: Take, true: Take, known: bool) -> Colors:
    """What a white surface, fully lit, looks like before and after."""
    old, new = true.truth.light
    if not known:
        red, green, blue = light.estimate(recorded.episode).tolist()
        old = (red, green, blue)
    return {None: ((1.0, 1.0, 1.0), tuple(np.divide(new, old)))}


CASES: Mapping[str, FactorCase] = {
    "object_color": FactorCase("recolor", _recolor, _albedos, targets=("manipulated", "receiver")),
    "object_texture": FactorCase(
        "retexture", _texture, _albedos, targets=("manipulated", "receiver")
    ),
    "light_color": FactorCase("light_color", _light_color, _lights),
    "lamp_color": FactorCase("light_color", _lamp_color, _level_ground, shadows=True),
    # One lamp: the operator's model, whose error is then that of faces and shadows alone.
    "light_direction": FactorCase("light_direction", _light_direction, lamps=RIG[:1]),
    "table_color": FactorCase("table_color", _table_color, _albedos),
    "table_texture": FactorCase("table_texture", _texture, _albedos),
    "background_texture": FactorCase("background_texture", _texture, _albedos),
    "camera_pose": FactorCase("camera_pose", _camera_pose),
    "removal": FactorCase(
        "remove",
        _remove,
        baseline=(
            "inpainting each picture",
            lambda recorded, true: baselines.painted(
                recorded.episode, frozenset(true.truth.changed)
            ),
        ),
    ),
    "object_size": FactorCase(
        "object_size",
        _object_size,
        targets=(CYLINDER,),
        baseline=(
            "scaling in each picture",
            lambda recorded, true: baselines.scaled(
                recorded.episode, true.truth.changed[0], _scale(true)
            ),
        ),
    ),
    "object_place": FactorCase("move", _move, targets=(CYLINDER,), value=_drawn_place),
    "duplicate": FactorCase("duplicate", _duplicate, truth=truths.duplicated),
    "spread": FactorCase("spread", _spread, truth=truths.spread),
    "shadows_fainter": FactorCase("shadows", _shadows_fainter, truth=truths.fainter, shadows=True),
    "shadows_turned": FactorCase("shadows", _shadows_turned, truth=truths.turned, shadows=True),
    "distractor": FactorCase(
        "distractors",
        _distractors,
        value=drawn_things,
        baseline=(
            "pasting into each picture",
            lambda recorded, true: baselines.pasted(recorded.episode, true.truth.new.extras),
        ),
    ),
}


def _seen(take: Take) -> set[int]:
    """Handles that some camera shows; a room has walls behind its cameras."""
    views = [view for view in take.episode.views.values() if view.ids is not None]
    return {
        int(instance_id)
        for view in views
        for t in range(take.episode.length)
        for instance_id in np.unique(view.ids(t))  # type: ignore[misc]
    }


def _frame(laid: Laid) -> dict[str, list[float]]:
    """Origin and rotation vector of the image's frame in the world of frame 0."""
    pose = np.array(laid.body_to_world)
    xyzw = geometry.quaternion_of(pose)
    sine = float(np.linalg.norm(xyzw[:3]))
    turn = 2 * np.arctan2(sine, xyzw[3]) * xyzw[:3] / max(sine, 1e-12)
    return {"origin": pose[:3, 3].tolist(), "turn": turn.tolist()}


def _towards(lamp: TwinLamp) -> tuple[float, float, float]:
    along = np.cos(lamp.height)
    direction = along * np.cos(lamp.heading), along * np.sin(lamp.heading), np.sin(lamp.height)
    return float(direction[0]), float(direction[1]), float(direction[2])
