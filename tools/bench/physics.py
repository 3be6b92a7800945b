"""What the simulations of things must hold, measured: falls, momentum, a beam, energy, half steps, speed, long runs.

python tools/bench/physics.py [falls momentum beam energy halving speed random torch drop] [--json]
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import torch

from rpaug.core.errors import Unsupported
from rpaug.physics import transfer
from rpaug.physics.colliders import still
from rpaug.physics.contact import COLUMNS
from rpaug.physics.materials import RANGES, Law, Material
from rpaug.physics.rigid import Rigid
from rpaug.physics.soft import COURANT, Soft, block

CELL = 0.01
HARD = Material(young=1e5)
KINDS = {
    "elastic": HARD,
    "jelly": Material(law=Law.JELLY, young=1e5, viscosity=5.0),
    "plasticine": Material(law=Law.PLASTICINE, young=1e5, yield_stress=2e3),
    "sand": Material(law=Law.SAND, young=1e5, friction=35.0),
}


def cube(
    material: Material,
    height: float,
    courant: float = COURANT,
    threads: int = 2,
    gravity: float = 9.81,
    floor: float | None = 0.0,
) -> Soft:
    """A 10 cm cube of 8000 particles with its foot at a height."""
    x, volume = block((0.1, 0.1, 0.1), (0.0, 0.0, height), CELL / 2)
    room = still(np.array([-0.4, -0.4, -0.5]), np.array([0.5, 0.5, 0.7]), CELL, floor)
    return Soft(
        x, volume, material, room, gravity=(0, 0, -gravity), courant=courant, threads=threads
    )


def falls() -> dict[str, float]:
    """A free fall of 0.2 s against g t^2 / 2."""
    one = cube(HARD, 0.4, floor=None)
    before = one.x[:, 2].mean()
    one.run(0.2)
    return {
        "fall_error_percent": 100 * abs((before - one.x[:, 2].mean()) / (0.5 * 9.81 * 0.04) - 1)
    }


def momentum() -> dict[str, float]:
    """A cube that flies and spins for 0.2 s."""
    one = cube(HARD, 0.2, gravity=0.0, floor=None)
    one.v[:] = np.cross([0, 0, 20.0], one.x - one.x.mean(0)) + np.array([0.5, 0, 0])
    before = one.momentum()
    one.run(0.2)
    return {"momentum_change": float(np.abs(one.momentum() - before).max() / np.abs(before).max())}


def beam() -> dict[str, float]:
    """The end of a clamped beam under its own weight against rho g A L^4 / (8 E I) (Euler and Bernoulli)."""
    young, length, side = 1e6, 0.2, 0.04
    x, volume = block((length + 0.04, side, side), (-0.04, 0, 0.5), CELL / 2)
    room = still(np.array([-0.08, -0.04, 0.3]), np.array([length + 0.06, 0.08, 0.6]), CELL)
    wall = room.origin[0] + CELL * np.arange(room.distance.shape[0]) <= 1e-9
    distance = np.where(wall[:, None, None], np.float32(-1), room.distance)
    made_of = Material(young=young, poisson=0.0)
    one = Soft(x, volume, made_of, replace(room, distance=distance), friction=-1.0)
    tip = x[:, 0] > length - CELL
    bends = []
    for k in range(60):
        one.run(0.02)
        one.v *= 0.8  # so that it comes to rest
        one.C *= 0.8
        if k >= 40:
            bends.append(float((x[tip, 2] - one.x[tip, 2]).mean()))
    theory = 1000 * 9.81 * length**4 * 12 / (8 * young * side**2)
    return {"beam_mm": 1000 * float(np.mean(bends)), "beam_theory_mm": 1000 * theory,
            "beam_error_percent": 100 * abs(float(np.mean(bends)) / theory - 1)}  # fmt: skip


def energy() -> dict[str, float]:
    """Each law's cube falls 10 cm onto a floor; the most that its energy ever exceeds its start by, in percent."""
    out = {}
    for name, material in KINDS.items():
        one = cube(material, 0.1)
        start, most = sum(one.energy()), 0.0
        for _ in range(60):
            one.run(1 / 120)
            most = max(most, sum(one.energy()) / start - 1)
        out[f"energy_{name}_percent"] = 100 * most
    return out


def halving() -> dict[str, float]:
    """The same falls with half the step: how far particles end from where they ended, over the way they went, and over
    how far that took them (a thing that bounces comes back)."""
    out = {}
    for name, material in KINDS.items():
        ends, way = [], 0.0
        for courant in (COURANT, COURANT / 2):
            one = cube(material, 0.05, courant)
            first = before = one.x.copy()
            way = 0.0
            for _ in range(30):
                one.run(0.01)
                way += float(np.linalg.norm(one.x - before, axis=1).mean())
                before = one.x.copy()
            ends.append(one.x)
        off = float(np.linalg.norm(ends[0] - ends[1], axis=1).mean())
        net = float(np.linalg.norm(ends[1] - first, axis=1).mean())
        out[f"half_step_{name}_percent"] = 100 * off / way
        out[f"half_step_{name}_percent_of_net"] = 100 * off / net
    return out


def speed() -> dict[str, float]:
    """20k particles, E = 1e5 Pa, 1 cm cells, 100 frames at 30 fps, two threads: the target is 60 s."""
    x, volume = block((0.135, 0.135, 0.137), (0, 0, 0.1), CELL / 2)
    x, volume = x[:20_000], volume[:20_000]
    room = still(np.array([-0.4, -0.4, -0.1]), np.array([0.6, 0.6, 0.6]), CELL, 0.0)
    one = Soft(x, volume, HARD, room)
    one.run(0.001)  # compiled, or read from the cache
    one = Soft(x, volume, HARD, room)
    wall, busy = time.perf_counter(), time.process_time()
    for _ in range(100):
        one.run(1 / 30)
    wall, busy = time.perf_counter() - wall, time.process_time() - busy
    each = 1e6 * busy / one.account.steps / len(x)
    return {"speed_particles": len(x), "speed_steps": one.account.steps, "speed_wall_s": wall,
            "speed_cpu_s": busy, "speed_us_per_particle_step": each}  # fmt: skip


def random(steps: int = 100_000, seed: int = 0) -> dict[str, float]:
    """So many steps of random allowed materials, speeds, deformations and moving boxes: how many are not numbers."""
    rng = np.random.default_rng(seed)
    room = still(np.array([-0.3, -0.3, -0.1]), np.array([0.3, 0.3, 0.6]), CELL, 0.0)
    x, volume = block((0.04, 0.04, 0.04), (0, 0, 0.02), CELL / 2)
    done = bad = clamped = materials = 0
    while done < steps:
        values = {n: _between(rng, *RANGES[n]) for n in RANGES}
        box = np.concatenate([rng.normal(0, 0.05, 3), np.linalg.qr(rng.normal(size=(3, 3)))[0].ravel(),
                              rng.uniform(0, 0.02, 3), rng.uniform(0, 0.03, 1), rng.normal(0, 1, 6)])  # fmt: skip
        assert len(box) == COLUMNS
        try:
            one = Soft(x, volume, Material(law=Law(int(rng.integers(4))), **values), room,
                       boxes=lambda t, box=box: box[None], friction=rng.uniform(-1, 2))  # fmt: skip
        except Unsupported:  # too stiff: the rigid solver's
            continue
        one.v[:] = rng.normal(0, 10 ** rng.uniform(-2, 1), 3)
        one.F += rng.normal(0, 0.3, (3, 3)) * (rng.random() < 0.3)
        for _ in range(250):
            one._step(one._step_size(), map)
        bad += not all(np.isfinite(part).all() for part in (one.x, one.v, one.C, one.F, one.D))
        clamped += one.account.clamped
        done, materials = done + 250, materials + 1
    return {"random_steps": done, "random_materials": materials, "random_not_numbers": bad,
            "random_clamped_particle_steps": clamped}  # fmt: skip


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in logarithms where a range spans decades."""
    return float(
        10 ** rng.uniform(np.log10(low), np.log10(high))
        if low > 0
        else rng.uniform(low, min(high, 1e6))
    )


def in_torch(steps: int = 20) -> dict[str, float]:
    """One scatter of 20k particles as torch tensors, which CUDA could run, beside the compiled one; one core."""
    torch.set_num_threads(1)
    x, _ = block((0.135, 0.135, 0.137), (0.05, 0.05, 0.05), CELL / 2)
    x = x[:20_000]
    n, shape = len(x), (26, 26, 26)
    v, C, tau, mass = np.ones((n, 3)), np.ones((n, 3, 3)), np.ones((n, 3, 3)), np.ones(n)
    nodes = np.zeros((*shape, 4))
    transfer.scatter(x, v, C, tau, mass, nodes, np.zeros(3), CELL, 1e-4, 0, n)
    busy = time.process_time()
    for _ in range(steps):
        nodes[:] = 0
        transfer.scatter(x, v, C, tau, mass, nodes, np.zeros(3), CELL, 1e-4, 0, n)
    compiled = (time.process_time() - busy) / steps
    tx, tv, tC, ttau, tm = (torch.from_numpy(a) for a in (x, v, C, tau, mass))
    offsets = torch.stack(torch.meshgrid(*[torch.arange(3)] * 3, indexing="ij"), -1).reshape(27, 3)

    def scatter() -> torch.Tensor:
        at = tx / CELL
        base = (at - 0.5).long()
        f = at - base
        w = torch.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1) ** 2, 0.5 * (f - 0.5) ** 2], 1)
        weight = w[:, offsets[:, 0], 0] * w[:, offsets[:, 1], 1] * w[:, offsets[:, 2], 2]
        away = (offsets[None] - f[:, None]) * CELL
        affine = tm[:, None, None] * tC - 4e-4 / CELL**2 * ttau
        p = (tm[:, None] * tv)[:, None] + torch.einsum("nij,nkj->nki", affine, away)
        row = base[:, None] + offsets
        flat = (row[..., 0] * shape[1] + row[..., 1]) * shape[2] + row[..., 2]
        values = torch.cat([p, tm[:, None, None].expand(n, 27, 1)], 2) * weight[..., None]
        out = torch.zeros(int(np.prod(shape)), 4, dtype=torch.float64)
        return out.index_add_(0, flat.reshape(-1), values.reshape(-1, 4))

    assert np.allclose(scatter().numpy().reshape(nodes.shape), nodes)
    busy = time.process_time()
    for _ in range(steps):
        scatter()
    tensors = (time.process_time() - busy) / steps
    return {"scatter_numba_ms": 1000 * compiled, "scatter_torch_ms": 1000 * tensors,
            "scatter_ratio": tensors / compiled}  # fmt: skip


def drop() -> dict[str, float]:
    """A tilted box falls 10 cm: our solver, on points of its surface, against MuJoCo's own box, over 2 s of frames."""
    half = np.array([0.03, 0.05, 0.08])
    turn = np.array([0.3, 0.2, 0.1])
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0001" integrator="implicitfast" cone="elliptic" impratio="10"/>
        <default><geom friction="0.5 0.005 0.0005" condim="4" solref="0.004 1"/></default>
        <worldbody><geom type="plane" size="0 0 0.1"/><body pos="0 0 0.2"><freejoint/>
        <geom type="box" size="{half[0]} {half[1]} {half[2]}" density="525"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    angle = float(np.linalg.norm(turn))
    data.qpos[3:] = [np.cos(angle / 2), *(np.sin(angle / 2) * turn / angle)]
    mujoco.mj_forward(model, data)
    pose = data.xmat[1].reshape(3, 3).copy()
    rng = np.random.default_rng(0)
    face = rng.uniform(-1, 1, (4000, 3))
    face[np.arange(4000), rng.integers(3, size=4000)] = np.sign(rng.normal(size=4000))
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    points = np.concatenate([face, corners]) * half @ pose.T + [0, 0, 0.2]
    found = Rigid(points, 525, 0.0).run(41, 0.05).motions
    worst = turned = 0.0
    for motion in found:
        place = motion[:3, :3] @ [0, 0, 0.2] + motion[:3, 3]
        worst = max(worst, float(np.linalg.norm(place - data.xpos[1])))
        off = (motion[:3, :3] @ pose).T @ data.xmat[1].reshape(3, 3)
        turned = max(turned, float(np.arccos(np.clip((np.trace(off) - 1) / 2, -1, 1))))
        for _ in range(500):
            mujoco.mj_step(model, data)
    return {"drop_worst_mm": 1000 * worst, "drop_worst_degrees": float(np.rad2deg(turned))}


MEASURES: dict[str, Callable[[], dict[str, Any]]] = {
    "falls": falls, "momentum": momentum, "beam": beam, "energy": energy, "halving": halving,
    "speed": speed, "random": random, "torch": in_torch, "drop": drop,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("measures", nargs="*", help=f"of {', '.join(MEASURES)}; all by default")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found: dict[str, Any] = {}
    for name in asked.measures or MEASURES:
        found |= MEASURES[name]()
        if not asked.json:
            for key, value in list(found.items()):
                print(f"{key:32s} {value:.6g}")
            found = {}
    if asked.json:
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
