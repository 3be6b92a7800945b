"""Which device draws and fits: the CPU, or a GPU that torch can use."""

from typing import TYPE_CHECKING

from rpaug.core.errors import Unsupported

if TYPE_CHECKING:
    import torch


def torch_device(name: str) -> "torch.device":
    """A device by its name, "auto" for a GPU where torch sees one. Raises Unsupported for one that is not there."""
    import torch  # only here: it takes long to come

    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        found = torch.device(name)
    except RuntimeError:
        raise Unsupported(f"device {name!r}: expected auto, cpu, cuda or cuda:N") from None
    if found.type not in ("cpu", "cuda"):
        raise Unsupported(f"device {name!r}: expected auto, cpu, cuda or cuda:N")
    if found.type == "cuda" and not torch.cuda.is_available():
        raise Unsupported(f"device {name}: torch {torch.__version__} sees no CUDA GPU")
    return found
