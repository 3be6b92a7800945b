"""What a run made of a dataset, in numbers: how often each factor was drawn and between which values, and what images
and robot states come to, recorded and written.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from rpaug.core import registry, sampling
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.types import Episode
from rpaug.pipeline import journal, report

FRAMES = 8  # of each camera of an episode
SHORT = 4  # numbers of a list
WORDS = 8  # of a value that is no number, the most frequent
Progress = Callable[[int, int], None]


@dataclass
class FactorDrawn:
    """One operator: copies it was drawn in, copies that left it out, and its drawn values by their keys: numbers as
    lowest, mean, highest, anything else as how often."""

    drawn: int = 0
    left_out: int = 0
    numbers: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    words: dict[str, dict[str, int]] = field(default_factory=dict)


@dataclass
class Data:
    """Means and standard deviations over some episodes: `images` by camera, channels in 0..255; `depth` by camera, in
    metres; `robot` by what was recorded, a number for each of its columns."""

    episodes: int = 0
    images: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    depth: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    robot: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)


@dataclass
class Statistics:
    """Of an output: its edited copies, factors by operator, its data, and the recorded data if that was given."""

    copies: int
    factors: dict[str, FactorDrawn]
    written: Data
    recorded: Data | None


def statistics(
    target: Path, source: Path | None, most: int, progress: Progress = lambda done, total: None
) -> Statistics:
    """Reports of all copies, and the data of `most` episodes, evenly spread; those of `source` are of the same split.

    Raises BadInput where an output has no journal.
    """
    made = journal.read(target).made
    if not made.count(""):
        raise BadInput(target, "output", found="no episode", expected="what rpaug augment wrote")
    factors, values, copies = dict[str, FactorDrawn](), dict[str, dict[str, list[Any]]](), 0
    for key, _ in made.of(""):
        told = report.of(target / key) or {}
        copies += bool(told.get("synthetic"))
        for draw in told.get("draws", ()):
            _count(draw, factors, values)
    for name, held in values.items():
        _summed(factors[name], held)
    given = [target] if source is None else [target, source]
    keys = {root: _some(root, most) for root in given}
    total, done = sum(map(len, keys.values())), 0
    data = []
    for root, some in keys.items():
        found = _Sums()
        for key in some:
            progress(done, total)
            found.add(registry.read(root, key))
            done += 1
        data.append(found.data())
    progress(total, total)
    return Statistics(copies, factors, data[0], data[1] if source is not None else None)


def _some(root: Path, most: int) -> list[str]:
    keys = registry.adapter_for(root).episodes(root)
    return [keys[k] for k in sampling.frames(len(keys), most)]


def _count(
    draw: Mapping[str, Any],
    factors: dict[str, FactorDrawn],
    values: dict[str, dict[str, list[Any]]],
) -> None:
    if draw.get("skipped") or "op" not in draw:
        return
    factor = factors.setdefault(draw["op"], FactorDrawn())
    if draw.get("left_out"):
        factor.left_out += 1
        return
    factor.drawn += 1
    held = values.setdefault(draw["op"], {})
    for key, value in _leaves(draw.get("edit") or {}, ""):
        held.setdefault(key, []).append(value)


def _leaves(tree: Any, key: str) -> Iterator[tuple[str, Any]]:
    """The values of a drawn edit by their keys, a key for each number of a short list. What was measured for an edit
    (its surfaces, matrices) stands in longer ones and is left out."""
    if isinstance(tree, Mapping):
        for name, part in tree.items():
            yield from _leaves(part, f"{key}.{name}" if key else str(name))
    elif isinstance(tree, Sequence) and not isinstance(tree, str):
        if len(tree) <= SHORT and all(isinstance(one, int | float) for one in tree):
            for number, part in enumerate(tree):
                yield f"{key}[{number}]", part
    elif tree is not None:
        yield key, tree


def _summed(factor: FactorDrawn, held: Mapping[str, list[Any]]) -> None:
    for key, values in held.items():
        if all(isinstance(one, int | float) and not isinstance(one, bool) for one in values):
            numbers = np.array(values, np.float64)
            factor.numbers[key] = float(numbers.min()), float(numbers.mean()), float(numbers.max())
        else:
            factor.words[key] = dict(Counter(map(str, values)).most_common(WORDS))


class _Sums:
    """Sums and sums of squares by kind and name."""

    def __init__(self) -> None:
        self._episodes = 0
        self._held: dict[tuple[str, str], list[Any]] = {}

    def add(self, episode: Episode) -> None:
        """One episode: some frames of each camera, all of the robot's states."""
        self._episodes += 1
        for name, view in episode.views.items():
            for t in sampling.frames(episode.length, FRAMES):
                self._add("images", name, view.rgb(t).reshape(-1, 3).astype(np.float64))
                if view.depth is not None:
                    depth = view.depth(t)
                    self._add("depth", name, depth[depth > 0].reshape(-1, 1).astype(np.float64))
        robot = episode.robot
        states = {
            "joint_positions": robot.joint_positions,
            "joint_velocities": robot.joint_velocities,
        }
        states |= (
            {} if robot.gripper_open is None else {"gripper_open": robot.gripper_open[:, None]}
        )
        if robot.gripper_to_world is not None:
            states["gripper_position"] = robot.gripper_to_world[:, :3, 3]
        for name, values in {**states, **robot.extra}.items():
            if values.dtype.kind == "f" and values.size:
                self._add("robot", name, values.reshape(len(values), -1).astype(np.float64))

    def _add(self, kind: str, name: str, rows: Float64[np.ndarray, "n k"]) -> None:
        held = self._held.setdefault(
            (kind, name), [0, np.zeros(rows.shape[1]), np.zeros(rows.shape[1])]
        )
        if held[1].shape != (rows.shape[1],):
            raise RpaugError(
                f"{name}: {rows.shape[1]} columns in one episode, {len(held[1])} in another"
            )
        held[0] += len(rows)
        held[1] += rows.sum(0)
        held[2] += (rows**2).sum(0)

    def data(self) -> Data:
        """Means and standard deviations."""
        out = Data(self._episodes)
        for (kind, name), (count, total, squares) in self._held.items():
            if count:
                mean = total / count
                spread = np.sqrt(np.maximum(squares / count - mean**2, 0))
                getattr(out, kind)[name] = mean.tolist(), spread.tolist()
        return out
