"""Which carrier shows each camera: the lowest tier that can, and which parts of the scene must be known for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rpaug.interfaces import Operator
from rpaug.scene.targets import Target
from rpaug.types import Effect, Episode, Scene

TIERS = {0: "recorded pixels", 1: "surfels", 3: "Gaussians"}
GEOMETRY = Effect.CAMERA | Effect.DEPTH | Effect.MASK | Effect.BODIES

# Rough figures of a 2-core machine, for --dry-run: seconds per million rendered pixels, and per fit.
SECONDS = {0: 0.3, 1: 2.0, 3: 1.0}
SECONDS_READ = 0.1
SECONDS_BODIES = 3.0
SECONDS_FIT = 90.0
BYTES_A_PIXEL = 3.7  # rgb, depth and mask as PNG, measured on RLBench episodes


@dataclass(frozen=True)
class Plan:
    """`tier` is the least tier wanted, `carriers` the tier that shows each camera, `bodies` whether instances must
    be told apart and tracked, `parts` the targets of which a part finer than the masks is meant."""

    tier: int
    carriers: dict[str, int]
    bodies: bool
    parts: tuple[Target, ...] = ()

    def describe(self) -> dict[str, Any]:
        """Plain values for the report and for people."""
        carriers = {name: f"tier {tier}, {TIERS[tier]}" for name, tier in self.carriers.items()}
        return {"tier": self.tier, "carriers": carriers, "bodies": self.bodies}

    def cost(self, episode: Episode, copies: int) -> dict[str, float]:
        """Estimated seconds and megabytes of `copies` edited episodes."""
        seconds = SECONDS_BODIES * self.bodies + SECONDS_FIT * (3 in self.carriers.values())
        size = 0.0
        for name, view in episode.views.items():
            megapixels = view.camera.width * view.camera.height * episode.length / 1e6
            seconds += megapixels * (SECONDS_READ + copies * SECONDS[self.carriers[name]])
            size += copies * megapixels * BYTES_A_PIXEL
        return {"seconds": round(seconds, 1), "megabytes": round(size, 1)}


def make(operators: Sequence[Operator], episode: Episode, tier: int = 0) -> Plan:
    """The plan for all these operators together, before anything is drawn.

    Appearance edits stay in cameras where they were recorded: tier 0. A moved camera sees surfaces that its own
    recording may lack: tier 1. Assets (tier 2) are shown by the surfels' z-buffer. `tier` is the least one wanted.
    """
    geometry = any(operator.effect & GEOMETRY for operator in operators)
    targets = [getattr(operator, "target", None) for operator in operators]
    parts = tuple(t for t in targets if isinstance(t, Target) and t.part is not None)
    targeted = any(target is not None for target in targets)
    carrier = _carrier(geometry, tier)
    carriers = dict.fromkeys(episode.views, carrier)
    return Plan(tier, carriers, bodies=targeted or carrier > 0, parts=tuple(dict.fromkeys(parts)))


def settle(plan: Plan, scene: Scene) -> Plan:
    """The plan of one edited scene: rendered anew is only what shows a move, of its camera or of bodies."""
    edited = scene.recorded_bodies is not None
    carriers = {
        name: _carrier(edited or scene.cameras[name] is not view.camera, plan.tier)
        for name, view in scene.episode.views.items()
    }
    return Plan(plan.tier, carriers, plan.bodies, plan.parts)


def _carrier(moved: bool, tier: int) -> int:
    if tier >= 3:
        return 3
    return 1 if moved or tier >= 1 else 0
