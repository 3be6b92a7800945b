"""What an episode in another layout must still hold: its length, words, images, depth, instance ids, cameras, robot."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from rpaug.core.metrics import psnr
from rpaug.core.types import CameraView, Episode

LOSSY = 34.0  # dB: a JPEG or a video at the quality that is written shows a recording better
FAR = 1e-3  # metres by which depth may be off where a layout rounds it
NEAR = 1e-4  # of numbers that are float32 in a layout
Found = tuple[Literal["bad", "note"], str, str, str]


def compare(key: str, recorded: Episode, made: Episode, times: Sequence[int]) -> Iterator[Found]:
    """Level, episode, topic and words of everything that differs; a note for what the layout has no place for."""
    if made.length != recorded.length:
        words = f"{made.length} frames, recorded were {recorded.length}"
        yield "bad", key, "length", words
        return
    if made.instruction != recorded.instruction:
        words = f"found {made.instruction!r}; expected {recorded.instruction!r}"
        yield "bad", key, "instruction", words
    yield from _robot(key, recorded, made)
    for name, view in recorded.views.items():
        other = _counterpart(name, view, made.views, times)
        if other is None:
            who = "it does not show" if name in made.views else "no camera shows"
            words = f"{name}: {who} the same within {LOSSY:g} dB"
            yield "bad", key, "images", words
        else:
            yield from _view(key, name, view, other, times)


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
    for kind, slack in (("depth", FAR), ("ids", 0)):
        before, after = getattr(view, kind), getattr(other, kind)
        if before is None:
            continue
        if after is None:
            yield "note", key, kind, f"{name}: the layout has no place for it"
            continue
        off = max(float(np.abs(before(t).astype(float) - after(t)).max()) for t in times)
        if off > slack:
            yield "bad", key, kind, f"{name}: off by up to {off:.3g}"
    old, new = view.camera, other.camera
    if old.assumed:
        return
    if new.assumed:
        yield "bad", key, "camera", f"{name}: where it is was lost"
    elif not (np.allclose(old.K, new.K) and np.allclose(old.cam_to_world, new.cam_to_world)):
        yield "bad", key, "camera", f"{name}: moved"


def _robot(key: str, recorded: Episode, made: Episode) -> Iterator[Found]:
    for field in ("joint_positions", "gripper_to_world", "gripper_open"):
        old, new = getattr(recorded.robot, field), getattr(made.robot, field)
        if old is None or not old.size:
            continue
        if new is None or old.shape != new.shape:
            yield "note", key, "robot", f"{field}: the layout has another place for it"
        elif not np.allclose(old, new, atol=NEAR):
            yield "bad", key, "robot", f"{field} is off by up to {np.abs(old - new).max():.3g}"
