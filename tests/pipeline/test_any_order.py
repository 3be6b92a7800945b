"""However many workers do the episodes, and in whatever order, the same bytes come out, in every layout."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from runs import augment, contents
from test_merge import MADE, WANTED, rlbench

from rpaug.pipeline import workers
from rpaug.pipeline.job import Job
from rpaug.pipeline.run import Budget


@pytest.fixture(scope="module")
def processes() -> Iterator[list[workers.WorkerProcess]]:
    """Those that did jobs before: starting takes longer than all that is done here."""
    kept: list[workers.WorkerProcess] = []
    yield kept
    for one in kept:
        one.end()


@pytest.mark.parametrize("kind", ["rlbench", *MADE])
def test_several_workers_from_the_last_episode_to_the_first(
    kind: str, processes: list[workers.WorkerProcess], template: Path, tmp_path: Path
) -> None:
    source, lost = tmp_path / "in", list[workers.Lost]()
    rlbench(source, template) if kind == "rlbench" else MADE[kind](source)

    def backwards(jobs: Iterable[Job], most: int, _: Budget | None) -> Iterator[workers.Outcome]:
        last_first = reversed([*jobs])
        with workers.one_thread_each():
            yield from workers.pooled(last_first, lost, Budget(), most, processes)

    augment(source, WANTED, tmp_path / "one")
    augment(source, WANTED, tmp_path / "many", workers=2, engine=backwards)
    assert contents(tmp_path / "many") == contents(tmp_path / "one")
    assert (len(processes), lost) == (2, [])
