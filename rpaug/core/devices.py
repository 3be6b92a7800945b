"""What `--device` means here: the CPU, or a CUDA GPU where all that it takes is at hand; and in words, what is not."""

import importlib.util
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from rpaug.core.errors import Unsupported

if TYPE_CHECKING:
    import torch

Asked = Literal["auto", "cpu", "cuda"]
DRIVERS = (
    "/proc/driver/nvidia",
    "/dev/nvidiactl",
    "/dev/dxg",
)  # of Linux, of its containers, of WSL


@dataclass(frozen=True)
class DevicePart:
    """One thing that a GPU's fits take: `found` in words, or "" and what would `mend` that it is not."""

    name: str
    found: str
    lacking: str
    mend: str

    def __str__(self) -> str:
        return self.found or f"{self.lacking}; mend it: {self.mend}"


@dataclass(frozen=True)
class Device:
    """What is used, `cpu` or `cuda`, and why: the GPU's name, or what the GPU lacks."""

    name: str
    why: str


def backend(name: str) -> str:
    """What draws the Gaussians of fits on a device, as `render.splat.engines` calls it."""
    return {"cpu": "auto", "cuda": "gsplat"}[name]


def chosen(asked: str = "auto") -> Device:
    """The device for an option's value. Raises Unsupported for `cuda` where that cannot be, naming what is missing.

    torch is imported only where there is a driver.
    """
    if asked not in get_args(Asked):
        raise ValueError(f"device is {asked!r}; expected {', '.join(get_args(Asked))}")
    if asked == "cpu":
        return Device("cpu", "as asked")
    found = []
    for part in parts():
        if not part.found:
            if asked == "cuda":
                raise Unsupported(f"--device cuda: {part}")
            return Device("cpu", str(part))
        found.append(part)
    return Device("cuda", found[1].found)


def torch_device(name: str) -> "torch.device":
    """A device that draws batches, by its name; "auto" is a GPU where torch sees one. Raises Unsupported for one that
    is not there."""
    import torch  # only here: it takes seconds

    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        found = torch.device(name)
    except RuntimeError:
        raise Unsupported(f"device {name!r}: expected auto, cpu, cuda or cuda:N") from None
    if found.type not in ("cpu", "cuda"):
        raise Unsupported(f"device {name!r}: expected auto, cpu, cuda or cuda:N")
    if found.type == "cuda":
        for part in (_driver(), _torch()):
            if not part.found:
                raise Unsupported(f"device {name}: {part}")
    return found


def parts() -> Iterator[DevicePart]:
    """What fits on a GPU take, what comes first first."""
    yield _driver()
    yield _torch()
    yield _gsplat()
    yield _kernels()


def _driver() -> DevicePart:
    there = any(os.path.exists(place) for place in DRIVERS) or shutil.which("nvidia-smi")
    return DevicePart(
        "GPU driver",
        "an NVIDIA driver is loaded" if there else "",
        "no NVIDIA driver",
        "NVIDIA's driver on a machine with such a GPU (a container is started with `--gpus all`)",
    )


def _torch() -> DevicePart:
    wheel = "pip install --force-reinstall torch --index-url https://download.pytorch.org/whl/cu126"
    if importlib.util.find_spec("torch") is None:
        return DevicePart("torch with CUDA", "", "torch is not installed", wheel)
    import torch  # only here: it takes seconds

    if torch.version.cuda is None:
        return DevicePart(
            "torch with CUDA", "", f"torch {torch.__version__} is built for the CPU", wheel
        )
    told = f"torch {torch.__version__} for CUDA {torch.version.cuda}"
    if not torch.cuda.is_available():
        mend = (
            f"a driver for CUDA {torch.version.cuda} (nvidia-smi tells what it has), and a "
            "CUDA_VISIBLE_DEVICES that hides none"
        )
        return DevicePart("torch with CUDA", "", f"{told} sees no GPU", mend)
    return DevicePart("torch with CUDA", f"{torch.cuda.get_device_name(0)}, {told}", "", "")


def _gsplat() -> DevicePart:
    there = importlib.util.find_spec("gsplat") is not None
    return DevicePart(
        "gsplat",
        "gsplat is installed" if there else "",
        "gsplat is not installed",
        "pip install 'rpaug[cuda]'",
    )


def _kernels() -> DevicePart:
    """Looked for, not tried: gsplat compiles them where it is imported first, which takes minutes."""
    name = "gsplat's kernels"
    if importlib.util.find_spec("gsplat") and importlib.util.find_spec("gsplat.csrc"):
        return DevicePart(name, "they came built", "", "")
    if made := _compiled():
        return DevicePart(name, f"compiled: {made}", "", "")
    if nvcc := _nvcc():
        return DevicePart(
            name, f"not yet compiled; the first fit does that in minutes, by {nvcc}", "", ""
        )
    return DevicePart(
        name,
        "",
        "they are not built, and there is no nvcc to build them",
        "the CUDA toolkit's nvcc on the PATH or under CUDA_HOME, or a gsplat wheel for this torch and CUDA",
    )


def _compiled() -> str:
    """The library that gsplat compiled before; "" if it did not."""
    home = os.environ.get("TORCH_EXTENSIONS_DIR", "")
    folder = Path(home) if home else Path.home() / ".cache" / "torch_extensions"
    return next((str(path) for path in sorted(folder.glob("**/gsplat_cuda.so"))), "")


def _nvcc() -> str:
    home = os.environ.get("CUDA_HOME") or os.environ.get("CUDA_PATH") or "/usr/local/cuda"
    inside = Path(home) / "bin" / "nvcc"
    return str(inside) if inside.is_file() else shutil.which("nvcc") or ""
