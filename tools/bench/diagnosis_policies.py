"""Small policies that find a block in a picture, each with a weakness of its own, and whether their grasp is right.

What a policy is good at it does by the simulator's ids (a perfect segmenter); what it is weak at it does by pixels, in
the way such policies do: thresholds on a color, on brightness, region growing, nearest neighbours, a fixed camera.
Nothing of `rpaug.diagnosis` is used here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from diagnosis_pool import CAMERA, SIZE, Seen

from rpaug.core import geometry
from rpaug.twin import cameras
from rpaug.twin.tabletop import BLOCK, TABLE

RIGHT = 0.03  # metres that a grasp may miss by
BARS = (0.87, 1.0, 1.13)  # how wide a policy's own thresholds are
SLIP = 0.006  # metres: standard deviation of where the gripper goes after all
ROBOT = ("hand", "link1", "link2", "link3", "link4")
ROOM = (
    "table",
    "floor",
    "wall_back",
    "wall_left",
    "wall_right",
    "wall_far",
    "finger_left",
    "finger_right",
)
K = cameras.intrinsics(CAMERA, SIZE)


@dataclass(frozen=True)
class Trained:
    """What a policy remembers of its training pictures."""

    pictures: Sequence[Seen]

    @cached_property
    def white(self) -> np.ndarray:
        """The robot's usual color."""
        return np.mean([one.rgb[one.mask(*ROBOT)].mean(0) for one in self.pictures], 0)

    @cached_property
    def chroma(self) -> np.ndarray:
        """The block's usual color, whatever the light's strength."""
        return np.mean(
            [_chroma(one.rgb[one.mask("block_plain")].mean(0)) for one in self.pictures], 0
        )

    @cached_property
    def scenery(self) -> set[str]:
        """What it saw beside the block, and has learnt to leave alone."""
        return {name for one in self.pictures for name in one.handles} - {"block_plain"}

    @cached_property
    def table(self) -> np.ndarray:
        return np.concatenate([one.rgb[one.mask("table")] for one in self.pictures]).astype(float)

    @cached_property
    def wall(self) -> np.ndarray:
        return np.concatenate([one.rgb[one.mask("wall_back")] for one in self.pictures]).astype(
            float
        )

    @cached_property
    def width(self) -> float:
        """The block's usual apparent width times its distance."""
        return float(np.mean([_width(one) for one in self.pictures]))

    @cached_property
    def bright(self) -> float:
        return float(np.mean([one.rgb[one.mask(*ROBOT)].mean() for one in self.pictures]))

    @cached_property
    def places(self) -> np.ndarray:
        return np.array([one.place[:2] for one in self.pictures])

    def balanced(self, seen: Seen) -> np.ndarray:
        """The picture with the robot as white as it used to be."""
        now = np.maximum(seen.rgb[seen.mask(*ROBOT)].mean(0), 1)
        return np.minimum(seen.rgb * (self.white / now), 255)


def robust(seen: Seen, usual: float | None = None) -> np.ndarray:
    """Where the block is, by ids and the true camera: metres on the table.

    With its `usual` width the block's height is told from how wide it looks now.
    """
    middle = _middle(seen.mask("block_plain"))
    guess = _cast(middle, seen.pose)
    if usual is None:
        return guess
    for _ in range(2):
        guess = _cast(middle, seen.pose, np.clip(_wide(seen, guess) / usual, 0.5, 1.6))
    return guess


def by_color(seen: Seen, trained: Trained, bar: float) -> bool:
    """Takes the thing whose color is nearest to the block's, if it is near."""
    image = trained.balanced(seen)
    apart = {
        n: np.linalg.norm(_chroma(image[m].mean(0)) - trained.chroma)
        for n, m in _things(seen).items()
    }
    name = min(apart, key=lambda n: apart[n], default="")
    return name == "block_plain" and apart[name] < 0.14 * bar


def by_growing(seen: Seen, trained: Trained, bar: float) -> bool:
    """Grows a region of like color from the block's middle; a patch of a pattern is not the block."""
    image = np.clip(trained.balanced(seen), 0, 255)
    mask = seen.mask("block_plain")
    chroma = np.stack([_chroma(row) for row in image])
    u, v = np.round(_middle(mask)).astype(int)
    like = (np.linalg.norm(chroma - chroma[v, u], axis=2) < 0.035 * bar).astype(np.uint8)
    _, labels = cv2.connectedComponents(like, connectivity=8)
    grown = (labels == labels[v, u]) & cv2.dilate(mask.astype(np.uint8), np.ones((5, 5))).astype(
        bool
    )
    return grown.sum() / mask.sum() > 0.6


def by_width(seen: Seen, trained: Trained, bar: float) -> bool:
    """Opens the gripper as it always did: it must fit what the picture shows."""
    return abs(np.log(_width(seen) / trained.width)) < 0.16 * bar


def by_brightness(seen: Seen, trained: Trained, bar: float) -> bool:
    """Finds the hand as what is bright where the robot stands."""
    mask = seen.mask(*ROBOT)
    bright = seen.rgb[mask].mean(1) > 0.95 * trained.bright * bar
    return bright.mean() > 0.4


def by_table(seen: Seen, trained: Trained, bar: float) -> bool:
    """Tells the block from a table of the usual colors."""
    image = trained.balanced(seen)
    table = seen.mask("table")
    usual = _like(image[table], trained.table, 26 * bar)
    return usual.mean() > 0.6


def by_wall(seen: Seen, trained: Trained, bar: float) -> bool:
    """Finds the edge of the table under a wall of the usual colors."""
    image = trained.balanced(seen)
    return _like(image[seen.mask("wall_back")], trained.wall, 30 * bar).mean() > 0.6


def by_memory(seen: Seen, trained: Trained, bar: float) -> bool:
    """Goes where the three nearest of its training blocks stood."""
    guess = robust(seen)
    near = np.argsort(np.linalg.norm(trained.places - guess, axis=1))[:3]
    return bool(np.linalg.norm(trained.places[near].mean(0) - guess) < 0.04 * bar)


def by_salience(seen: Seen, trained: Trained, bar: float) -> bool:
    """Goes to what differs from the table the most, of all that is no scenery of its training."""
    image = trained.balanced(seen)
    table = image[seen.mask("table")].mean(0)
    striking = {
        name: np.linalg.norm(image[mask].mean(0) - table)
        for name, mask in _things(seen).items()
        if name not in trained.scenery
    }
    others = [found for name, found in striking.items() if name != "block_plain"]
    return bool(striking["block_plain"] > bar * max(others, default=0.0))


def by_fixed_camera(seen: Seen, trained: Trained, bar: float) -> bool:
    """Believes that the camera stands where it stood."""
    usual = cameras.FIXED[CAMERA]
    guess = _cast(_middle(seen.mask("block_plain")), usual)
    return bool(np.linalg.norm(guess - robust(seen)) < RIGHT * bar)


WEAK: Mapping[str, Callable[[Seen, Trained, float], bool]] = {
    "object position": by_memory,
    "object color": by_color,
    "object texture": by_growing,
    "object size": by_width,
    "lighting": by_brightness,
    "table": by_table,
    "background": by_wall,
    "distractor": by_salience,
    "camera": by_fixed_camera,
}


@dataclass(frozen=True)
class Outcomes:
    """What every policy would do in every rollout: `off` is by how much the block's place is misjudged in metres,
    `holds[weakness][k]` whether that part is right, for the k-th of `BARS`."""

    off: np.ndarray
    holds: Mapping[str, np.ndarray]

    def failed(self, rows: np.ndarray, weak: Sequence[str], rng: np.random.Generator) -> np.ndarray:
        """Which rollouts a policy with these weaknesses fails in."""
        slips = self.off[rows] + rng.normal(0, SLIP, (len(rows), 2))
        right = np.linalg.norm(slips, axis=1) < RIGHT
        bar = int(rng.integers(len(BARS)))
        for one in weak:
            right &= self.holds[one][bar][rows]
        return ~right


def outcomes(pool: Sequence[Seen], trained: Trained) -> Outcomes:
    """All policies in all rollouts. A block that is not seen is never grasped."""
    seen = np.array([one.mask("block_plain").sum() >= 8 for one in pool])
    off = np.array(
        [
            robust(one, trained.width) - one.place[:2] if ok else (1, 1)
            for one, ok in zip(pool, seen, strict=True)
        ]
    )
    holds = {
        name: np.array(
            [
                [bool(ok and part(one, trained, bar)) for one, ok in zip(pool, seen, strict=True)]
                for bar in BARS
            ]
        )
        for name, part in WEAK.items()
    }
    return Outcomes(off, holds)


def _things(seen: Seen) -> dict[str, np.ndarray]:
    names = [n for n in seen.handles if n not in ROOM and not n.startswith("link") and n != "hand"]
    masks = {name: seen.mask(name) for name in names}
    return {name: mask for name, mask in masks.items() if mask.sum() >= 8 and name != "patch"}


def _middle(mask: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


def _chroma(color: np.ndarray) -> np.ndarray:
    return color / np.maximum(np.sum(color, -1, keepdims=True), 1)


def _width(seen: Seen) -> float:
    return _wide(seen, robust(seen))


def _wide(seen: Seen, place: np.ndarray) -> float:
    """The root of its area in pixels times its distance: the same wherever it stands."""
    far = np.linalg.norm([*place, TABLE] - seen.pose[:3, 3])
    return float(np.sqrt(seen.mask("block_plain").sum()) * far)


def _like(pixels: np.ndarray, usual: np.ndarray, bar: float) -> np.ndarray:
    """Which pixels lie within `bar` of a usual one, of 32 that stand for all."""
    some = usual[:: max(1, len(usual) // 32)]
    return np.min([np.abs(pixels - one).max(1) for one in some], 0) < bar


def _cast(pixel: np.ndarray, pose: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Where the ray of a pixel meets the plane through the middle of a block of that scale."""
    ray = pose[:3, :3] @ geometry.rays(pixel[0], pixel[1], K)
    far = (TABLE + scale * BLOCK[2] - pose[2, 3]) / ray[2]
    return (pose[:3, 3] + far * ray)[:2]
