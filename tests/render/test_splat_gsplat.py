"""The CUDA backend: what it says where it cannot run, and agreement with the CPU where it can."""

import builtins
import types

import numpy as np
import pytest
import torch
from splat_cases import NAMES, ON_GPU, assert_close, draw, gradients, relative, splats, view

from rpaug.core.errors import MissingExtra, Unsupported
from rpaug.render.splat import Settings, _gsplat


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
    package.rasterization, package.cuda, cuda._backend = None, cuda, backend
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


@pytest.mark.parametrize("backend", [ON_GPU])
@pytest.mark.parametrize("antialiased", [False, True])
def test_agrees_with_the_reference(backend, antialiased):
    given, at, settings = (
        splats(300, 1, harmonics=4),
        view(70, 50),
        Settings(antialiased=antialiased),
    )
    # gsplat bounds its splats at 3.33 standard deviations at most, so faint rims may differ.
    assert_close(
        draw(given, at, backend, settings),
        draw(given, at, "reference", settings),
        atol=5e-3,
        flips=0.01,
    )
    found, expected = (gradients(given, at, name, settings) for name in (backend, "reference"))
    for name in NAMES:
        if expected[name] is not None:
            assert np.isfinite(found[name]).all()
            assert relative(found[name], expected[name]) < 2e-2, name
