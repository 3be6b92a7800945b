"""Light that a turning surface meets: irradiance as a quadratic in its normal (Ramamoorthi and Hanrahan 2001).

A link that turns under fixed lamps is lit anew at every frame, so one color a Gaussian cannot show it. The light is
the scene's: eight numbers for all bodies and times, relative to a face lit evenly.
"""

import numpy as np
from jaxtyping import Float32, Float64

TERMS = 9
RATE = 0.02  # of a step of Adam
LEAST = 0.1  # of even light: what no face goes below


def even() -> Float64[np.ndarray, "9"]:
    """Light that is the same from everywhere."""
    return np.eye(1, TERMS)[0]


def basis(normals: Float32[np.ndarray, "m 3"]) -> Float32[np.ndarray, "m 9"]:
    """1, x, y, z, xy, yz, zx, x² - y², 3z² - 1 of unit normals in the world."""
    x, y, z = normals.T
    rows = [np.ones_like(x), x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
    return np.stack(rows, -1)


def shading(
    terms: Float32[np.ndarray, "m 9"], light: Float64[np.ndarray, "9"]
) -> Float32[np.ndarray, "m"]:
    """How many times brighter than in even light each surface is."""
    return np.maximum(terms @ light.astype(np.float32), np.float32(LEAST))


class Learner:
    """The light under a fit: steps of Adam (Kingma and Ba 2015), the even part held."""

    def __init__(self) -> None:
        self.light = even()
        self._mean, self._square, self._steps = np.zeros(TERMS), np.zeros(TERMS), 0

    def step(self, gradient: Float64[np.ndarray, "9"], factor: float) -> None:
        """One step against the gradient, its rate times `factor`."""
        self._steps += 1
        self._mean = 0.9 * self._mean + 0.1 * gradient
        self._square = 0.99 * self._square + 0.01 * gradient**2
        mean = self._mean / (1 - 0.9**self._steps)
        size = np.sqrt(self._square / (1 - 0.99**self._steps)) + 1e-15
        self.light[1:] -= factor * RATE * (mean / size)[1:]
