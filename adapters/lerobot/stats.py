"""Statistics of a LeRobot dataset: least, most, mean, spread and quantiles of each feature, by episode and of all.

As LeRobot's own (huggingface/lerobot 7427f31, `datasets/compute_stats.py`): images are looked at in some of their
frames and at a coarser grid where they are large, their values in 0..1 and their statistics (3, 1, 1). Quantiles are
those of a histogram; of several episodes they are bounds, the least of the lower and the greatest of the upper ones.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

MOMENTS = ("min", "max", "mean", "std")
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SIDE = 150  # pixels a side that are looked at
FEWEST, MOST, POWER = (
    100,
    10_000,
    0.75,
)  # frames that are looked at: as many as there are to that power
BINS, PADDING = 5000, 1e-10  # of a histogram, and what it reaches beyond the values
Statistics = dict[str, np.ndarray]


def of_numbers(values: np.ndarray) -> Statistics:
    """Of a feature with one row a step; the statistics have the shape of a row, a single number that of (1,)."""
    rows = np.asarray(values, np.float64)
    rows = rows.reshape(len(rows), -1) if rows.ndim < 2 else rows
    return _of(rows) | {"count": np.array([len(rows)])}


def of_images(image: Callable[[int], np.ndarray], length: int, most: float = 255.0) -> Statistics:
    """Of frames (h, w) or (h, w, c), by channel, divided by `most`."""
    count = max(min(length, FEWEST), min(int(length**POWER), MOST))
    looked = np.linspace(0, length - 1, count).round().astype(int)
    pixels = []
    for t in looked:
        frame = image(int(t))
        step = max(1, max(frame.shape[:2]) // SIDE) if max(frame.shape[:2]) >= 2 * SIDE else 1
        small = frame[::step, ::step]
        pixels.append(small.reshape(-1, small.shape[2] if small.ndim == 3 else 1))
    found = _of(np.concatenate(pixels))
    shaped = {name: value.reshape(-1, 1, 1) / most for name, value in found.items()}
    return shaped | {"count": np.array([len(looked)])}


def recorded(given: object, shape: tuple[int, ...]) -> dict[str, Any] | None:
    """Statistics that a dataset holds, if they are whole and of such a shape."""
    if not isinstance(given, dict) or not {*MOMENTS, "count"} <= given.keys():
        return None
    try:
        arrays = {name: np.asarray(given[name], np.float64) for name in given}
    except (TypeError, ValueError):
        return None
    count = arrays.pop("count")
    usable = count.shape == (1,) and count[0] >= 1 and count[0] == np.floor(count[0])
    if not usable or any(one.shape != shape for one in arrays.values()):
        return None
    return {name: one.tolist() for name, one in arrays.items()} | {"count": [int(count[0])]}


def _of(rows: np.ndarray) -> Statistics:
    """Of each column of (n, k) rows."""
    quantiles = np.stack([_quantiles(column) for column in rows.T], 1)
    return {
        "min": rows.min(0),
        "max": rows.max(0),
        "mean": rows.mean(0, dtype=np.float64),
        "std": rows.std(0, dtype=np.float64),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }


def _quantiles(values: np.ndarray) -> np.ndarray:
    """Where a histogram reaches each share of the values, in between in proportion; of one value, that."""
    if len(values) == 1:
        return np.repeat(values.astype(np.float64), len(QUANTILES))
    edges = np.linspace(float(values.min()) - PADDING, float(values.max()) + PADDING, BINS + 1)
    held = np.histogram(values, edges)[0]
    reached = np.cumsum(held)
    wanted = np.array([*QUANTILES.values()]) * len(values)
    at = np.searchsorted(reached, wanted)
    before = reached[at] - held[at]
    within = edges[at] + (wanted - before) / held[at] * (edges[at + 1] - edges[at])
    return np.where(at == 0, edges[0], within)


def together(several: Iterable[Mapping[str, Mapping[str, Any]]]) -> dict[str, Statistics]:
    """Of all episodes, by feature: exact but for the quantiles."""
    merged: dict[str, Statistics] = {}
    for one in several:
        for key, statistics in one.items():
            new = {name: np.asarray(value) for name, value in statistics.items()}
            merged[key] = _merged(merged[key], new) if key in merged else new
    return merged


def _merged(one: Statistics, other: Statistics) -> Statistics:
    """Of two groups (Chan et al. 1979)."""
    n, m = int(one["count"][0]), int(other["count"][0])
    share = m / (n + m)
    apart = other["mean"] - one["mean"]
    variance = one["std"] ** 2 * (1 - share) + other["std"] ** 2 * share
    found = {
        "min": np.minimum(one["min"], other["min"]),
        "max": np.maximum(one["max"], other["max"]),
        "mean": one["mean"] + apart * share,
        "std": np.sqrt(variance + apart**2 * share * (1 - share)),
        "count": np.array([n + m]),
    }
    for name, level in QUANTILES.items():
        if name in one and name in other:
            found[name] = (np.minimum if level <= 0.5 else np.maximum)(one[name], other[name])
    return found


def old(given: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """As v2.1 has them: without quantiles."""
    return {
        key: {name: value for name, value in one.items() if name not in QUANTILES}
        for key, one in given.items()
    }


def low_dimensional(rows: np.ndarray) -> dict[str, Any]:
    """Of all frames' rows of a feature, as GR00T counts them (NVIDIA/Isaac-GR00T, gr00t/data/stats.py)."""
    given = np.asarray(rows, np.float32).reshape(len(rows), -1)
    found = {name: getattr(given, name)(0).tolist() for name in ("mean", "std", "min", "max")}
    return found | {
        name: np.quantile(given, QUANTILES[name], 0).tolist() for name in ("q01", "q99")
    }


def plain(statistics: Mapping[str, Statistics]) -> dict[str, dict[str, Any]]:
    """As JSON has it."""
    return {
        key: {name: value.tolist() for name, value in one.items()}
        for key, one in statistics.items()
    }
