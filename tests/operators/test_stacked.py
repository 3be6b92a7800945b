"""Edits of many images at once: what each edit makes of its own rows, alone."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch
from devices import DEVICES

from rpaug.assets.textures import shipped
from rpaug.assets.textures.mapping import Texture
from rpaug.core import geometry
from rpaug.operators.light_color import Gain
from rpaug.operators.recolor import AlbedoRatio, LabShift
from rpaug.operators.texturing import Textured
from rpaug.render.batched.composite import stacks
from rpaug.scene.lighting.shading import Smooth

RED, WOOD, GREY = (0.8, 0.2, 0.1), (0.7, 0.55, 0.4), (0.5, 0.5, 0.5)
HUES = ((0.8, 0.2, 0.1), (0.1, 0.6, 0.3), (0.7, 0.7, 0.75))
ONE = frozenset({1})
SMOOTH = Smooth((0.1, 0.0, 0.2), 0.4, (0.6, 0.1, -0.05, 0.2, *[0.03] * 11), 0.06, 0.9)
OFF = 1e-4


@dataclass(frozen=True)
class Rows:
    """Where some rows lie, of arrays or of tensors."""

    ids: Any
    points: Any
    normals: Any
    facing: Any
    footprint: Any
    lit: Any
    mirrored: Any = None

    def __getitem__(self, rows: np.ndarray) -> "Rows":
        return Rows(*(None if part is None else part[rows] for part in vars(self).values()))

    def on(self, device: torch.device) -> "Rows":
        parts = vars(self).values()
        return Rows(
            *(None if part is None else torch.from_numpy(part).to(device) for part in parts)
        )


def rows(count: int = 4000, mirrored: bool = False) -> tuple[np.ndarray, Rows]:
    rng = np.random.default_rng(5)
    normals = rng.standard_normal((count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    shine = rng.uniform(0, 0.3, (count, 3)).astype(np.float32)
    shine[rng.random(count) < 0.3] = np.nan
    hues = np.array([*HUES, WOOD, GREY])[rng.integers(0, 5, count)]
    color = hues * rng.uniform(0, 1.1, (count, 1)) + rng.uniform(-0.02, 0.3, (count, 1)) * (
        rng.random((count, 1)) < 0.4
    )
    places = Rows(
        rng.integers(0, 4, count).astype(np.int32),
        rng.uniform(-1, 1, (count, 3)).astype(np.float32),
        normals,
        normals[::-1].copy(),
        np.exp(rng.uniform(-9, -2, count)).astype(np.float32),
        rng.uniform(0.2, 1, count).astype(np.float32),
        shine if mirrored else None,
    )
    return np.clip(color, 0, 1).astype(np.float32), places


def alike(several: Sequence[Any], device: torch.device, mirrored: bool = False) -> None:
    """That each row comes out as its own edit makes it, thresholds between two colors apart."""
    color, places = rows(mirrored=mirrored)
    which = np.random.default_rng(6).integers(0, len(several), len(color))
    edited = several[0].stacked(several, device)
    found = edited(
        torch.from_numpy(color).to(device), torch.from_numpy(which).to(device), places.on(device)
    )
    for number, edit in enumerate(several):
        mine = np.flatnonzero(which == number)
        off = np.abs(found.cpu().numpy()[mine] - edit(color[mine], places[mine])).max(1)
        assert (off > OFF).mean() <= 0.002
        assert np.isfinite(off).all()


@pytest.mark.parametrize("device", DEVICES)
def test_gains(device: torch.device) -> None:
    alike(
        [Gain((0.5, 0.7, 1.4)), Gain((1.2, 1.0, 0.1), (1, 3)), Gain((0.0, 1.0, 2.0), (2,))], device
    )


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_ratios(device: torch.device, mirrored: bool) -> None:
    blue = (0.1, 0.2, 0.9)
    edits = [
        AlbedoRatio(ONE, RED, blue, True),
        AlbedoRatio(ONE, RED, blue, True, metal=True),
        AlbedoRatio(ONE, GREY, blue, True),  # too grey to tell highlights
        AlbedoRatio(ONE, WOOD, (1.0, 1.0, 1.0), False),
        AlbedoRatio(ONE, WOOD, blue, False, HUES),
        AlbedoRatio(ONE, RED, blue, False, HUES, (0, 2)),
        AlbedoRatio(ONE, RED, (0.0, 0.0, 0.0), False, HUES[:2], (1,)),
    ]
    alike(edits, device, mirrored)
    alike(edits[:4], device, mirrored)
    oak = Textured(
        ONE, Texture.of(shipped.image("oak")), np.eye(4), 0.25, "box", WOOD, False, SMOOTH
    )
    part = AlbedoRatio(ONE, RED, (0.0, 0.9, 0.0), False, HUES, (1,), beneath=edits[1])
    beneath = [
        part,
        replace(part, part=(0,), beneath=oak),
        replace(part, part=(2,), beneath=part),
        edits[5],
    ]
    alike([*beneath, edits[0]], device, mirrored)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_textures(device: torch.device, mirrored: bool) -> None:
    oak, wide = (Texture.of(shipped.image(name)) for name in sorted(shipped.NAMES)[:2])
    mirror = Texture.of(shipped.image(sorted(shipped.NAMES)[2])[:100, :70], mirror=True)
    turned = geometry.rigid(np.array([0.2, 0.5, -0.4]), np.array([0.3, 0.0, 0.1]))
    edits = [
        Textured(ONE, oak, turned, 0.25, "triplanar", RED, True, None),
        Textured(ONE, wide, np.eye(4), 0.5, "box", WOOD, False, SMOOTH),
        Textured(ONE, mirror, turned, 0.1, "planar", WOOD, True, SMOOTH),
        Textured(ONE, mirror, turned, 0.3, "triplanar", GREY, False, None),
        Textured(ONE, oak, np.eye(4), 2.0, "planar", RED, True, None),
        Textured(ONE, oak, turned, 0.25, "box", RED, True, None, (0.9, 0.7, 0.5)),
    ]
    alike(edits, device, mirrored)
    alike([edits[0], edits[4]], device, mirrored)


def test_a_part_over_paint_that_cannot_be_stacked_is_not_stacked() -> None:
    part = AlbedoRatio(ONE, RED, GREY, False, HUES, (1,))
    assert stacks(replace(part, beneath=part))
    assert not stacks(replace(part, beneath=replace(part, beneath=LabShift(ONE, RED, GREY))))
