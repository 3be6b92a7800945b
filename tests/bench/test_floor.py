"""What a run costs on one real episode."""

from pathlib import Path

import pytest

from tools.bench import floor


def test_a_further_copy_is_what_more_copies_add(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a start of 2 s, the first copy's 3 s and 0.5 s for each further one; slow runs count by their median."""
    slow = iter([0.0, 0.0, 9.0, 0.0, 0.0, 9.0, 0.0])  # the first is the warm-up

    def run(
        source: Path, folder: Path, recipe: object, copies: int, *options: str
    ) -> tuple[float, float, float]:
        return 2 + 3 + 0.5 * (copies - 1) + next(slow), 100.0 * copies, 1.0

    monkeypatch.setattr(floor, "run", run)
    assert floor.copied(Path("episodes"), Path("runs"), "recolor", 3) == (5.0, 0.5, 500.0)


def test_a_run_that_fails_is_no_figure(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="exit code 2"):
        floor.run(tmp_path / "nowhere", tmp_path, "light_color", 1)
