"""A VGG16 of the real shape with few channels and random weights, in the formats that the loader takes."""

from pathlib import Path

import numpy as np
import torch

from rpaug.providers.features import LAYERS, TORCHVISION

WIDTHS = {1: 6, 2: 8, 3: 12, 4: 12, 5: 12}


def arrays(seed: int = 0, widths: dict[int, int] = WIDTHS) -> dict[str, np.ndarray]:
    """Kernels (He et al. 2015: variance 2 / inputs) and zero biases by layer."""
    rng = np.random.default_rng(seed)
    made, channels = {}, 3
    for layer in LAYERS:
        width = widths[int(layer[4])]
        deviation = np.sqrt(2 / (9 * channels))
        made[f"{layer}.weight"] = rng.normal(0, deviation, (width, channels, 3, 3))
        made[f"{layer}.bias"] = np.zeros(width)
        channels = width
    return {name: array.astype(np.float32) for name, array in made.items()}


def state_dict(seed: int = 0, widths: dict[int, int] = WIDTHS) -> dict[str, torch.Tensor]:
    """The same under torchvision's names, with a classifier that nobody needs."""
    found = arrays(seed, widths)
    named = {
        f"features.{number}.{part}": torch.from_numpy(found[f"{layer}.{part}"])
        for layer, number in TORCHVISION.items()
        for part in ("weight", "bias")
    }
    return {**named, "classifier.0.weight": torch.zeros(2, 2)}


def saved(folder: Path, seed: int = 0) -> Path:
    """The path of a `.npz` as `rpaug weights vgg16` writes it."""
    path = folder / "vgg16-hed.npz"
    np.savez(path, **arrays(seed))  # type: ignore[arg-type]
    return path
