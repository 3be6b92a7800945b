"""A fixed camera from the robot's outlines over an episode, with how far it may be off; or why it cannot be told.

Solved from every side (`outline_starts`), then with fine masks. Three things must hold: outlines lie on the masks of
frames that were held out, no other direction explains them as well, and the pose is certain: by the standard error of
the fit and by how far apart two halves of the frames put the camera.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rpaug.scene.tracking import outline_pose, outline_starts
from rpaug.scene.tracking.outline_pose import OutlinedFrame, OutlineLens, Pose, SolvedPose

FRAMES = 24  # that are looked at
LEAST_FRAMES = 8
SIDE = 192  # pixels of the masks' longer side
LEAST_PIXELS = 60  # of a mask that is looked at
COMMON = 3.0  # times the fit's spread: outlines err alike in all frames (docs/benchmarks/models.md)
PLACE, DIRECTION = (
    0.02,
    np.deg2rad(1.0),
)  # metres, radians: a camera that may be farther off is refused
OVERLAP = 0.75  # of outlines in frames that were held out, at least
CLEAR = 0.03  # of overlap: another direction that comes so near is as good


@dataclass(frozen=True)
class CalibratedCamera:
    """Where a camera stands; `place` (metres) and `direction` (radians) are how far it may be off.

    `overlap` is that of drawn and recorded outlines in frames that were held out, `frames` how many told the pose.
    """

    cam_to_world: Pose
    lens: OutlineLens
    place: float
    direction: float
    overlap: float
    frames: int


def calibrate(
    frames: Sequence[OutlinedFrame],
    lens: OutlineLens,
    progress: Callable[[float], None] = lambda _: None,
) -> CalibratedCamera | str:
    """The camera that took these frames, or why it cannot be told; `lens` is that of the frames' masks."""
    frames = [one for one in frames if one.mask.sum() >= LEAST_PIXELS]
    if len(frames) < LEAST_FRAMES:
        return f"{len(frames)} frames show the robot's outline; at least {LEAST_FRAMES} are needed"
    some = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))]
    found = outline_starts.starts(some, lens, lambda share: progress(0.6 * share))
    shape, some = some[0].mask.shape, [frame.sized(SIDE) for frame in some]
    coarse = some[0].sized(outline_starts.SIDE).mask.shape
    solved = list[SolvedPose]()
    for one in found[:2]:
        begun = one.lens.scaled(coarse, some[0].mask.shape)
        solved.append(outline_pose.solve(some, begun, one.cam_to_world))
        progress(0.6 + 0.1 * len(solved))
    best, *others = outline_starts.distinct(outline_starts.ranked(some, solved))
    fit, *rest = (
        float(np.median(outline_pose.overlaps(some, one.lens, one.cam_to_world)))
        for one in (best, *others)
    )
    if rest and max(rest) > fit - CLEAR:
        return (
            f"seen from two sides its outlines overlap alike ({fit:.2f} and {max(rest):.2f}): the robot moves too "
            "little in this camera"
        )
    halves = [outline_pose.solve(some[k::2], best.lens, best.cam_to_world, (1.0,)) for k in (0, 1)]
    progress(1.0)
    return judged(some, best, halves, shape)


def judged(
    frames: Sequence[OutlinedFrame],
    best: SolvedPose,
    halves: Sequence[SolvedPose],
    shape: tuple[int, ...],
) -> CalibratedCamera | str:
    """The camera if it is certain enough, or why it is not."""
    held = [
        outline_pose.overlaps(frames[1 - k :: 2], half.lens, half.cam_to_world)
        for k, half in enumerate(halves)
    ]
    overlap = float(np.median(np.concatenate(held)))
    one, other = (half.cam_to_world for half in halves)
    place, direction = best.spread()
    place = COMMON * max(place, float(np.linalg.norm(one[:3, 3] - other[:3, 3])) / 2)
    direction = COMMON * max(direction, outline_starts.turn(one, other) / 2)
    if overlap < OVERLAP:
        return (
            f"where the robot's file has it and where it was outlined overlap by {overlap:.2f} (at least "
            f"{OVERLAP:g}): another robot, a wrong outline, or a lens that is no pinhole"
        )
    if place > PLACE or direction > DIRECTION:
        return (
            f"it may be {1e3 * place:.0f} mm and {np.degrees(direction):.2f} degrees off (at most {1e3 * PLACE:.0f} "
            f"and {np.degrees(DIRECTION):g}): give more frames, or frames in which the robot moves more"
        )
    lens = best.lens.scaled(frames[0].mask.shape, shape)
    return CalibratedCamera(best.cam_to_world, lens, place, direction, overlap, len(frames))
