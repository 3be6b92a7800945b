"""The CUDA backend: the reference's projection on the GPU, and the `gsplat` package's kernels for the pixels.

Gaussians are projected in float64 and rounded once, so that thin and far ones keep their shape: gsplat's own
projection loses both to float32. What its pixels have built in (1.5.3: alpha at most 0.999, floor 1/255, stop at
1e-4) cannot be set. Its pixel centres lie at +0.5; ours at integers.
"""

from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.render.splat import _reference
from rpaug.render.splat._images import SMALLEST_ALPHA
from rpaug.render.splat._reference import Images, Projected
from rpaug.render.splat.settings import Rendering, Settings, Splats, View

BUILT_IN = ("alpha_max", "alpha_floor", "transmittance_stop")
DEVICE = "cuda"
TILE = 16  # pixels
FARTHEST = 1e9  # pixels that a Gaussian reaches, in int32


class Kernels(NamedTuple):
    """gsplat's functions: which Gaussians lie on which tile, front to back; where each tile's begin; the pixels."""

    tiles: Any
    offsets: Any
    pixels: Any


def kernels() -> Kernels:
    """gsplat's functions. Raises MissingExtra or Unsupported, naming what is missing."""
    try:
        import gsplat
    except ImportError:
        raise MissingExtra("gsplat", "cuda") from None
    if not torch.cuda.is_available():
        raise Unsupported(
            "backend gsplat: torch sees no CUDA GPU; backend numba renders on the CPU"
        )
    from gsplat.cuda import _backend

    if getattr(_backend, "_C", None) is None:
        raise Unsupported(
            "backend gsplat: its kernels are not built; put nvcc (the CUDA toolkit) on the PATH or "
            "install a gsplat wheel built for this torch and CUDA"
        )
    return Kernels(gsplat.isect_tiles, gsplat.isect_offset_encode, gsplat.rasterize_to_pixels)


def _check(settings: Settings) -> None:
    changed = [name for name in BUILT_IN if getattr(settings, name) != getattr(Settings(), name)]
    if changed:
        raise Unsupported(f"backend gsplat: {', '.join(changed)} cannot differ from the defaults")


def conics(seen: Projected, settings: Settings) -> tuple[Float[Tensor, "m 3"], Int[Tensor, "m 2"]]:
    """What gsplat takes for a shape: the inverse covariances (xx, xy, yy), and how far alpha reaches its floor."""
    wide, across, high = (2**0.5 * seen.factor).unbind(1)
    shape = torch.stack([wide**2, wide * across, across**2 + high**2], -1)
    with torch.no_grad():
        variance = torch.stack([shape[:, 2] / (wide * high) ** 2, high**-2], -1)
        reach = (2 * (seen.opacity / settings.alpha_floor).log()).clamp(min=0).sqrt()
        pixels = (reach[:, None] * variance.sqrt()).clamp(max=FARTHEST).floor() + 1
    return shape, pixels.int()


def composite(
    run: Kernels, seen: Projected, values: Float[Tensor, "m c"], view: View, settings: Settings
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"]]:
    """Blended values and alpha."""
    if not len(values):
        # No kernel starts on nothing; gradients are zeros all the same.
        nothing = values.sum() + seen.opacity.sum() + seen.centre.sum() + seen.factor.sum()
        blank = nothing.float().expand(view.height, view.width)
        return blank[..., None].expand(-1, -1, values.shape[1]), blank
    shape, radii = conics(seen, settings)
    centre = (seen.centre + 0.5).float()[None]
    across, down = -(-view.width // TILE), -(-view.height // TILE)
    with torch.no_grad():
        _, ids, order = run.tiles(
            centre, radii[None], seen.depth.float()[None], TILE, across, down, n_images=1
        )
        begins = run.offsets(ids, 1, across, down)
    blended, alpha = run.pixels(
        centre, shape.float()[None], values.float()[None], seen.opacity.float()[None],
        view.width, view.height, TILE, begins, order,
    )  # fmt: skip
    return blended[0], alpha[0, ..., 0]


def rasterise(
    means: Float[Tensor, "n 3"],
    opacities: Float[Tensor, "n"],
    sh: Float[Tensor, "n k 3"],
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    covariances: Float[Tensor, "n 6"] | None,
    features: Float[Tensor, "n f"] | None,
    view: View,
    settings: Settings,
    background: Float[np.ndarray, "3"],
) -> tuple[Images, Projected]:
    """The images of `rpaug.render.splat.rasterise`, on the GPU, and what was drawn; tensors stay on their device.

    Non-finite Gaussians are left out, as on the CPU. Raises MissingExtra or Unsupported.
    """
    run = kernels()
    _check(settings)
    given = (means, opacities, sh, quats, scales, covariances, features)
    m, o, s, q, size, c, f = (None if tensor is None else tensor.double() for tensor in given)
    assert m is not None
    assert o is not None
    assert s is not None
    seen = _reference.project(m, o, s, q, size, c, f, view, settings)
    extra = [] if f is None else [f[seen.rows]]
    values = torch.cat([seen.color, seen.depth[:, None], *extra], 1)
    blended, alpha = composite(run, seen, values, view, settings)
    fill = torch.as_tensor(background, dtype=torch.float32, device=alpha.device)
    color = blended[..., :3] + (1 - alpha[..., None]) * fill
    depth = blended[..., 3] / alpha.clamp(min=SMALLEST_ALPHA)
    more = None if features is None else blended[..., 4:]
    return Images(color, depth, alpha, more), seen


def render(splats: Splats, view: View, settings: Settings, background: np.ndarray) -> Rendering:
    """`rasterise` for arrays. gsplat tells no surface: its depth is 0 and its index -1 everywhere."""
    kernels()
    tensors: dict[str, Any] = {
        name: None if array is None else torch.tensor(array, device=DEVICE)
        for name, array in vars(splats).items()
    }
    with torch.no_grad():
        made, seen = rasterise(**tensors, view=view, settings=settings, background=background)
    color, depth, alpha, features = (
        None if image is None else image.cpu().numpy() for image in made
    )
    assert color is not None
    assert depth is not None
    assert alpha is not None
    return Rendering(
        color=color,
        depth_expected=depth,
        depth_surface=np.zeros_like(depth),
        surface_index=np.full(depth.shape, -1, np.int32),
        alpha=alpha,
        features=features,
        nonfinite=seen.nonfinite,
    )
