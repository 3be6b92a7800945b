"""What the bench saw: a contact sheet a factor, a plot of error against seconds, and a page with both."""

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core.errors import MissingExtra
from rpaug.core.files import encode_png, write_atomic
from tools.bench.harness.edits import BASELINES, EditSetting, EditTrial
from tools.bench.harness.scores import regions

TILE = 192  # pixels of one image's height
GAIN = 4  # the difference to the truth is shown four times as strong, around grey
PAGE = "edits.html"
STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem;color:#1d232b;background:#fff}
h1{font-size:1.35rem}h2{font-size:1.05rem;margin:2rem 0 .3rem}
td,th{padding:2px 14px 2px 0;text-align:right}td:nth-child(-n+2),th:nth-child(-n+2){text-align:left}
th{color:#5a6673;font-weight:400}img{max-width:100%}
"""
COLUMNS = ("psnr", "psnr_worst", "lead", "ssim", "ciede2000", "outside_worst", "flicker", "seconds")


class Sheets:
    """Writes one PNG a factor: a row a seed, the camera and frame that show the change most."""

    def __init__(self, folder: Path, setting: EditSetting, most: int = 6) -> None:
        self.folder, self.setting, self.most = folder, setting, most
        self.rows: dict[str, list[UInt8[np.ndarray, "h w 3"]]] = {}

    def keep(self, shot: EditTrial) -> None:
        """Add a seed to its factor's sheet, up to `most` of them."""
        rows = self.rows.setdefault(shot.factor, [])
        if len(rows) < self.most:
            rows.append(_row(shot, self.setting.antialias))

    def write(self) -> dict[str, Path]:
        """The sheets' paths, by factor."""
        paths = {}
        for factor, rows in self.rows.items():
            paths[factor] = self.folder / f"edits-{factor}.png"
            write_atomic(paths[factor], encode_png(np.concatenate(rows)))
        return paths


def page(folder: Path, summary: Sequence[Mapping[str, Any]], images: Sequence[Path]) -> Path:
    """One HTML page with the summary and the images that lie beside it."""
    cells = "".join(
        f"<tr><td>{html.escape(entry['factor'])}<td>{html.escape(entry['method'])}"
        + "".join(f"<td>{_number(entry[name])}" for name in COLUMNS)
        for entry in summary
    )
    head = "<tr><th>factor<th>method" + "".join(f"<th>{name}" for name in COLUMNS)
    figures = "".join(
        f"<h2>{html.escape(path.stem)}</h2><img alt='{html.escape(path.stem)}' src='{path.name}'>"
        for path in images
    )
    write_atomic(
        folder / PAGE,
        f"<!doctype html><html lang=en><meta charset=utf-8><title>Edits against the truth</title><style>{STYLE}"
        f"</style><h1>Edits against the truth</h1><table>{head}{cells}</table>{figures}</html>".encode(),
    )
    return folder / PAGE


def plot(path: Path, summary: Sequence[Mapping[str, Any]]) -> Path:
    """PSNR in the changed region against CPU seconds, a color a factor. Raises MissingExtra without matplotlib."""
    try:
        import matplotlib as mpl
    except ImportError:
        raise MissingExtra("matplotlib", "dev") from None
    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 5.5), layout="constrained")
    factors = list(dict.fromkeys(entry["factor"] for entry in summary))
    for entry in summary:
        ours = entry["method"] not in BASELINES
        color = f"C{factors.index(entry['factor'])}"
        at = max(entry["seconds"], 1e-3)
        axes.plot([at, at], [entry["psnr_worst"], entry["psnr"]], color=color, lw=1)
        axes.plot(at, entry["psnr"], "o" if ours else "x", color=color, ms=8 if ours else 6)
        label = entry["factor"] if ours else entry["method"]
        axes.annotate(
            label, (at, entry["psnr"]), fontsize=7, xytext=(5, 3), textcoords="offset points"
        )
    axes.set(
        xscale="log",
        xlabel="CPU seconds an episode",
        ylabel="PSNR in the changed region, dB (mean; line to the worst seed)",
        title="o: rpaug   x: baselines",
    )
    figure.savefig(path, dpi=130)
    pyplot.close(figure)
    return path


def _row(shot: EditTrial, antialias: bool) -> UInt8[np.ndarray, "h w 3"]:
    """Recorded, truth, then every method with its difference to the truth below."""
    late = 2 * shot.true.episode.length // 3  # by then something has moved
    found = max(
        regions(shot.recorded, shot.true, antialias),
        key=lambda entry: ((entry[0] != "wrist") * int(entry[2].sum()), -abs(entry[1] - late)),
    )
    name, t = found[0], found[1]
    before, truth = (take.episode.views[name].rgb(t) for take in (shot.recorded, shot.true))
    columns = [
        _column(f"seed {shot.seed} {name} {t}", before, truth),
        _column("truth", truth, truth),
    ]
    columns += [
        _column(method, made.views[name].rgb(t), truth) for method, made in shot.made.items()
    ]
    return np.pad(np.concatenate(columns, 1), ((0, 8), (0, 0), (0, 0)), constant_values=255)


def _column(
    title: str, image: UInt8[np.ndarray, "h w 3"], truth: UInt8[np.ndarray, "h w 3"]
) -> UInt8[np.ndarray, "h w 3"]:
    difference = (image.astype(np.int16) - truth) * GAIN + 128
    tiles = [image, np.clip(difference, 0, 255).astype(np.uint8)]
    width = max(1, round(image.shape[1] * TILE / image.shape[0]))
    scaled = [cv2.resize(tile, (width, TILE), interpolation=cv2.INTER_NEAREST) for tile in tiles]
    head = np.full((18, width, 3), 255, np.uint8)
    cv2.putText(head, title, (2, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (20, 20, 20), 1, cv2.LINE_AA)
    return np.pad(np.concatenate([head, *scaled]), ((0, 0), (0, 4), (0, 0)), constant_values=255)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}" if abs(value) < 1 else f"{value:.1f}"
