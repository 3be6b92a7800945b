"""Numbers of the copies that a run still has to make."""

from pathlib import Path

import pytest
from runs import GROUP

from rpaug.core.fingerprint import Seal
from rpaug.pipeline import recipe
from rpaug.pipeline.made import MadeEpisodes, Noted
from rpaug.pipeline.missing_copies import MissingCopies
from rpaug.pipeline.run import Run


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Two copies of each of three episodes."""
    for number in range(3):
        (tmp_path / "in" / GROUP / f"episode{number}").mkdir(parents=True)
        (tmp_path / "in" / GROUP / f"episode{number}/low_dim_obs.pkl").touch()
    edits = [{"op": "recolor", "target": {"handle": 3}, "color": "red"}]
    wanted = recipe.build({"version": 1, "copies": 2, "edits": edits})
    return Run(tmp_path / "in", wanted, tmp_path / "out")


def numbers(missing: MissingCopies) -> dict[str, list[tuple[int, str]]]:
    return {job.key[-1]: [(copy, key[-1]) for copy, key in job.copies] for job in missing}


def test_first_copies_of_all_come_first(run: Run) -> None:
    missing = MissingCopies(run, MadeEpisodes())
    assert numbers(missing) == {
        "0": [(1, "0"), (2, "3")],
        "1": [(1, "1"), (2, "4")],
        "2": [(1, "2"), (2, "5")],
    }
    assert (len(missing), missing.copies) == (3, 6)
    assert list(missing) == list(missing)  # made anew each time, and the same
    assert all(job in missing for job in missing)


def test_what_is_there_is_not_made_again_and_keeps_its_number(run: Run) -> None:
    done = MadeEpisodes()
    for folder, key, source, copy in (("", 0, 0, 1), ("rejected", 1, 1, 1), ("", 4, 1, 2)):
        one = Noted(f"{GROUP}/episode{source}", copy, Seal(1, 1, "n"), 1, 0)
        done[folder, f"{GROUP}/episode{key}"] = one
    missing = MissingCopies(run, done)
    assert numbers(missing) == {"0": [(2, "3")], "2": [(1, "2"), (2, "5")]}
    assert missing.copies == 3


def test_parts_have_the_numbers_of_the_whole(run: Run) -> None:
    whole = list(MissingCopies(run, MadeEpisodes()))
    parts = [
        job
        for part in (1, 2)
        for job in MissingCopies(
            Run(run.source, run.recipe, run.target, shard=(part, 2)), MadeEpisodes()
        )
    ]
    assert sorted(parts, key=lambda job: job.key) == whole
