"""What the machine can do, and kernels made ready before they are needed."""

import json

import pytest
from typer.testing import CliRunner

from rpaug.cli import app, checks
from rpaug.core.errors import Unsupported


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A kernel cache of the test's own."""
    monkeypatch.setattr("rpaug.core.jit.cache_folder", lambda: tmp_path)
    monkeypatch.setattr(checks, "_gl", lambda: checks.Check("ok", "OpenGL", "not tried here"))
    return tmp_path


def kernel_cache() -> checks.Check:
    (found,) = (one for one in checks.examine() if one.topic == "kernel cache")
    return found


def test_an_empty_cache_says_what_fills_it(cache):
    found = kernel_cache()
    assert found.level == "note"
    assert "rpaug doctor --warm" in found.message


def test_a_filled_cache_says_how_much_it_holds(cache):
    (cache / "kernels" / "splat-0").mkdir(parents=True)
    for name in ("a", "b"):
        (cache / "kernels" / "splat-0" / f"{name}.nbc").write_bytes(bytes(2_000_000))
    found = kernel_cache()
    assert found.level == "ok"
    assert found.message == f"{cache}: 2 kernels, 4 MB"


def test_a_cache_nobody_can_write_to_is_a_note(cache, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: False)
    found = kernel_cache()
    assert found.level == "note"
    assert "not writable" in found.message


def test_warming_tells_the_seconds_of_each_channel_count():
    steps = []
    warmed = list(checks.warm(progress=lambda done, total: steps.append((done, total))))
    assert [one.channels for one in warmed] == [None, 4, 20]
    assert all(one.cpu_seconds > 0 for one in warmed)
    assert steps == [(0, 3), (1, 3), (2, 3), (3, 3)]


def test_more_features_than_the_rasteriser_takes_are_refused():
    with pytest.raises(Unsupported, match="at most 64"):
        list(checks.warm([65]))


def test_the_command_gives_seconds_and_findings(monkeypatch):
    made = checks.Warmed("Gaussians, color and depth", 4, 2.0, 1.5)
    monkeypatch.setattr(checks, "warm", lambda progress: iter([made]))
    monkeypatch.setattr(checks, "examine", lambda: [checks.Check("ok", "rpaug", "here")])
    result = CliRunner().invoke(app, ["doctor", "--warm", "--json"])
    described = json.loads(result.stdout)
    assert described["warmed"] == [vars(made)]
    assert described["findings"][0]["topic"] == "rpaug"
    assert "1.5 s of the processor" in CliRunner().invoke(app, ["doctor", "--warm"]).stdout


def test_what_is_missing_comes_with_the_line_that_mends_it(monkeypatch):
    there = checks._version
    gone = {"zarr", "pyarrow"}
    monkeypatch.setattr(
        checks, "_version", lambda one: None if checks._name(one) in gone else there(one)
    )
    found = {(one.level, one.topic): one.message for one in checks._packages()}
    assert "missing: zarr; mend it: pip install 'zarr>=3.0'" in found["bad", "packages"]
    assert "pip install 'rpaug[lerobot]'" in found["note", "extra lerobot"]
    assert "numpy " in found["ok", "packages"]
