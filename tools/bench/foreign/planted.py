"""Rollouts of a foreign world with several factors changed in each, and the values that a planted cause is a range of.

A factor's value says by how much it was changed: metres, Lab units, the logarithm of a size or of the light, degrees;
1 where there is no more to say. The simulator renders the first frames (`tools.bench.foreign.met`).
"""

import json
import os
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rpaug.assets import library
from rpaug.core import geometry
from rpaug.core.files import encode_png
from rpaug.twin import textures
from tools.bench.foreign import neutral
from tools.bench.foreign.met import CAMERA

CHANCE = 0.3  # that a factor is changed
CLEAR = 0.07  # metres around what is put somewhere
FAR = (0.08, 0.20)  # metres to the nearest place that the thing was recorded at
NOTED = 25.0  # Lab units, at least, of another color
THINGS = ("can_orange", "ball_tennis", "brick", "apple", "candle", "die", "cup_white", "eraser")
Change = dict[str, list[Any]]
Values = dict[str, float]


@dataclass(frozen=True)
class Layout:
    """What a rollout starts from: a neutral folder of one frame."""

    folder: Path

    @cached_property
    def facts(self) -> dict[str, Any]:
        return neutral.facts(self.folder)

    @cached_property
    def film(self) -> dict[str, np.ndarray]:
        return neutral.arrays(self.folder, CAMERA)

    def role(self, name: str) -> list[int]:
        """The instance ids in a role."""
        return list(self.facts["roles"][name]["must"])

    def mask(self, name: str) -> np.ndarray:
        return np.isin(self.film["ids"][0], self.role(name))

    @cached_property
    def points(self) -> np.ndarray:
        """Where each pixel's surface is, (h, w, 3)."""
        depth, pose = self.film["depth"][0], self.film["cam_to_world"][0]
        rows, columns = np.indices(depth.shape)
        seen = geometry.lifted(columns, rows, depth, self.film["K"])
        return seen @ pose[:3, :3].T + pose[:3, 3]

    @property
    def place(self) -> np.ndarray:
        """Where the thing to act on stands, (x, y)."""
        return self.points[self.mask("manipulated")].mean(0)[:2]

    def free(self, rng: np.random.Generator, near: float) -> np.ndarray:
        """A point of the table with nothing beside it, not far from the thing to act on."""
        table, ids = self.mask("table"), self.film["ids"][0]
        level = np.median(self.points[table][:, 2])
        spots = self.points[table & (np.abs(self.points[..., 2] - level) < 0.01)]
        others = self.points[(ids > 0) & ~table & ~self.mask("background")][:, :2]
        spots = spots[np.linalg.norm(spots[:, :2] - self.place, axis=1) < near]
        for spot in rng.permutation(spots):
            if np.linalg.norm(others - spot[:2], axis=1).min() > CLEAR:
                return spot
        raise LookupError(f"{self.folder}: no free place on the table")


@dataclass
class Draw:
    """One rollout's change, drawn factor by factor."""

    layout: Layout
    rng: np.random.Generator
    places: np.ndarray  # of the thing in the recordings, (n, 2)
    pictures: Path

    def position(self) -> tuple[Change, float]:
        for _ in range(200):
            spot = self.layout.free(self.rng, 0.3)[:2]
            away = float(np.linalg.norm(self.places - spot, axis=1).min())
            if FAR[0] < away < FAR[1]:
                break
        by = (spot - self.layout.place).tolist()
        return {"shifts": [{"id": one, "by": by} for one in self._mine[:1]]}, away

    def color(self) -> tuple[Change, float]:
        rgb, away = self._other_color("manipulated")
        return {"colors": [{"id": one, "rgb": rgb} for one in self._mine]}, away

    def texture(self) -> tuple[Change, float]:
        return {"covers": [self._cover(self._mine, 0.03, 0.08)]}, 1.0

    def size(self) -> tuple[Change, float]:
        low, high = ((0.6, 0.8), (1.25, 1.6))[int(self.rng.integers(2))]
        factor = float(self.rng.uniform(low, high))
        return {"sizes": [{"id": one, "factor": factor} for one in self._mine[:1]]}, float(
            np.log(factor)
        )

    def lighting(self) -> tuple[Change, float]:
        low, high = ((0.35, 0.7), (1.3, 1.7))[int(self.rng.integers(2))]
        bright = float(np.exp(self.rng.uniform(np.log(low), np.log(high))))
        cast = np.exp(self.rng.normal(0, 0.1, 3))
        return {"light": (bright * cast / cast.mean()).tolist()}, float(np.log(bright))

    def table(self) -> tuple[Change, float]:
        mine = self.layout.role("table")
        if self.rng.random() < 0.5:
            return {"covers": [self._cover(mine, 0.2, 0.6)]}, 1.0
        rgb, _ = self._other_color("table")
        return {"colors": [{"id": one, "rgb": rgb} for one in mine]}, 1.0

    def background(self) -> tuple[Change, float]:
        return {"covers": [self._cover(self.layout.role("background"), 0.5, 1.2)]}, 1.0

    def distractor(self) -> tuple[Change, float]:
        alike = self.rng.random() < 0.5
        own = np.median(self.layout.film["rgb"][0][self.layout.mask("manipulated")], 0)
        free, extras = max(self.layout.facts["ids"].values()) + 1, []
        for number, name in enumerate(self.rng.choice(THINGS, 2, replace=False)):
            mesh, pose = library.mesh(str(name)), np.eye(4)
            pose[:3, 3] = self.layout.free(self.rng, 0.35)
            plain = np.full((8, 8, 3), own, np.uint8)
            image = self._picture(plain if alike and number == 0 else mesh.image)
            flat = {
                key: np.asarray(getattr(mesh, key)).tolist()
                for key in ("points", "normals", "uv", "faces")
            }
            extras.append(flat | {"id": free + number, "image": image, "pose": pose.tolist()})
        return {"extras": extras}, 2.0 if alike else 1.0

    def camera(self) -> tuple[Change, float]:
        yaw = float(self.rng.choice([-1, 1]) * self.rng.uniform(2, 9))
        pitch, roll = self.rng.uniform(-1, 1, 2)
        turn = np.deg2rad([pitch, yaw, roll])
        bump = geometry.rigid(turn, self.rng.uniform(-0.03, 0.03, 3))
        return {"bumps": {CAMERA: np.asarray(bump).tolist()}}, yaw  # type: ignore[dict-item]

    @property
    def _mine(self) -> list[int]:
        return self.layout.role("manipulated")

    def _cover(self, ids: list[int], smallest: float, largest: float) -> dict[str, Any]:
        kind, seed = str(self.rng.choice(textures.KINDS)), int(self.rng.integers(2**32))
        image = self._picture(textures.picture(kind, seed))
        return {"ids": ids, "image": image, "side": float(self.rng.uniform(smallest, largest))}

    def _other_color(self, role: str) -> tuple[list[float], float]:
        now = np.median(self.layout.film["rgb"][0][self.layout.mask(role)], 0)
        while True:
            hsv = self.rng.uniform((0, 0.5, 0.4), (360, 1, 1))
            rgb = cv2.cvtColor(hsv[None, None].astype(np.float32), cv2.COLOR_HSV2RGB)[0, 0]
            both = np.stack([now / 255, rgb])[None].astype(np.float32)
            old, new = cv2.cvtColor(both, cv2.COLOR_RGB2Lab)[0]
            if (away := float(np.linalg.norm(new - old))) > NOTED:
                return rgb.tolist(), away

    def _picture(self, image: np.ndarray) -> str:
        file = self.pictures / f"{len(list(self.pictures.iterdir()))}.png"
        file.write_bytes(encode_png(np.ascontiguousarray(image)))
        return str(file.resolve())


FACTORS: Mapping[str, Callable[[Draw], tuple[Change, float]]] = {
    "object position": Draw.position,
    "object color": Draw.color,
    "object texture": Draw.texture,
    "object size": Draw.size,
    "lighting": Draw.lighting,
    "table": Draw.table,
    "background": Draw.background,
    "distractor": Draw.distractor,
    "camera": Draw.camera,
}


@dataclass(frozen=True)
class Pool:
    """All rollouts: first frames, ids, the roles of each, and the changed factors' values."""

    rgb: np.ndarray  # (n, h, w, 3)
    ids: np.ndarray  # (n, h, w)
    roles: list[dict[str, frozenset[int]]]
    values: list[Values]


def drawn(draw: Draw) -> tuple[Change, Values]:
    """Each factor changed by `CHANCE`; a thing gets another color or a texture, not both."""
    change: Change = {}
    values: Values = {}
    for name, factor in FACTORS.items():
        if draw.rng.random() >= CHANCE or (name == "object texture" and "object color" in values):
            continue
        some, values[name] = factor(draw)
        for key, more in some.items():
            change[key] = [*change[key], *more] if key in change else more
    return change, values


def places(recorded: Path) -> np.ndarray:
    """Where the thing stood at the start of each recording."""
    folders = sorted(path.parent for path in recorded.glob("*/episode.json"))
    return np.array([Layout(folder).place for folder in folders])


def pool(layouts: Path, recorded: Path, python: Path, count: int, seed: int, out: Path) -> Pool:
    """`count` rollouts that start like the layouts, rendered unless `out` has them."""
    folders = sorted(path.parent for path in layouts.glob("*/episode.json"))
    pictures = out / "pictures"
    file, told = out / "met.npz", out / "rollouts.json"
    if not file.exists():
        pictures.mkdir(parents=True, exist_ok=True)
        stood, asked = places(recorded), []
        for number in range(count):
            layout = Layout(folders[number % len(folders)])
            draw = Draw(layout, np.random.default_rng([seed, number]), stood, pictures)
            change, values = drawn(draw)
            asked.append({"layout": str(layout.folder), "change": change, "values": values})
        told.write_text(json.dumps(asked))
        command = [str(python), "-m", "tools.bench.foreign.met", "--rollouts", str(told)]
        environment = {"MUJOCO_GL": "egl", **os.environ}
        subprocess.run([*command, "--out", str(file)], check=True, env=environment)
    asked = json.loads(told.read_text())
    with np.load(file) as seen:
        return Pool(
            seen["rgb"], seen["ids"], list(map(_roles, asked)), [a["values"] for a in asked]
        )


def _roles(rollout: Mapping[str, Any]) -> dict[str, frozenset[int]]:
    roles = neutral.facts(Path(rollout["layout"]))["roles"]
    named = ("manipulated", "table", "background", "robot")
    return {role: frozenset(roles[role]["must"]) for role in named}
