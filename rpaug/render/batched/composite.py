"""Appearance edits in many images at once, as `rpaug.render.composite` makes them in one.

Each image has edits of its own, made in their order. Those of one kind that are next in several images are made
together: an edit's class stacks them (`Appearance.stacked`).
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float32, Int32, Int64, UInt8
from torch import Tensor

from rpaug.core.types import Appearance
from rpaug.render.batched import matting
from rpaug.render.batched.pixels import Pixels

Surfaces = Callable[[Pixels], Any]
"""What pixels of the images show: a `rpaug.core.types.Surface` of tensors."""


def stacks(edit: Appearance) -> bool:
    """Whether an edit can be made in many images at once."""
    beneath = getattr(edit, "beneath", None)
    return hasattr(edit, "stacked") and (beneath is None or stacks(beneath))


def composite(
    rgb: UInt8[Tensor, "n h w 3"],
    ids: Int32[Tensor, "n h w"],
    edits: Sequence[Sequence[Appearance]],
    antialiased: Sequence[bool],
    surfaces: Surfaces,
) -> UInt8[Tensor, "n h w 3"]:
    """The images with the edits of each applied in order. Pixels no edit covers come back bit for bit.

    The others are within one level of what `rpaug.render.composite` gives, but where two ways of taking an outline
    apart explain a pixel as well.
    """
    color = rgb.float() / torch.tensor(
        255.0, device=rgb.device
    )  # a number is multiplied by its inverse
    touched = torch.zeros_like(ids, dtype=torch.bool)
    for step in range(max(map(len, edits), default=0)):
        due = [n for n, own in enumerate(edits) if step < len(own)]
        for kind, mixes in _ordered((type(edits[n][step]), antialiased[n]) for n in due):
            mine = [n for n in due if (type(edits[n][step]), antialiased[n]) == (kind, mixes)]
            _apply([edits[n][step] for n in mine], mine, mixes, color, touched, ids, surfaces)
    levels = (color.clamp(0, 1) * 255).round().to(torch.uint8)
    return torch.where(touched[..., None], levels, rgb)


def _ordered(kinds: Iterable[tuple[type, bool]]) -> list[tuple[type, bool]]:
    return list(dict.fromkeys(kinds))


def _apply(
    several: Sequence[Any],
    images: Sequence[int],
    antialiased: bool,
    color: Float32[Tensor, "n h w 3"],
    touched: Bool[Tensor, "n h w"],
    ids: Int32[Tensor, "n h w"],
    surfaces: Surfaces,
) -> None:
    """Make one edit in each of some images, in place: where it applies, and on outlines by their mixture."""
    which = torch.tensor(images, device=ids.device)
    edited = several[0].stacked(several, ids.device)
    whole_image = torch.tensor([_everywhere(edit) for edit in several], device=ids.device)
    inside = _among(ids[which], several) | whole_image[:, None, None]

    def of(at: Pixels) -> Pixels:
        return Pixels(which[at.image], at.row, at.column)

    whole = inside
    if antialiased:
        found = matting.outline(color[which], inside)
        share = found.share
        whole = inside.clone()
        whole[found.at.image, found.at.row, found.at.column] = share == 1
        mixed = (share > 0) & (share < 1)
        at, front, share = found.at[mixed], found.foreground[mixed], share[mixed, None]
        beside = of(matting.nearest(inside, at))
        change = edited(front, at.image, surfaces(beside)) - front
        at = of(at)
        # What is whole is edited by its own color, before mixtures are: no pixel is both.
        mixture = color[at.image, at.row, at.column] + share * change
    inner = Pixels.where(whole)
    shown = of(matting.nearest(inside, inner)) if antialiased else of(inner)
    here = of(inner)
    color[here.image, here.row, here.column] = edited(here.of(color), inner.image, surfaces(shown))
    touched[here.image, here.row, here.column] = True
    if antialiased:
        color[at.image, at.row, at.column] = mixture
        touched[at.image, at.row, at.column] = True


def _everywhere(edit: Appearance) -> bool:
    return edit.instance_ids is None and not getattr(edit, "unlit", ())


def _among(ids: Int32[Tensor, "m h w"], several: Sequence[Any]) -> Bool[Tensor, "m h w"]:
    """Which pixels of each image its edit applies to."""
    named = [sorted(edit.instance_ids or getattr(edit, "unlit", ())) for edit in several]
    out = torch.zeros_like(ids, dtype=torch.bool)
    most = max(map(len, named))
    never = int(torch.iinfo(ids.dtype).min)
    table: Int64[Tensor, "m k"] = torch.tensor(
        [one + [never] * (most - len(one)) for one in named], device=ids.device
    )
    for k in range(most):
        out |= ids == table[:, k, None, None]
    inverted = torch.tensor([edit.instance_ids is None for edit in several], device=ids.device)
    return out ^ inverted[:, None, None]
