"""Move the lamp: faces that turn towards where it now stands are lit, others are left to the ambient light."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float32, Float64, Int32
from pydantic import Field

from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Relit, Scene, Surface
from rpaug.operators.fields import Unit
from rpaug.scene.lighting import highlights, light, rig, shadows
from rpaug.scene.lighting.highlights import Highlights
from rpaug.scene.lighting.light import Lamp

Direction = tuple[float, float, float]
LOWEST = 0.15  # sine of the height above the horizon: no lamp is put lower
MOST_GAIN = 3.0  # what the old lamp hardly lit was recorded as noise

# Of the things' variation in brightness. Real and foreign recordings have 0.22 to 0.48, the twin with one lamp 0.09 to
# 0.21, with three 0.04 to 0.11: then edits are further from the truth than none.
TOLD = 0.1
GREY = np.full(3, 1 / 3, np.float32)
ROOM = 1.1  # times a thing's brightest: what noise and highlights may add


@dataclass(frozen=True)
class Relight:
    """Every pixel times what the new lamp gives its face over what the old one gave it (Lambert, no shadows).

    Highlights that are known are taken off before, and what is mirrored of the lamps `mirrored` now is put on.

    `brightest` is how bright each thing is straight below the lamp. A pixel brighter than its thing could be under the
    old lamp lies on a face too narrow for its normal to be known, and is not made brighter still. What is `unlit` shows
    no surface and keeps its color.
    """

    old: Lamp
    new: Lamp
    brightest: tuple[tuple[int, float], ...]
    unlit: tuple[int, ...] = ()
    instance_ids: frozenset[int] | None = None
    mirrored: Highlights | None = None

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        facing, shone = surface.facing, surface.mirrored if self.mirrored else None
        if shone is not None:
            color = np.maximum(color - np.nan_to_num(shone), 0)
        was = self.old.shading(facing)
        doubtful = color @ GREY > ROOM * self._most(surface.ids) * was
        gain = np.minimum(self.new.shading(facing) / was, np.where(doubtful, 1.0, MOST_GAIN))
        gain = np.where(np.isin(surface.ids, self.unlit), 1.0, gain).astype(np.float32)
        lit = color * gain[:, None]
        if self.mirrored is not None and shone is not None:
            lit += np.nan_to_num(self.mirrored.on(facing, surface.towards, surface.ids))
        return np.clip(lit, 0, 1).astype(np.float32)

    def _most(self, ids: Int32[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
        known, most = self._table
        place = np.minimum(np.searchsorted(known, ids), len(known) - 1)
        return np.where(known[place] == ids, most[place], np.float32(np.inf))

    @cached_property
    def _table(self) -> tuple[Int32[np.ndarray, "k"], Float32[np.ndarray, "k"]]:
        instance_ids, most = zip(*self.brightest, strict=True)
        return np.array(instance_ids, np.int32), np.array(most, np.float32)


@dataclass(frozen=True, kw_only=True)
class LightDirection(Operator):
    """Turn the dominant lamp by up to `turn` about the scene, or set it at `to`, and scale every pixel accordingly.

    `recorded` is the direction to the lamp the episode was lit by, in the world; `ambient` the share of the light that
    comes from nowhere in particular. Both are estimated from how brightness depends on the faces' normals if not
    given. Where moving shadows tell the lamps, all of them turn as the strongest does, and their shadows are cast
    anew; else cast shadows stay where they were. Where highlights tell the lamps and shadows do not, the strongest of
    those is the lamp, and what surfaces mirror goes along; else highlights stay.
    """

    turn: Annotated[float, Field(gt=0, le=np.pi)] = 0.8  # radians, at most
    to: Direction | None = None
    recorded: Direction | Literal["estimate"] = "estimate"
    ambient: Unit | Literal["estimate"] = "estimate"

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(depth=True, lamps=True)
    asked_as: ClassVar[Mapping[str, str]] = {
        "lit": "direction, light direction, light dir, lamp direction, azimuth, lamp position, "
        "light position, lamp angle, light angle, elevation",
    }
    phrases: ClassVar[tuple[str, ...]] = ("move the lamp", "turn the lamp by up to {turn:angle}")
    examples: ClassVar[Examples] = (
        ("let the lamp shine from somewhere else", {"turn": 0.8}),
        ("light straight from above", {"to": [0, 0, 1]}),
    )
    undone_as: ClassVar[tuple[str, ...]] = (
        "light",
        "lights",
        "lighting",
        "lamp",
        "lamps",
        "illumination",
    )
    settles: ClassVar[str] = "light direction"

    def __post_init__(self) -> None:
        for name in ("to", "recorded"):
            value = getattr(self, name)
            if isinstance(value, tuple) and np.linalg.norm(value) < 1e-6:
                raise ValueError(f"{name}: a direction has a length")
        if self.ambient == 0:
            raise ValueError("ambient: must exceed 0, or faces turned away were recorded black")

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        known = shadows.relit(scene)
        if known is not None:
            return self._cast(scene, known, rng)
        shone, matte = highlights.find(scene), highlights.matte(scene)
        found = light.dominant(matte, shone.lamps.strongest if shone else None)
        old = _unit(found.direction if self.recorded == "estimate" else self.recorded)
        ambient = found.ambient if self.ambient == "estimate" else self.ambient
        new = _unit(self.to) if self.to is not None else _near(old, self.turn, rng)
        brightest = light.brightest(matte, Lamp(tuple(old), ambient, 1.0))
        mirrored = {} if shone is None else {"mirrored": shone.turned(*_turn(old, new)).plain()}
        return {
            **mirrored,
            "brightest": [
                [instance_id, round(value, 4)] for instance_id, value in sorted(brightest.items())
            ],
            "recorded": old.tolist(),
            "direction": new.tolist(),
            "ambient": ambient,
            "explained": round(found.explained, 4),
            "unlit": list(light.unlit(scene.episode)),
        }

    def _cast(self, scene: Scene, known: Relit, rng: np.random.Generator) -> Edit:
        """Lamps whose shadows are known: where they now stand."""
        lamps = known.now
        if self.recorded != "estimate":
            lamps = rig.nearest_at(lamps, _unit(self.recorded))
        if self.ambient != "estimate":
            lamps = rig.with_ambient(lamps, self.ambient)
        before = replace(known, recorded=lamps) if known.now == known.recorded else known
        old = _unit(lamps.directions[int(np.argmax(lamps.strengths))])
        new = _unit(self.to) if self.to is not None else _near(old, self.turn, rng)
        now = rig.turned(lamps, *_turn(old, new))
        return {
            "recorded": old.tolist(),
            "direction": new.tolist(),
            "lamps": {"recorded": shadows.plain(before.recorded), "now": shadows.plain(now)},
            "unlit": list(light.unlit(scene.episode)),
        }

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        if "explained" not in edit or self.recorded != "estimate":
            return {}
        words = f"lamps are a guess: faces tell under {TOLD:.0%} of the brightness; `recorded` states one"
        return {words: (int(edit["explained"] < TOLD), 1)}

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        if "lamps" in edit:
            recorded, now = (shadows.rig_of(edit["lamps"][one]) for one in ("recorded", "now"))
            before = scene.relit or Relit(recorded, now, unlit=tuple(edit["unlit"]))
            return replace(scene, relit=replace(before, recorded=recorded, now=now))
        old = Lamp(tuple(edit["recorded"]), edit["ambient"], 1.0)
        new = Lamp(tuple(edit["direction"]), edit["ambient"], 1.0)
        brightest = tuple((instance_id, value) for instance_id, value in edit["brightest"])
        mirrored = Highlights.of(edit["mirrored"]) if "mirrored" in edit else None
        relight = Relight(old, new, brightest, tuple(edit["unlit"]), mirrored=mirrored)
        return replace(scene, appearance=(*scene.appearance, relight))


def _unit(direction: object) -> Float64[np.ndarray, "3"]:
    vector = np.array(direction, float)
    return vector / np.linalg.norm(vector)


def _turn(old: Float64[np.ndarray, "3"], new: Float64[np.ndarray, "3"]) -> tuple[float, float]:
    """About the vertical, radians, and how many times as high above the horizon."""
    heading = np.arctan2(new[1], new[0]) - np.arctan2(old[1], old[0])
    return float(heading), float(np.arcsin(new[2]) / np.arcsin(old[2]))


def _near(
    axis: Float64[np.ndarray, "3"], turn: float, rng: np.random.Generator
) -> Float64[np.ndarray, "3"]:
    """A direction drawn evenly from those within `turn` of `axis` that are not too low."""
    across = _unit(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    while True:
        cosine, around = rng.uniform(np.cos(turn), 1), rng.uniform(0, 2 * np.pi)
        sideways = np.cos(around) * across + np.sin(around) * np.cross(axis, across)
        drawn = cosine * axis + np.sqrt(1 - cosine**2) * sideways
        if drawn[2] >= min(LOWEST, axis[2]):
            return drawn
