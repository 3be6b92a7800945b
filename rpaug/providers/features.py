"""What a picture looks like to VGG16 (Simonyan and Zisserman 2015, arXiv 1409.1556): its thirteen convolutions.

Weights are read from a file: an ImageNet state dict in torchvision's layout (`.pth`, `.pt` or `.safetensors`, keys
`features.N.weight`). Nothing is downloaded. `origin` is the file's name.
"""

import hashlib
import io
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from rpaug.core.errors import BadInput, MissingExtra
from rpaug.core.files import read_bytes

BLOCKS = (2, 2, 3, 3, 3)  # convolutions between poolings
LAYERS = tuple(f"conv{b + 1}_{c + 1}" for b, count in enumerate(BLOCKS) for c in range(count))
TORCHVISION = dict(zip(LAYERS, (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28), strict=True))
LEAST = 16  # pixels a side: smaller pictures are spent before the last block
MEAN, DEVIATION = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)  # of ImageNet's RGB, 0 to 255
FILE = "vgg16-397923af.pth"  # torchvision's
URL = f"https://download.pytorch.org/models/{FILE}"


@dataclass(frozen=True)
class VGG16:
    """The convolutions, by layer name: kernels (out, in, 3, 3) and biases (out). `digest` names their content."""

    convolutions: Mapping[str, tuple[Tensor, Tensor]]
    origin: str
    digest: str

    def features(
        self, images: Float[Tensor, "b 3 h w"], layers: Sequence[str]
    ) -> dict[str, Float[Tensor, "b c y x"]]:
        """The rectified outputs of some layers for RGB pictures in 0..1; gradients flow back to the pictures.

        Layers of block k have pictures of 2^(k-1) pixels a cell. Raises ValueError for an unknown layer.
        """
        if not layers or set(layers) - set(LAYERS):
            raise ValueError(f"layers are {list(layers)}; expected some of {', '.join(LAYERS)}")
        mean, deviation = (images.new_tensor(v)[:, None, None] for v in (MEAN, DEVIATION))
        x = (255 * images - mean) / deviation
        found: dict[str, Tensor] = {}
        for name in LAYERS[: 1 + max(map(LAYERS.index, layers))]:
            if name.endswith("_1") and name != LAYERS[0]:
                x = functional.max_pool2d(x, 2)
            kernel, bias = self.convolutions[name]
            x = functional.relu(functional.conv2d(x, kernel, bias, padding=1))
            if name in layers:
                found[name] = x
        return found


def default() -> Path:
    """Where torch keeps the weights that torchvision downloads."""
    return Path(torch.hub.get_dir()) / "checkpoints" / FILE


def load(path: Path | None = None) -> VGG16:
    """VGG16 from a file, by default torchvision's if it is in torch's cache. Raises BadInput or MissingExtra."""
    where = default() if path is None else Path(path)
    if not where.is_file():
        raise BadInput(
            where,
            "VGG16 weights",
            found="nothing",
            expected=f"an ImageNet state dict of VGG16: put {URL} there, or give the path of a file of your own",
        )
    return imagenet(where, state(where))


def imagenet(where: Path, arrays: Mapping[str, Tensor]) -> VGG16:
    """VGG16 of a torchvision state dict that `where` held; what follows the convolutions is left out."""
    named = {
        f"{layer}.{part}": arrays[f"features.{number}.{part}"]
        for layer, number in TORCHVISION.items()
        for part in ("weight", "bias")
        if f"features.{number}.{part}" in arrays
    }
    return VGG16(_convolutions(where, named), where.name, _digest(named))


def state(where: Path) -> dict[str, Tensor]:
    """The tensors of a `.pt`, `.pth` or `.safetensors` file by name. Raises BadInput or MissingExtra."""
    readers = {".pth": _torch, ".pt": _torch, ".safetensors": _safetensors}
    if where.suffix not in readers:
        raise BadInput(
            where, "ending", found=repr(where.suffix), expected=f"one of {', '.join(readers)}"
        )
    data = read_bytes(where)
    try:
        return {
            str(name): value
            for name, value in readers[where.suffix](data).items()
            if isinstance(value, Tensor)
        }
    except (
        ValueError,
        KeyError,
        AttributeError,
        EOFError,
        OSError,
        RuntimeError,
        pickle.UnpicklingError,
    ) as error:
        found = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise BadInput(
            where, "weights", found=found, expected="undamaged tensors by name"
        ) from None


def _torch(data: bytes) -> Mapping[str, Tensor]:
    return torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)


def _safetensors(data: bytes) -> Mapping[str, Tensor]:
    try:
        from safetensors import SafetensorError
        from safetensors.torch import load as decode
    except ImportError:
        raise MissingExtra("safetensors", "models") from None
    try:
        return decode(data)
    except SafetensorError as error:
        raise ValueError(str(error)) from None


def _digest(arrays: Mapping[str, Tensor]) -> str:
    """What tells one set of weights from another, whatever file they lay in."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode() + arrays[name].float().numpy().tobytes())
    return digest.hexdigest()[:16]


def _convolutions(where: Path, arrays: Mapping[str, Tensor]) -> dict[str, tuple[Tensor, Tensor]]:
    """The thirteen layers, each of which takes what the one before it gives. Raises BadInput."""
    found, channels = {}, 3
    for layer in LAYERS:
        kernel, bias = (arrays.get(f"{layer}.{part}") for part in ("weight", "bias"))
        shapes = [None if a is None else tuple(a.shape) for a in (kernel, bias)]
        if kernel is None or bias is None or shapes[0] != (len(bias), channels, 3, 3):
            raise BadInput(
                where,
                layer,
                found=f"weight {shapes[0]}, bias {shapes[1]}",
                expected=f"(n, {channels}, 3, 3) and (n,)",
            )
        found[layer] = (kernel.float(), bias.float())
        channels = len(bias)
    return found
