"""What `--device` comes to, with every part of a GPU's machine there or missing."""

import subprocess
import sys

import pytest

from rpaug.core import devices
from rpaug.core.devices import DevicePart
from rpaug.core.errors import Unsupported

NAMES = ("_driver", "_torch", "_gsplat", "_kernels")


def lacking(monkeypatch: pytest.MonkeyPatch, missing: str | None) -> None:
    """A machine with all parts but one."""
    for name in NAMES:
        part = DevicePart(name, "" if name == missing else f"{name} found", f"no {name}", "do this")
        monkeypatch.setattr(devices, name, lambda part=part: part)


def test_a_whole_machine_fits_on_its_gpu(monkeypatch):
    lacking(monkeypatch, None)
    for asked in ("auto", "cuda"):
        assert devices.chosen(asked) == devices.Device("cuda", "_torch found")
    assert (devices.backend("cuda"), devices.backend("cpu")) == ("gsplat", "auto")
    assert devices.chosen("cpu") == devices.Device("cpu", "as asked")


@pytest.mark.parametrize("name", NAMES)
def test_what_is_missing_is_said_once_with_what_mends_it(monkeypatch, name):
    lacking(monkeypatch, name)
    found = devices.chosen("auto")
    assert found.name == "cpu"
    assert found.why == f"no {name}; mend it: do this"
    with pytest.raises(Unsupported, match=f"--device cuda: no {name}; mend it: do this"):
        devices.chosen("cuda")


def test_an_unknown_device_is_refused():
    with pytest.raises(ValueError, match="auto, cpu, cuda"):
        devices.chosen("tpu")


def test_without_a_driver_torch_is_not_imported():
    program = (
        "import sys; from rpaug.core import devices; devices.DRIVERS = (); devices.shutil.which = lambda name: None;"
        "assert devices.chosen('auto').name == 'cpu'; assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_torch_for_the_cpu_is_named(monkeypatch):
    import torch

    monkeypatch.setattr(torch.version, "cuda", None)
    assert "built for the CPU" in str(devices._torch())
    monkeypatch.setattr(torch.version, "cuda", "12.6")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert "sees no GPU" in str(devices._torch())


def test_kernels_are_found_compiled_or_with_what_compiles_them(monkeypatch, tmp_path):
    monkeypatch.setattr(devices.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(devices.shutil, "which", lambda name: None)
    monkeypatch.setenv("CUDA_HOME", str(tmp_path))
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path))
    assert "no nvcc" in str(devices._kernels())
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "nvcc").write_text("")
    assert "not yet compiled" in devices._kernels().found
    (tmp_path / "gsplat_cuda").mkdir()
    (tmp_path / "gsplat_cuda" / "gsplat_cuda.so").write_text("")
    assert "compiled: " in devices._kernels().found
