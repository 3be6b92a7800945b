"""The CUDA backend: the `gsplat` package behind the same door.

gsplat's own constants are built in (1.5.3: alpha at most 0.999, floor 1/255, stop at 1e-4, Jacobian followed
to 0.3 half-images), so other settings are refused. Its pixel centres lie at +0.5; ours at integers.
"""

import dataclasses
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.render.splat import _reference
from rpaug.render.splat._reference import Images
from rpaug.render.splat.settings import LARGEST, Rendering, Settings, Splats, View

BUILT_IN = ("alpha_max", "alpha_floor", "transmittance_stop", "frustum_margin")


def rasterization() -> Any:
    """gsplat's entry point. Raises MissingExtra or Unsupported, naming what is missing."""
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
    return gsplat.rasterization


def _check(settings: Settings) -> None:
    changed = [name for name in BUILT_IN if getattr(settings, name) != getattr(Settings(), name)]
    if changed:
        raise Unsupported(f"backend gsplat: {', '.join(changed)} cannot differ from the defaults")


def _usable(scales: Tensor | None, *others: Tensor | None) -> Bool[Tensor, "n"]:
    """Rows of finite numbers whose squares are finite too."""
    finite = _reference.finite_rows(scales, *others)
    return finite if scales is None else finite & (scales**2 < LARGEST).all(1)


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
) -> Images:
    """The images of `rpaug.render.splat.rasterise`, on the GPU; tensors stay on their device.

    Non-finite Gaussians are left out, as on the CPU. Raises MissingExtra or Unsupported.
    """
    run = rasterization()
    _check(settings)
    rows = torch.nonzero(_usable(scales, means, opacities, sh, quats, covariances, features))[:, 0]
    kind: dict[str, Any] = {"dtype": torch.float32, "device": means.device}
    pose = torch.as_tensor(view.world_to_camera, dtype=means.dtype, device=means.device)
    # Relative to the camera in the precision given, then float32.
    offset = means[rows] + pose[:3, :3].T @ pose[:3, 3]
    turn = torch.eye(4, **kind)
    turn[:3, :3] = pose[:3, :3]
    direction = offset / offset.norm(dim=1, keepdim=True).clamp(min=1e-12)
    basis = _reference.harmonics(direction, sh.shape[1])
    color = (0.5 + (basis[:, :, None] * sh[rows]).sum(1)).clamp(min=0.0)
    values = color if features is None else torch.cat([color, features[rows]], 1)
    K = torch.as_tensor(view.K, **kind).clone()
    K[:2, 2] += 0.5
    shape: dict[str, Tensor | None] = {"quats": None, "scales": None}
    if covariances is not None:
        shape["covars"] = _reference.covariance_matrices(None, None, covariances[rows]).float()
    else:
        assert quats is not None
        assert scales is not None
        turn_of = quats[rows].float()
        plain = torch.tensor([1.0, 0, 0, 0], **kind)  # a quaternion of zeros turns nothing
        turn_of = torch.where((turn_of == 0).all(1, keepdim=True), plain, turn_of)
        shape = {"quats": turn_of, "scales": scales[rows].float()}
    drawn, alphas, _ = run(
        means=offset.float(),
        opacities=opacities[rows].float().clamp(max=1.0),
        colors=values.float(),
        viewmats=turn[None],
        Ks=K[None],
        width=view.width,
        height=view.height,
        near_plane=settings.near,
        eps2d=settings.dilation,
        rasterize_mode="antialiased" if settings.antialiased else "classic",
        render_mode="RGB+ED",
        packed=False,
        **shape,
    )
    alpha = alphas[0, ..., 0]
    fill = torch.as_tensor(background, **kind)
    more = None if features is None else drawn[0, ..., 3:-1]
    return Images(drawn[0, ..., :3] + (1 - alpha[..., None]) * fill, drawn[0, ..., -1], alpha, more)


def render(splats: Splats, view: View, settings: Settings, background: np.ndarray) -> Rendering:
    """`rasterise` for arrays. gsplat tells no surface: its depth is 0 and its index -1 everywhere."""
    rasterization()
    names = [field.name for field in dataclasses.fields(Splats)]
    arrays = {name: getattr(splats, name) for name in names}
    tensors: dict[str, Any] = {
        name: None if array is None else torch.as_tensor(np.ascontiguousarray(array), device="cuda")
        for name, array in arrays.items()
    }
    with torch.no_grad():
        made = rasterise(**tensors, view=view, settings=settings, background=background)
    color, depth, alpha, features = (
        np.zeros(0, np.float32) if image is None else image.cpu().numpy() for image in made
    )
    usable = _usable(tensors.pop("scales"), *tensors.values())
    return Rendering(
        color=color,
        depth_expected=depth,
        depth_surface=np.zeros_like(depth),
        surface_index=np.full(depth.shape, -1, np.int32),
        alpha=alpha,
        features=None if splats.features is None else features,
        nonfinite=int((~usable).sum()),
    )
