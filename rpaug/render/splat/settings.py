"""What goes into a splat render and what comes out: parameters, camera, constants, images."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int32

from rpaug.core.types import Gaussians

LARGEST = (
    1e18  # pixels, or px^2: what lands beyond is left out and counted, before float32 overflows
)


@dataclass(frozen=True)
class Settings:
    """Constants of the image formation model; the defaults are those of gsplat 1.5.3."""

    alpha_max: float = 0.999  # a splat never hides all that lies behind it
    alpha_floor: float = 1.0 / 255.0  # below this a splat leaves a pixel alone
    transmittance_stop: float = 1e-4  # a pixel is finished before the splat that would go below
    dilation: float = 0.3  # px^2 added to both variances on the image plane
    near: float = 0.01  # metres
    frustum_margin: float = 0.3  # how far outside, in half-images, the Jacobian is still followed
    antialiased: bool = False  # Mip-Splatting: opacity shrinks as dilation grows a splat

    def __post_init__(self) -> None:
        if not 0 < self.alpha_max < 1:
            raise ValueError(f"alpha_max is {self.alpha_max}; expected a value inside (0, 1)")
        if not 1 / 255 <= self.alpha_floor < 1:  # the exponential's polynomial ends at ln 255
            raise ValueError(f"alpha_floor is {self.alpha_floor}; expected one in [1/255, 1)")
        if not 0 < self.transmittance_stop < 1:
            raise ValueError(f"transmittance_stop is {self.transmittance_stop}; expected 0 to 1")
        if self.dilation < 0 or not self.near > 0 or self.frustum_margin < 0:
            raise ValueError("dilation and frustum_margin must be >= 0, and near > 0")


@dataclass(frozen=True)
class View:
    """One picture to take: OpenCV axes, pixel centres at integer coordinates."""

    K: Float[np.ndarray, "3 3"]
    world_to_camera: Float[np.ndarray, "4 4"]
    width: int
    height: int

    def __post_init__(self) -> None:
        K, pose = np.asarray(self.K, np.float64), np.asarray(self.world_to_camera, np.float64)
        if K.shape != (3, 3) or pose.shape != (4, 4):
            raise ValueError(f"K is {K.shape}, world_to_camera {pose.shape}; expected 3x3 and 4x4")
        if not (np.isfinite(K).all() and np.isfinite(pose).all()):
            raise ValueError("K or world_to_camera holds a value that is not finite")
        if not (K[0, 0] > 0 and K[1, 1] > 0 and K[0, 1] == 0):
            raise ValueError(f"K is {K.tolist()}; expected positive focal lengths and no skew")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image is {self.width}x{self.height}; expected 1x1 or more")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "world_to_camera", pose)


@dataclass(frozen=True)
class Splats:
    """Gaussians as the rasteriser takes them; shape by `quats` and `scales`, or by `covariances`.

    Units and orders are those of `rpaug.core.types.Gaussians`. `covariances` holds (xx, xy, xz, yy, yz, zz) in
    square metres, world axes. `features` are K more channels, blended like colors. Means may be float64:
    they are taken relative to the camera before anything is rounded.
    """

    means: Float[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, "n"]
    sh: Float32[np.ndarray, "n k 3"]
    quats: Float32[np.ndarray, "n 4"] | None = None
    scales: Float32[np.ndarray, "n 3"] | None = None
    covariances: Float32[np.ndarray, "n 6"] | None = None
    features: Float32[np.ndarray, "n f"] | None = None

    def __post_init__(self) -> None:
        n = len(self.means)
        shapes = {
            "means": (n, 3),
            "opacities": (n,),
            "quats": (n, 4),
            "scales": (n, 3),
            "covariances": (n, 6),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise ValueError(f"{name} is {value.shape}; expected {shape}")
        if self.sh.shape[::2] != (n, 3) or self.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"sh is {self.sh.shape}; expected ({n}, 1 | 4 | 9 | 16, 3)")
        if self.features is not None and (self.features.ndim != 2 or len(self.features) != n):
            raise ValueError(f"features is {self.features.shape}; expected ({n}, channels)")
        if (self.covariances is None) == (self.quats is None or self.scales is None):
            raise ValueError("expected either quats and scales, or covariances")

    def __len__(self) -> int:
        return len(self.means)

    @staticmethod
    def of(gaussians: Gaussians) -> "Splats":
        """The splats of a scene's Gaussians."""
        g = gaussians
        return Splats(g.means, g.opacities, g.sh, g.quats, g.scales)

    def with_features(self, features: Float32[np.ndarray, "n f"]) -> "Splats":
        """The same splats with other channels to blend."""
        return replace(self, features=features)


@dataclass(frozen=True)
class Rendering:
    """Images of one view. Where nothing is drawn: the background, depth 0, index -1, alpha 0.

    `depth_expected` is the mean z over what a pixel blends, `depth_surface` the z of the Gaussian at which
    half of the light is gone (0 and -1 where that never happens); metres. `nonfinite` counts the Gaussians
    that were left out because a parameter was NaN, infinite or overflowed on the way to the image.
    """

    color: Float32[np.ndarray, "h w 3"]
    depth_expected: Float32[np.ndarray, "h w"]
    depth_surface: Float32[np.ndarray, "h w"]
    surface_index: Int32[np.ndarray, "h w"]
    alpha: Float32[np.ndarray, "h w"]
    features: Float32[np.ndarray, "h w f"] | None
    nonfinite: int


@dataclass(frozen=True)
class Gradients:
    """Derivatives of a loss by each array of `Splats`; None where that array is None."""

    means: Float32[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, "n"]
    sh: Float32[np.ndarray, "n k 3"]
    quats: Float32[np.ndarray, "n 4"] | None
    scales: Float32[np.ndarray, "n 3"] | None
    covariances: Float32[np.ndarray, "n 6"] | None
    features: Float32[np.ndarray, "n f"] | None
    image_motion: Float32[
        np.ndarray, "n"
    ]  # |d loss / d centre on the image|, per pixel: where to densify
