"""An output is compared with what was written, to the byte."""

import json
from pathlib import Path

import pytest
import rlds_samples
from runs import GROUP, augment
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.errors import BadInput
from rpaug.pipeline import recipe
from rpaug.pipeline.audit import audit

WANTED = recipe.build({"version": 1, "copies": 2, "edits": [{"op": "light_color"}]})
KEY = f"{GROUP}/episode1"


@pytest.fixture(scope="module")
def out(template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("audited") / "out"
    augment(template, WANTED, path)
    return path


def test_what_was_written_is_as_it_was(out: Path) -> None:
    found = audit(out)
    assert (found.episodes, found.faults) == (4, {})


@pytest.mark.parametrize("name", ["front_rgb/3.png", "low_dim_obs.pkl", "rpaug.json"])
def test_one_bit_of_an_episode_is_seen(name: str, out: Path) -> None:
    path = out / KEY / name
    whole = path.read_bytes()
    path.write_bytes(whole[:40] + bytes([whole[40] ^ 1]) + whole[41:])
    assert audit(out).faults == {
        KEY: "found other names or bytes than were written, of the same size"
    }
    path.write_bytes(whole[:-1])
    assert "files of" in audit(out).faults[KEY]
    path.write_bytes(whole)
    assert not audit(out).faults


def test_shared_files_are_read_too(tmp_path: Path) -> None:
    source, out = rlds_samples.dataset(tmp_path / "in"), tmp_path / "out"
    augment(source, recipe.build({"version": 1, "edits": [{"op": "sensor_noise"}]}), out)
    assert not audit(out).faults
    (path,) = out.rglob("toy-val.tfrecord*")
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    name = path.relative_to(out).as_posix()
    assert audit(out).faults == {name: "found other bytes than were written, as many"}
    path.unlink()
    assert "found nothing" in audit(out).faults[name]


def test_the_command_says_what_was_done_to_an_episode(out: Path) -> None:
    given = CliRunner().invoke(app, ["audit", str(out), KEY])
    assert given.exit_code == 0, given.output
    assert "copy 1 of" in given.output
    assert "light_color: {" in given.output
    assert "1 episode, 0 shared files: as they were written" in given.output
    described = json.loads(CliRunner().invoke(app, ["audit", str(out), KEY, "--json"]).stdout)
    assert described["report"]["copy"] == 1
    with pytest.raises(BadInput, match="one of: "):
        audit(out, "episode77")
    with pytest.raises(BadInput, match="no run of rpaug here"):
        audit(out / GROUP)
