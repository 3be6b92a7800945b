"""What structure from motion finds: poses of some frames, one lens, points; and whether that can be believed."""

import hashlib
import io
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Bool, Float64, Int32, UInt8

from rpaug.core import geometry
from rpaug.core.errors import Unsupported
from rpaug.core.files import write_atomic

FEWEST_FRAMES = 8
LEAST_SHARE = 0.25  # of the frames: a smaller part is no model of the video
WIDEST, LONGEST = 0.3, 3.0  # focal lengths over image widths: 118 and 19 degrees
BENT = 0.5  # of the radial term: no lens of a worn camera bends more
LEAST_ANGLE = 1.0  # degrees between the two outermost rays to the median point
FEWEST_POINTS = 100
DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    EOFError,
    BadZipFile,
)  # what reading a damaged file raises


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Cameras of `times`, ascending, all through one lens, and the points they saw.

    `focal` and `middle` are in pixels of a `width` x `height` image (centres at integers); `radial` is the k of
    x' = x (1 + k r^2) in the image plane at distance 1 (COLMAP's SIMPLE_RADIAL). Poses and points are in a world and a
    unit of the model's own until `placed`. `seen[i, j]` tells whether frame i saw point j. `facts` say how it went.
    """

    times: Int32[np.ndarray, "m"]
    cam_to_world: Float64[np.ndarray, "m 4 4"]
    focal: float
    middle: tuple[float, float]
    radial: float
    width: int
    height: int
    points: Float64[np.ndarray, "p 3"]
    colors: UInt8[np.ndarray, "p 3"]
    seen: Bool[np.ndarray, "m p"]
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def K(self) -> Float64[np.ndarray, "3 3"]:
        """The lens without its bend."""
        (x, y), f = self.middle, self.focal
        return np.array([[f, 0, x], [0, f, y], [0, 0, 1]])

    def sized(self, width: int, height: int) -> "Reconstruction":
        """The same for images of another size."""
        factor = width / self.width
        # Pixel edges scale, and centres lie half a pixel inside them.
        x, y = (factor * (value + 0.5) - 0.5 for value in self.middle)
        return replace(self, focal=factor * self.focal, middle=(x, y), width=width, height=height)

    def moved(self, motion: Float64[np.ndarray, "4 4"], scale: float) -> "Reconstruction":
        """The same in another world: every length times `scale`, then moved."""
        poses = self.cam_to_world.copy()
        poses[:, :3, 3] *= scale
        points = geometry.transform(motion, scale * self.points)
        return replace(self, cam_to_world=motion @ poses, points=points)

    def some(self, rows: list[int]) -> "Reconstruction":
        """Those frames of it alone; points that fewer than two of them saw are left out."""
        seen = self.seen[rows]
        kept = seen.sum(0) >= 2
        return replace(
            self, times=self.times[rows], cam_to_world=self.cam_to_world[rows],
            points=self.points[kept], colors=self.colors[kept], seen=seen[:, kept],
        )  # fmt: skip

    def angle(self) -> float:
        """Degrees between the outermost two of the rays to a point, the median over points."""
        if not len(self.points):
            return 0.0
        rays = self.points[None] - self.cam_to_world[:, :3, 3][:, None]
        rays /= np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-12)
        widest = np.zeros(len(self.points))
        for j in range(len(self.points)):
            own = rays[self.seen[:, j], j]
            if len(own) > 1:
                widest[j] = np.degrees(np.arccos(np.clip((own @ own.T).min(), -1, 1)))
        return float(np.median(widest))

    def faults(self, frames: int) -> list[str]:
        """Why this cannot be believed as the model of a video of so many frames, with the numbers; none if it can."""
        wide = self.focal / self.width
        found = []
        if len(self.times) < max(FEWEST_FRAMES, LEAST_SHARE * frames):
            found.append(f"{len(self.times)} of {frames} frames registered")
        if not WIDEST < wide < LONGEST:
            found.append(f"a focal length of {self.focal:.0f} px, {wide:.1f} image widths")
        if abs(self.radial) > BENT:
            found.append(f"a lens that bends by k = {self.radial:.2f}")
        if (angle := self.angle()) < LEAST_ANGLE:
            found.append(f"{angle:.2f} degrees between the rays to a point")
        if len(self.points) < FEWEST_POINTS:
            found.append(f"{len(self.points)} points")
        return found


def believed(models: list[Reconstruction], frames: int) -> Reconstruction:
    """The model of most frames, if it can be believed. Raises Unsupported with the numbers of the largest otherwise."""
    if not models:
        raise Unsupported(f"structure from motion found nothing in {frames} frames")
    ranked = sorted(models, key=lambda model: (-len(model.times), -len(model.points)))
    for model in ranked:
        if not model.faults(frames):
            return model
    stated = "; ".join(
        f"{model.facts.get('mapper', 'model')}: {', '.join(model.faults(frames))}"
        for model in ranked[:2]
    )
    raise Unsupported(f"structure from motion is degenerate ({stated})")


def save(path: Path, model: Reconstruction) -> None:
    """Keep a model in one file."""
    buffer = io.BytesIO()
    arrays = {name: value for name, value in vars(model).items() if name != "facts"}
    np.savez_compressed(buffer, facts=json.dumps(model.facts), **arrays)
    write_atomic(path, buffer.getvalue())


def load(path: Path) -> Reconstruction | None:
    """A kept model; None if there is none, or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as held:
            x, y = held["middle"].tolist()
            return Reconstruction(
                held["times"], held["cam_to_world"], float(held["focal"]), (x, y),
                float(held["radial"]), int(held["width"]), int(held["height"]), held["points"],
                held["colors"], held["seen"], json.loads(str(held["facts"])),
            )  # fmt: skip
    except DAMAGED:
        return None


def fingerprint(*parts: bytes) -> str:
    """A name for what a model was made from."""
    made = hashlib.blake2b(digest_size=16)
    for part in parts:
        made.update(len(part).to_bytes(8, "little") + part)
    return made.hexdigest()
