"""Rows of speed and error: as files, those that nothing else beats in both, and a plot that marks them."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rpaug.core.errors import MissingExtra


def as_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """One line a row under the first row's keys; nothing is left for None."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def as_json(setting: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], **more: Any) -> bytes:
    """What was asked for, anything more, and all rows in one document."""
    return (json.dumps({"setting": setting, **more, "rows": rows}, indent=1) + "\n").encode()


def front(seconds: Float[np.ndarray, "n"], error: Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Rows that no other row beats in one and equals in the other; both are better where lower."""
    as_fast = seconds[None] <= seconds[:, None]
    as_good = error[None] <= error[:, None]
    better = (seconds[None] < seconds[:, None]) | (error[None] < error[:, None])
    known = np.isfinite(seconds) & np.isfinite(error)
    return known & ~(as_fast & as_good & better & known[None]).any(1)


@dataclass(frozen=True)
class Panel:
    """One picture of a figure: what is on its axes; `higher` where more of `quality` is better."""

    title: str
    seconds: str
    quality: str
    across: str
    up: str
    higher: bool = True
    logarithmic: bool = False


def unbeaten(rows: Sequence[Mapping[str, Any]], panel: Panel) -> list[Mapping[str, Any]]:
    """The front's rows, the fastest first."""
    seconds = np.array([row[panel.seconds] for row in rows], float)
    quality = np.array([row[panel.quality] for row in rows], float)
    best = np.flatnonzero(front(seconds, -quality if panel.higher else quality))
    return [rows[row] for row in best[np.argsort(seconds[best])].tolist()]


def plot(
    path: Path,
    rows: Sequence[Mapping[str, Any]],
    panels: Sequence[Panel],
    *,
    group: str,
    label: str,
    within: str | None = None,
) -> Path:
    """A panel beside another: a color for each value of `group`, the front's rows ringed, joined and labelled.

    With `within`, only rows that agree in it are compared, so that each of its values has a front of its own.
    Rows that lack one of a panel's two figures, or that its logarithm cannot show, are left out of it. Raises
    MissingExtra without matplotlib.
    """
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtra("matplotlib", "dev") from None
    mpl.use("Agg")
    from matplotlib import pyplot

    figure, places = pyplot.subplots(
        1, len(panels), figsize=(6.5 * len(panels), 5), layout="constrained", squeeze=False
    )
    groups = list(dict.fromkeys(row[group] for row in rows))
    for axes, panel in zip(places[0], panels, strict=True):
        shown = [row for row in rows if None not in (row[panel.seconds], row[panel.quality])]
        shown = [row for row in shown if not panel.logarithmic or row[panel.quality] > 0]
        for number, name in enumerate(groups):
            members = [row for row in shown if row[group] == name]
            axes.plot(
                [row[panel.seconds] for row in members],
                [row[panel.quality] for row in members],
                "o", color=f"C{number % 10}", ms=5, alpha=0.8, label=str(name),
            )  # fmt: skip
        for case in dict.fromkeys(row[within] if within else None for row in shown):
            same = [row for row in shown if not within or row[within] == case]
            _front(axes, same, panel, label)
        axes.set(xscale="log", xlabel=panel.across, ylabel=panel.up, title=panel.title)
        if panel.logarithmic:
            axes.set_yscale("log")
        axes.grid(alpha=0.25)
    places[0][-1].legend(fontsize=7, title=group, title_fontsize=7)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)
    return path


def _front(axes: Any, rows: Sequence[Mapping[str, Any]], panel: Panel, label: str) -> None:
    best = unbeaten(rows, panel)
    seconds = [row[panel.seconds] for row in best]
    quality = [row[panel.quality] for row in best]
    axes.plot(seconds, quality, "-", color="0.45", lw=1, zorder=0)
    axes.plot(seconds, quality, "o", ms=10, mfc="none", mec="0.2", lw=1)
    for row in best:
        axes.annotate(
            str(row[label]), (row[panel.seconds], row[panel.quality]), fontsize=7, xytext=(6, -9),
            textcoords="offset points",
        )  # fmt: skip
