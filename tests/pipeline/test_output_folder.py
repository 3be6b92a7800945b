"""The output folder of a run, whatever the number of its episodes."""

import json
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import pytest

from rpaug.core.errors import BadInput
from rpaug.pipeline import output_folder, report


def folder(root: Path, count: int) -> SimpleNamespace:
    """As much of a run as its reports need: each report fills some 100 kB."""
    given = json.dumps({"draws": [{"step": n, "edit": {"points": [n] * 40}} for n in range(500)]})
    for number in range(count):
        (root / str(number)).mkdir(parents=True)
        (root / str(number) / report.NAME).write_text(given)
    episodes = SimpleNamespace(episodes=lambda _: [str(number) for number in range(count)])
    return SimpleNamespace(target=root, adapter=episodes)


def test_one_report_is_in_memory_however_many_there_are(tmp_path: Path) -> None:
    peaks = []
    for count in (2, 40):
        run = folder(tmp_path / str(count), count)
        tracemalloc.start()
        seen = sum(len(one["draws"]) for one in output_folder.Reports(run).values())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert seen == 500 * count
    assert peaks[1] < 1.5 * peaks[0]  # nearly the same: the peak is one report as text and values


def test_an_episode_without_a_report_is_named(tmp_path: Path) -> None:
    run = folder(tmp_path, 2)
    (tmp_path / "1" / report.NAME).unlink()
    with pytest.raises(BadInput, match="report: found none that can be read"):
        list(output_folder.Reports(run).values())
