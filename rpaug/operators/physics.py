"""Leave a thing to physics: it falls, bends, pours or topples as its material would."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field

from rpaug.core.errors import RpaugError, Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator
from rpaug.core.types import Effect, Scene
from rpaug.operators.fields import Interval
from rpaug.physics import materials, simulate
from rpaug.physics.materials import Law, Material
from rpaug.physics.simulate import SimulationSetting
from rpaug.scene.lighting import shadows
from rpaug.scene.placement import untouched
from rpaug.scene.targets import targets

LAWS = Literal["elastic", "jelly", "plasticine", "sand"]
SPEED = 10.0  # m/s


def _allowed(name: str) -> Any:
    """A number, or none, within the range that materials have."""

    def check(value: float | None) -> float | None:
        if value is not None:
            try:
                materials.check(name, value)
            except RpaugError as error:
                raise ValueError(str(error)) from None
        return value

    return Annotated[float | None, AfterValidator(check)]


def _known(name: str | None) -> str | None:
    if name is not None:
        try:
            materials.named(name)
        except RpaugError as error:
            raise ValueError(str(error)) from None
    return name


def _low(value: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= value[0] <= value[1] <= 0.5:
        raise ValueError(f"{list(value)} is not within 0..0.5 metres")
    return value


def _whole(scene: Scene, instance_ids: frozenset[int]) -> frozenset[int]:
    """The instance ids with those that were seen to move with them: a drawer has its grip with it."""
    moving = [body.instance_ids for body in scene.tracked if body.motion != "static"]
    return instance_ids.union(*(one for one in moving if one & instance_ids))


Component = Annotated[float, Field(ge=-SPEED, le=SPEED)]


@dataclass(frozen=True, kw_only=True)
class Physics(Operator):
    """Simulate `target` from the first frame on, made of `material`, of values given here, or of what `vision` sees.

    It is let go `height` metres (drawn) above where it stands, at `velocity`; what is held, as a drawer on its rails,
    stays held unless it is `loose`. The robot goes on as it was recorded: if
    it touches the thing, or did in the recording, the actions are marked as no longer valid. Without a target one thing
    that the robot leaves alone is drawn.
    """

    target: targets.Target | None = None
    material: Annotated[str | None, AfterValidator(_known)] = None
    vision: str | None = None
    law: LAWS | None = None
    density: _allowed("density") = None  # type: ignore[valid-type]
    young: _allowed("young") = None  # type: ignore[valid-type]
    poisson: _allowed("poisson") = None  # type: ignore[valid-type]
    yield_stress: _allowed("yield_stress") = None  # type: ignore[valid-type]
    inner_friction: _allowed("friction") = None  # type: ignore[valid-type]
    viscosity: _allowed("viscosity") = None  # type: ignore[valid-type]
    height: Annotated[Interval[float], AfterValidator(_low)] = (0.0, 0.0)
    velocity: tuple[Component, Component, Component] = (0.0, 0.0, 0.0)
    gravity: Annotated[float, Field(ge=0, le=30)] = 9.81
    friction: Annotated[float, Field(ge=0, le=5)] = 0.5
    grip: Annotated[float, Field(ge=0, le=5)] = 1.0
    loose: bool = False
    fps: Annotated[float, Field(gt=0, le=1000)] = 20.0
    particles: Annotated[int, Field(ge=100, le=200_000)] = 6000

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(targets=("target",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "physics": "behave, behaves, act, acts, treat, simulate, physics, physically",
    }
    phrases: ClassVar[tuple[str, ...]] = (
        "(make|let|have) {target} (behave|act|fall|move|bend) (like|as) {material:rubber|jelly|sand|foam|cloth}",
        "(simulate|treat) {target} (as|like) {material:rubber|jelly|sand|foam|cloth}",
    )
    examples: ClassVar[Examples] = (
        ("let the green can melt like jelly", {"target": "green can", "material": "jelly"}),
        (
            "drop the block from 10 cm as if of rubber",
            {"target": "block", "material": "rubber", "height": [0.1, 0.1]},
        ),
    )
    settles: ClassVar[str] = "material"

    def __post_init__(self) -> None:
        if self.target is not None and self.target.role in ("table", "robot", "background"):
            raise ValueError(
                f"target: things on the table are simulated, not the {self.target.role}"
            )

    def ready(self) -> None:
        if self.material is None and self.vision is None and self.young is None:
            raise Unsupported(
                f"physics of {self.target or 'a thing'}: say its material, one of {', '.join(materials.shipped())}; "
                "or its young (and law, density, poisson); or, as vision, a folder with a CLIPModel that tells it from "
                "pictures"
            )
        if self.vision is not None and self.material is None:
            from rpaug.providers.clip import Clip

            Clip.load(Path(self.vision))

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        self.ready()
        target = untouched.pick(scene, self.target, rng, "simulating")
        instance_ids = _whole(scene, targets.find(scene, target))
        untouched.check_seen(scene, target, "simulating")
        for role in ("robot", "table", "background"):
            if instance_ids & scene.roles.get(role, frozenset()):
                raise Unsupported(f"simulating {target}: it is the {role}")
        name = self.material or self._recognised(scene, instance_ids)
        made_of = asdict(self._made_of(name))
        return {
            "handles": sorted(instance_ids),
            "name": name,
            "material": {**made_of, "law": Law(made_of["law"]).name.lower()},
            "height": float(rng.uniform(*self.height)),
            "acted": _acted(scene, instance_ids, target),
            "lamps": shadows.lamps(scene),
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        values = {**edit["material"], "law": Law[edit["material"]["law"].upper()]}
        how = SimulationSetting(
            material=Material(**values),
            height=edit["height"],
            velocity=self.velocity,
            gravity=self.gravity,
            fps=self.fps,
            particles=self.particles,
            friction=self.friction,
            grip=self.grip,
            loose=self.loose,
        )
        after = simulate.simulated(scene, frozenset(edit["handles"]), how, edit["acted"])
        return shadows.follow(scene, after, edit["lamps"])

    def _made_of(self, name: str | None) -> Material:
        """The named material with what is given here instead of its own values."""
        base = asdict(materials.named(name) if name is not None else Material())
        given: dict[str, Any] = {
            "law": None if self.law is None else Law[self.law.upper()],
            "density": self.density,
            "young": self.young,
            "poisson": self.poisson,
            "yield_stress": self.yield_stress,
            "friction": self.inner_friction,
            "viscosity": self.viscosity,
        }
        return Material(**base | {k: value for k, value in given.items() if value is not None})

    def _recognised(self, scene: Scene, instance_ids: frozenset[int]) -> str | None:
        """What the vision model takes the thing to be made of, None if it is not asked."""
        if self.vision is None:
            return None
        from rpaug.providers.clip import Clip

        names = tuple(materials.shipped())
        asked = [f"a photo of a thing made of {name}" for name in names]
        picture = simulate.portrait(scene, instance_ids)
        return names[Clip.load(Path(self.vision)).closest(picture, asked)]


def _acted(scene: Scene, instance_ids: frozenset[int], target: targets.Target) -> str | None:
    """Why the recorded actions depend on where the thing is, None if they do not."""
    try:
        untouched.check(scene, instance_ids, target, "simulating")
    except Unsupported as error:
        return str(error)
    return None
