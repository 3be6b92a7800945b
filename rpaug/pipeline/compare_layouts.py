"""What an episode in another layout still holds, what was lost or approximated, and what is wrong in it."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from rpaug.core.metrics import psnr
from rpaug.core.types import CameraView, Episode

LOSSY = 34.0  # dB: a JPEG or a video at the quality that is written shows a recording better
FAR = 1e-3  # metres by which depth may be off where a layout rounds it
ON_TIME = 1e-4  # seconds: what LeRobot's own reader bears
NEAR = 1e-4  # of numbers that are float32 in a layout
Level = Literal["bad", "lost", "near"]
Found = tuple[Level, str, str, str]
NO_PLACE = "the layout has no place for it"


def compare(key: str, recorded: Episode, made: Episode, times: Sequence[int]) -> Iterator[Found]:
    """Level, episode, topic and words of everything that differs: `bad` is wrong, `lost` has no place in the layout,
    `near` was rounded, encoded with loss, or worked out. Words of the latter two are the same for every such episode.
    """
    if made.length != recorded.length:
        words = f"{made.length} frames, recorded were {recorded.length}"
        yield "bad", key, "length", words
        return
    if made.instruction != recorded.instruction:
        words = f"found {made.instruction!r}; expected {recorded.instruction!r}"
        yield "bad", key, "instruction", words
    elif {*recorded.descriptions} - {*made.descriptions}:
        yield "lost", key, "instruction", "only the first of several instructions is kept"
    if recorded.rate is not None and made.rate is None:
        yield "lost", key, "rate", f"frames a second: {NO_PLACE}"
    elif recorded.rate is not None and made.rate != recorded.rate:
        yield "near", key, "rate", "frames a second: rounded to a whole number"
    elif made.rate is not None and _off_grid(recorded, made.rate):
        yield (
            "near",
            key,
            "rate",
            "times of frames: evenly apart now; they were not, or at no whole number a second",
        )
    yield from (("lost", key, "unread", words) for words in recorded.unread)
    yield from _robot(key, recorded, made)
    for name, view in recorded.views.items():
        other = _counterpart(name, view, made.views, times)
        if other is None:
            who = "it does not show" if name in made.views else "no camera shows"
            words = f"{name}: {who} the same, {LOSSY:g} dB or more near"
            yield "bad", key, "images", words
        else:
            yield from _view(key, name, view, other, times)


def _off_grid(recorded: Episode, rate: float) -> bool:
    """Whether recorded times of frames are others than those of a rate."""
    times = recorded.robot.extra.get("seconds")
    if times is None:
        return False
    apart = np.ravel(times)[: recorded.length] - np.arange(recorded.length) / rate
    return bool(np.abs(apart).max() > ON_TIME)


def _counterpart(
    name: str, view: CameraView, among: Mapping[str, CameraView], times: Sequence[int]
) -> CameraView | None:
    """The camera that shows the same: the one of that name, or any where the layout has names of its own."""
    for other in [among[name]] if name in among else among.values():
        size = (view.camera.width, view.camera.height)
        alike = size == (other.camera.width, other.camera.height)
        if alike and all(_psnr(view.rgb(t), other.rgb(t)) >= LOSSY for t in times):
            return other
    return None


def _psnr(one: np.ndarray, other: np.ndarray) -> float:
    """Of two images of bytes, in dB."""
    return psnr(float(((one.astype(np.float32) - other) ** 2).mean()))


def _view(
    key: str, name: str, view: CameraView, other: CameraView, times: Sequence[int]
) -> Iterator[Found]:
    if not all(np.array_equal(view.rgb(t), other.rgb(t)) for t in times):
        yield (
            "near",
            key,
            "images",
            f"{name}: color is encoded with loss, {LOSSY:g} dB or more near",
        )
    if view.radiance is not None and other.radiance is None:
        yield "lost", key, "radiance", f"{name}: images with less light: {NO_PLACE}"
    for kind, slack in (("depth", FAR), ("ids", 0)):
        before, after = getattr(view, kind), getattr(other, kind)
        if before is None:
            continue
        if after is None:
            yield "lost", key, kind, f"{name}: {kind}: {NO_PLACE}"
            continue
        pairs = [(before(t), after(t)) for t in times]
        if kind == "depth" and any((new[old == 0] != 0).any() for old, new in pairs):
            yield (
                "near",
                key,
                kind,
                f"{name}: pixels without depth are on a plane at the layout's limit",
            )
            pairs = [(old, np.where(old == 0, 0, new)) for old, new in pairs]
        off = max(float(np.abs(old.astype(float) - new).max()) for old, new in pairs)
        if off > slack:
            yield "bad", key, kind, f"{name}: off by up to {off:.3g}"
        elif off:
            yield "near", key, kind, f"{name}: {kind} is rounded, by less than {1000 * FAR:g} mm"
    old, new = view.camera, other.camera
    if old.assumed:
        return
    if new.assumed:
        yield "bad", key, "camera", f"{name}: where it is was lost"
    elif not (np.allclose(old.K, new.K) and np.allclose(old.cam_to_world, new.cam_to_world)):
        yield "bad", key, "camera", f"{name}: moved"


def _robot(key: str, recorded: Episode, made: Episode) -> Iterator[Found]:
    there = [np.reshape(track, (made.length, -1)) for track in _numbers(made)]
    for field in ("joint_positions", "joint_velocities", "gripper_to_world", "gripper_open"):
        old, new = getattr(recorded.robot, field), getattr(made.robot, field)
        if old is None or not old.size:
            if new is not None and new.size:
                yield "near", key, "robot", f"{field}: worked out, the source has none"
        elif new is None and any(_column(old, one) for one in there):
            continue  # a part of a row that is there whole
        elif new is None or old.shape != new.shape:
            yield "lost", key, "robot", f"{field}: {NO_PLACE}"
        elif not np.allclose(old, new, atol=NEAR):
            yield "bad", key, "robot", f"{field} is off by up to {np.abs(old - new).max():.3g}"
    for name, track in recorded.robot.extra.items():
        rows = np.reshape(track, (recorded.length, -1))
        alike = [
            float(np.abs(rows - other).max(initial=0))
            for other in there
            if rows.shape == other.shape and np.allclose(rows, other, atol=NEAR)
        ]
        if rows.size and not alike:
            yield "lost", key, "robot", f"{name}: {NO_PLACE}"
        elif (
            rows.size and min(alike) > NEAR
        ):  # times in milliseconds, say: float32 tells them to two minutes
            yield "near", key, "robot", f"{name}: numbers too large for float32 are rounded"


def _column(numbers: np.ndarray, rows: np.ndarray) -> bool:
    """Are these numbers, one a frame, a column of those?"""
    return numbers.ndim == 1 and any(
        np.allclose(numbers, column, atol=NEAR) for column in rows.T if len(column) == len(numbers)
    )


def _numbers(episode: Episode) -> list[np.ndarray]:
    """All numbers of a robot, whatever they are called."""
    robot = episode.robot
    known = (robot.joint_positions, robot.joint_velocities, robot.gripper_open)
    return [*robot.extra.values(), *(track for track in known if track is not None and track.size)]
