"""The CUDA backend: what it says where it cannot run, and agreement with the CPU where it can."""

import builtins
import dataclasses
import types

import numpy as np
import pytest
import torch
from gsplat_kernels import EMULATED, ON_GPU
from splat_cases import (
    NAMES,
    assert_within,
    draw,
    gradients,
    on_a_threshold,
    pulls,
    relative,
    splats,
    view,
)

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.render.splat import Settings, _gsplat, _reference


def test_a_missing_package_names_the_extra(monkeypatch):
    find = builtins.__import__

    def without(name, *rest, **more):
        if name.split(".")[0] == "gsplat":
            raise ImportError(name)
        return find(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match=r"rpaug\[cuda\]"):
        draw(splats(3), view(), "gsplat")


def proxy(monkeypatch, gpu: bool, built: bool) -> None:
    """A gsplat that is installed, on a machine with or without a GPU, with or without built kernels."""
    package, cuda = types.ModuleType("gsplat"), types.ModuleType("gsplat.cuda")
    backend = types.ModuleType("gsplat.cuda._backend")
    package.cuda, cuda._backend = cuda, backend
    backend._C = object() if built else None
    for module in (package, cuda, backend):
        monkeypatch.setitem(__import__("sys").modules, module.__name__, module)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: gpu)


def test_a_missing_gpu_is_said_in_words(monkeypatch):
    proxy(monkeypatch, gpu=False, built=True)
    with pytest.raises(Unsupported, match="no CUDA GPU"):
        draw(splats(3), view(), "gsplat")


def test_missing_kernels_name_nvcc(monkeypatch):
    proxy(monkeypatch, gpu=True, built=False)
    with pytest.raises(Unsupported, match="nvcc"):
        draw(splats(3), view(), "gsplat")


def test_constants_that_gsplat_has_built_in_are_refused():
    with pytest.raises(Unsupported, match="alpha_max"):
        _gsplat._check(Settings(alpha_max=0.99))
    _gsplat._check(Settings(dilation=0.1, near=0.1, antialiased=True))


def test_an_unknown_backend_is_refused():
    with pytest.raises(ValueError, match="expected auto"):
        draw(splats(3), view(), "opengl")


@pytest.mark.parametrize("backend", [EMULATED, ON_GPU])
@pytest.mark.parametrize("antialiased", [False, True])
def test_agrees_with_the_reference(backend, antialiased):
    given, at = splats(300, 1, harmonics=4, features=3), view(70, 50)
    settings = Settings(antialiased=antialiased, dilation=0.1)
    apart = on_a_threshold(given, at, settings)
    assert apart.mean() < 0.02
    assert_within(draw(given, at, backend, settings), draw(given, at, "reference", settings), apart)
    images = {
        name: np.where(apart.reshape(apart.shape + (1,) * (pull.ndim - 2)), 0, pull)
        for name, pull in pulls(at, features=3).items()
    }
    # Expected depth is D / A: at faint rims float32 knows A to a few digits only.
    images["depth"] = np.where(
        draw(given, at, "reference", settings).alpha > 0.1, images["depth"], 0
    )
    found, expected = (
        gradients(given, at, name, settings, images) for name in (backend, "reference")
    )
    for name in NAMES:
        if expected[name] is not None:
            assert np.isfinite(found[name]).all()
            assert relative(found[name], expected[name]) < 1e-3, name


@pytest.mark.parametrize("backend", [EMULATED, ON_GPU])
def test_covariances_are_shapes_too(backend):
    given, at = splats(60, 4), view()
    axes = _reference.rotations(torch.as_tensor(given.quats)).numpy() * given.scales[:, None]
    full = axes @ axes.transpose(0, 2, 1)
    upper = full[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].astype(np.float32)
    bent = dataclasses.replace(given, quats=None, scales=None, covariances=upper)
    expected = draw(bent, at, "reference")
    assert_within(draw(bent, at, backend), expected, on_a_threshold(bent, at))
