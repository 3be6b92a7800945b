"""What things are made of: density, stiffness, and how they yield. The shipped ones are in recipes/materials.yaml."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from rpaug.core.errors import Unsupported, there_are


class Law(IntEnum):
    """How stress follows from deformation, and what of it stays."""

    ELASTIC = 0  # all of it comes back
    JELLY = 1  # elastic, and viscous: its inner motion dies down
    PLASTICINE = 2  # yields beyond a stress (von Mises) and keeps its new shape
    SAND = 3  # holds together by friction alone (Drucker-Prager)


RANGES: Mapping[str, tuple[float, float]] = {
    "density": (10.0, 20000.0),  # kg/m3
    "young": (1e2, 5e11),  # Pa
    "poisson": (0.0, 0.49),
    "yield_stress": (0.0, 1e12),  # Pa
    "friction": (0.0, 60.0),  # degrees
    "viscosity": (0.0, 1e4),  # Pa s
}
FILE = "materials.yaml"


@dataclass(frozen=True, kw_only=True)
class Material:
    """Density in kg/m3, Young's modulus and yield stress in Pa, Poisson's ratio, inner friction in degrees, viscosity
    in Pa s.

    `yield_stress` is plasticine's alone, `friction` sand's, `viscosity` jelly's. Raises Unsupported for values out of
    `RANGES`.
    """

    law: Law = Law.ELASTIC
    density: float = 1000.0
    young: float = 1e5
    poisson: float = 0.3
    yield_stress: float = 0.0
    friction: float = 30.0
    viscosity: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name in RANGES:
                check(field.name, getattr(self, field.name))

    @property
    def shear(self) -> float:
        """Lame's second parameter, mu, in Pa."""
        return self.young / (2 * (1 + self.poisson))

    @property
    def volumetric(self) -> float:
        """Lame's first parameter, lambda, in Pa."""
        return self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson))

    @property
    def sound(self) -> float:
        """Speed of pressure waves in m/s: what limits an explicit step."""
        return float(np.sqrt((self.volumetric + 2 * self.shear) / self.density))

    @property
    def limit(self) -> float:
        """What the law yields at: stress in Pa (plasticine), Drucker-Prager's alpha (sand)."""
        if self.law is Law.SAND:
            sine = np.sin(np.deg2rad(self.friction))
            return float(np.sqrt(2 / 3) * 2 * sine / (3 - sine))
        return self.yield_stress


def check(name: str, value: float) -> None:
    """Raises Unsupported, with the range, for a value that is not allowed."""
    low, high = RANGES[name]
    if not (np.isfinite(value) and low <= value <= high):
        raise Unsupported(f"{name} {value:g}: allowed are {low:g} to {high:g}")


@cache
def shipped() -> Mapping[str, Material]:
    """Every material that ships, by name."""
    import rpaug_recipes

    described = yaml.safe_load((Path(rpaug_recipes.__file__).parent / FILE).read_bytes())
    return {name: _read(values) for name, values in described.items()}


def _read(values: Mapping[str, object]) -> Material:
    numbers = {name: float(str(values[name])) for name in RANGES if name in values}
    return Material(law=Law[str(values["law"]).upper()], **numbers)


def named(name: str) -> Material:
    """The shipped material of that name. Raises Unsupported listing those there are."""
    if name not in shipped():
        raise Unsupported(f"no material is called {name!r}; {there_are(name, shipped())}")
    return shipped()[name]
