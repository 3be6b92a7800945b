"""Things that deform, over time: explicit steps of the material point method, as short as the material asks for."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from rpaug.core.errors import Unsupported
from rpaug.physics import contact, transfer
from rpaug.physics.colliders import Still, Track, nothing
from rpaug.physics.materials import Law, Material
from rpaug.physics.stress import stress

COURANT = 0.4  # cells that a pressure wave may go in a step
SHORTEST = 2e-5  # seconds: what needs shorter steps is left to the rigid solver
STIFFENED = 0.3  # volume ratio: how much of a thing's stiffening under pressure shortens the step
PARTS = 2  # grids that particles are summed into: a constant, so that no result depends on threads
SERIAL = 3000  # particles below which threads cost more than they save
EDGE = 2  # cells around the box that particles are held in
WORK = 3  # cells around the particles that are worked on


def step_for(material: Material, cell: float) -> float:
    """The longest stable step in seconds of a thing at rest: waves, and viscosity spreading, cross less than a cell."""
    wave = COURANT * cell / material.sound
    if material.law is not Law.JELLY or material.viscosity == 0:
        return wave
    return min(wave, 0.1 * material.density * cell * cell / material.viscosity)


def too_stiff(material: Material, cell: float) -> str | None:
    """Why a material is left to the rigid solver, None if it is not."""
    step = step_for(material, cell)
    if step >= SHORTEST:
        return None
    return (
        f"Young's modulus {material.young:.3g} Pa in cells of {1000 * cell:.1f} mm needs steps of {step:.2g} s, "
        f"shorter than {SHORTEST:g} s"
    )


@dataclass
class Account:
    """What a simulation came to: steps done, particle-steps held at the edge of the grid or crushed, and the impulse
    that colliders gave, in newton seconds."""

    steps: int = 0
    clamped: int = 0
    crushed: int = 0
    still: Float64[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    boxes: Float64[np.ndarray, "b"] = field(default_factory=lambda: np.zeros(0))


@dataclass
class Soft:
    """Particles of one material: places, velocities, velocity gradients, elastic and whole deformation.

    It is changed by `run`. `grid` holds what stands still, and is the box that particles are held in; `boxes` are what
    moves. `friction` is Coulomb's on what stands still, `grip` that on boxes, negative to stick. Raises Unsupported for
    particles outside the box, and for a material whose stable step is shorter than SHORTEST.
    """

    x: Float64[np.ndarray, "n 3"]
    volume: Float64[np.ndarray, "n"]
    material: Material
    grid: Still
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    boxes: Track = nothing
    friction: float = 0.5
    grip: float = 1.0
    courant: float = COURANT
    threads: int = PARTS

    def __post_init__(self) -> None:
        n, cell = len(self.x), self.grid.cell
        if reason := too_stiff(self.material, cell):
            raise Unsupported(reason)
        self.x = np.array(self.x, float)
        self.v, self.C = np.zeros((n, 3)), np.zeros((n, 3, 3))
        self.F, self.D = np.tile(np.eye(3), (n, 1, 1)), np.tile(np.eye(3), (n, 1, 1))
        self.mass = self.material.density * np.asarray(self.volume, float)
        self._tau = np.zeros((n, 3, 3))
        self._radius = np.cbrt(np.asarray(self.volume, float)) / 2
        self._least, self._most = self.grid.origin + EDGE * cell, self.grid.most - EDGE * cell
        if ((self.x < self._least) | (self.x > self._most)).any():
            raise Unsupported("simulating: there are particles outside the box to simulate in")
        m = self.material
        self._law = np.full(n, int(m.law))
        self._values = tuple(
            np.full(n, value) for value in (m.shear, m.volumetric, m.limit, m.viscosity)
        )
        self._room, self._speed, self._seconds, self._least_ratio = np.zeros(0), 0.0, 0.0, 1.0
        self.account, self.elastic = Account(boxes=np.zeros(len(self.boxes(0.0)))), 0.0
        self._stress()

    def run(self, seconds: float) -> None:
        """Go on for so long."""
        with ThreadPoolExecutor(self.threads) as pool:
            apply: Any = map if self.threads < 2 or len(self.x) < SERIAL else pool.map
            left = seconds
            while left > 1e-12:
                dt = self._step_size()
                dt = left / np.ceil(left / dt - 1e-9)
                self._step(dt, apply)
                left -= dt

    def energy(self) -> tuple[float, float, float]:
        """Kinetic, elastic and potential energy in joules; the last is 0 at the world's origin."""
        kinetic = 0.5 * float((self.mass * (self.v**2).sum(1)).sum())
        return kinetic, self.elastic, -float((self.mass[:, None] * self.x @ self.gravity).sum())

    def momentum(self) -> Float64[np.ndarray, "3"]:
        """In newton seconds."""
        return (self.mass[:, None] * self.v).sum(0)

    def _step_size(self) -> float:
        """What waves and moving particles allow; a thing under pressure is stiffer."""
        share = self.courant / COURANT
        wave = share * step_for(self.material, self.grid.cell) * max(self._least_ratio, STIFFENED)
        self._box, self._speed = transfer.reach(self.x, self.v, 0, len(self.x))
        return min(wave, share * COURANT * self.grid.cell / max(self._speed, 1e-9))

    def _step(self, dt: float, apply: Callable[..., Any]) -> None:
        cell, n = self.grid.cell, len(self.x)
        low, high = self._box
        base = np.floor((low - self.grid.origin) / cell).astype(int) - WORK
        last = np.ceil((high - self.grid.origin) / cell).astype(int) + WORK
        base = np.maximum(base, 0)
        shape = np.minimum(last + 1, self.grid.distance.shape) - base
        grids = self._nodes((PARTS, *shape, 4))
        origin = self.grid.origin + cell * base
        list(apply(lambda k: self._scatter(grids[k], origin, dt, *_part(n, k)), range(PARTS)))
        slabs = [_part(int(shape[0]), k) for k in range(PARTS)]
        gravity = np.array(self.gravity)
        list(apply(lambda slab: contact.advance(grids, gravity, dt, *slab), slabs))
        boxes = np.ascontiguousarray(self.boxes(self._seconds))
        touched = np.zeros((2, *shape), bool)
        met = base, boxes, origin, cell, touched
        list(apply(lambda k: self._touching(met, *_part(n, k)), range(PARTS)))
        given, pushed = contact.collide(
            grids[0], touched, self.grid.distance, self.grid.normals, base, boxes,
            self.friction, self.grip, origin, cell, contact.TOUCH * float(self.mass.min()),
        )  # fmt: skip
        list(apply(lambda k: self._gather(grids[0], origin, dt, *_part(n, k)), range(PARTS)))
        self._seconds += dt
        account = self.account
        account.clamped += transfer.hold(self.x, self.v, self._least, self._most)
        account.still += given
        account.boxes += pushed
        account.steps += 1
        self._stress(apply)

    def _nodes(self, shape: tuple[int, ...]) -> Float64[np.ndarray, "k i j n 4"]:
        size = int(np.prod(shape))
        if self._room.size < size:
            self._room = np.empty(int(1.5 * size))
        nodes = self._room[:size]
        nodes[:] = 0.0
        return nodes.reshape(shape)

    def _scatter(self, nodes: Any, origin: Any, dt: float, low: int, high: int) -> None:
        cell = self.grid.cell
        transfer.scatter(
            self.x, self.v, self.C, self._tau, self.mass, nodes, origin, cell, dt, low, high
        )

    def _touching(self, met: tuple[Any, ...], low: int, high: int) -> None:
        still = self.grid
        contact.touching(self.x, self._radius, still.distance, still.normals, *met, low, high)

    def _gather(self, nodes: Any, origin: Any, dt: float, low: int, high: int) -> None:
        cell = self.grid.cell
        transfer.gather(self.x, self.v, self.C, self.F, self.D, nodes, origin, cell, dt, low, high)

    def _stress(self, apply: Callable[..., Any] = map) -> None:
        def part(k: int) -> tuple[float, int, float]:
            low, high = _part(len(self.x), k)
            return stress(
                self.F, self.C, self._law, *self._values, self.volume, self._tau, low, high
            )

        found = list(apply(part, range(PARTS)))
        self.elastic = sum(energy for energy, _, _ in found)
        self.account.crushed += sum(crushed for _, crushed, _ in found)
        self._least_ratio = min(least for _, _, least in found)


def _part(count: int, k: int) -> tuple[int, int]:
    """The k-th of PARTS shares of `count`."""
    return count * k // PARTS, count * (k + 1) // PARTS


def block(
    size: Sequence[float], at: Sequence[float], spacing: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Particles that fill a box evenly, from its lowest corner `at`, and the volume of each; metres."""
    counts = np.maximum(np.round(np.array(size) / spacing), 1).astype(int)
    sides = [(np.arange(n) + 0.5) / n * s for n, s in zip(counts, size, strict=True)]
    places = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 3) + np.array(at)
    return places, np.full(len(places), float(np.prod(size)) / len(places))
