"""Every factor's edit in the light that it was recorded in, as a table: plain, under shadows, highlights or both."""

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from tools.bench.harness import pages
from tools.bench.harness.cases import ESTIMATED, TOLD
from tools.bench.harness.edits import BASELINES, TOLD_MORE, EditRow, EditSetting, Light

TITLES: Mapping[Light, str] = {
    "plain": "without cast shadows or highlights",
    "shadows": "under cast shadows",
    "highlights": "under highlights",
    "both": "under cast shadows and highlights",
}
TOPICS: Mapping[Light, str] = {
    "plain": "lights",
    "shadows": "lights",
    "highlights": "highlights",
    "both": "lights",
}
assert set(TITLES) == set(TOPICS) == set(get_args(Light))

# Of estimated edits, dB at least.
TARGETS: Mapping[Light, Mapping[str, int]] = {
    "plain": {},
    "shadows": {
        "object_color": 33,
        "object_texture": 26,
        "table_color": 32,
        "table_texture": 28,
        "background_texture": 24,
        "light_direction": 30,
    },
    "highlights": {"object_color": 36, "table_color": 33, "light_color": 35},
    "both": {},
}


def table(setting: EditSetting, rows: Sequence[EditRow], command: str) -> pages.Table:
    """One row a factor; where the recipe is left to estimate nothing, and where it is given nothing, "-".

    A lead is over the best baseline of the same seed that knows no more.
    """
    out: list[list[pages.Cell]] = []
    for factor in dict.fromkeys(row.factor for row in rows):
        mine = [row for row in rows if row.factor == factor]
        given, estimated = (_figures(mine, {one}, "psnr") for one in (TOLD, ESTIMATED))
        made = {row.seed for row in mine if row.method in (TOLD, ESTIMATED)}
        out.append(
            [
                factor,
                _mean(given),
                _least(given),
                _best(mine, BASELINES),
                _aimed(_least(_leads(mine, TOLD)), 0),
                _aimed(_mean(estimated), TARGETS[setting.light].get(factor)),
                _least(estimated),
                _best(mine, BASELINES - TOLD_MORE),
                _aimed(_least(_leads(mine, ESTIMATED)), 0),
                _mean(_figures(mine, {ESTIMATED}, "seconds") or _figures(mine, {TOLD}, "seconds")),
                setting.seeds - len(made),
            ]
        )
    columns = ["factor"]
    for known in ("given", "estimated"):
        columns += [known, f"{known}, worst", f"best 2D baseline, {known}", f"least lead, {known}"]
    columns += ["processor s", "seeds refused"]
    finish = f", {setting.finish} things" if setting.finish else ""
    tasks = {row.seed: row.task for row in rows}
    seeds = ", ".join(f"{seed} ({task})" for seed, task in sorted(tasks.items()))
    return pages.Table(
        id=setting.finish or setting.light,
        title=f"dB in the changed region {TITLES[setting.light]}{finish}",
        command=command,
        seeds=f"seeds {seeds}, {setting.frames} frames, five cameras",
        columns=columns,
        rows=out,
        **pages.stamp(),
    )


def _figures(rows: Sequence[EditRow], methods: set[str], name: str) -> list[float]:
    return [row.figures[name] for row in rows if row.method in methods]


def _mean(values: Sequence[float]) -> Any:
    return round(sum(values) / len(values), 1) if values else "-"


def _least(values: Sequence[float]) -> Any:
    return round(min(values), 1) if values else "-"


def _leads(rows: Sequence[EditRow], method: str) -> list[float]:
    """By how much a method is better than the best baseline on each seed."""
    fair = BASELINES - (TOLD_MORE if method == ESTIMATED else frozenset())
    found = []
    for ours in (row for row in rows if row.method == method):
        beside = [row for row in rows if row.seed == ours.seed]
        best = max(_figures(beside, set(fair), "psnr"), default=None)
        found += [] if best is None else [ours.figures["psnr"] - best]
    return found


def _best(rows: Sequence[EditRow], methods: frozenset[str]) -> Any:
    found = {row.method for row in rows} & methods
    return max((_mean(_figures(rows, {one}, "psnr")) for one in found), default="-")


def _aimed(value: Any, target: int | None) -> pages.Cell:
    return value if target is None or value == "-" else {"value": value, "target": f">= {target}"}
