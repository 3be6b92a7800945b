"""A VGG16 of the real shape with few channels and random weights, as a state dict."""

from pathlib import Path

import numpy as np
import torch

from rpaug.providers.features import LAYERS, TORCHVISION

WIDTHS = {1: 6, 2: 8, 3: 12, 4: 12, 5: 12}


def state_dict(seed: int = 0, widths: dict[int, int] = WIDTHS) -> dict[str, torch.Tensor]:
    """Kernels (He et al. 2015: variance 2 / inputs), zero biases, and a classifier that nobody needs."""
    rng = np.random.default_rng(seed)
    made, channels = {}, 3
    for layer in LAYERS:
        width, name = widths[int(layer[4])], f"features.{TORCHVISION[layer]}"
        kernel = rng.normal(0, np.sqrt(2 / (9 * channels)), (width, channels, 3, 3))
        made[f"{name}.weight"] = torch.from_numpy(kernel.astype(np.float32))
        made[f"{name}.bias"] = torch.zeros(width)
        channels = width
    return {**made, "classifier.0.weight": torch.zeros(2, 2)}


def saved(folder: Path, seed: int = 0) -> Path:
    """The path of a state dict."""
    path = folder / "vgg16.pth"
    torch.save(state_dict(seed), path)
    return path
