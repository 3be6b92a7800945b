"""Pixels of a stack of images, by image, row and column."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import torch
from jaxtyping import Bool, Int64, Shaped
from torch import Tensor


@dataclass(frozen=True)
class Pixels:
    """Places in a stack of images, in an array of any shape."""

    image: Int64[Tensor, "*n"]
    row: Int64[Tensor, "*n"]
    column: Int64[Tensor, "*n"]

    @classmethod
    def where(cls, mask: Bool[Tensor, "m h w"]) -> "Pixels":
        """The pixels of a mask, image by image and row by row."""
        return cls(*torch.nonzero(mask, as_tuple=True))

    def of(self, images: Shaped[Tensor, "m h w *rest"]) -> Shaped[Tensor, "..."]:
        """What images show there."""
        return images[self.image, self.row, self.column]

    def __len__(self) -> int:
        return len(self.image)

    def __getitem__(self, key: Any) -> "Pixels":
        return Pixels(self.image[key], self.row[key], self.column[key])

    def pick(self, place: Int64[Tensor, "n k"]) -> "Pixels":
        """Of each row of places, those with the given numbers."""
        return Pixels(
            self.image.gather(1, place), self.row.gather(1, place), self.column.gather(1, place)
        )


@cache
def offsets(reach: int, device: torch.device) -> Int64[Tensor, "k 2"]:
    """Steps in rows and columns to the pixels of a square around one, the nearest first, then by row and column."""
    steps = range(-reach, reach + 1)
    every = [(j, i) for j in steps for i in steps if (j, i) != (0, 0)]
    return torch.tensor(sorted(every, key=lambda off: off[0] ** 2 + off[1] ** 2), device=device)


def neighbours(
    at: Pixels, steps: Int64[Tensor, "k 2"], size: Sequence[int]
) -> tuple[Pixels, Bool[Tensor, "n k"]]:
    """The pixels so many steps away, held inside the image, and which of them lie inside."""
    row, column = at.row[:, None] + steps[:, 0], at.column[:, None] + steps[:, 1]
    known = (row >= 0) & (row < size[0]) & (column >= 0) & (column < size[1])
    image = at.image[:, None].expand_as(row)
    return Pixels(image, row.clamp(0, size[0] - 1), column.clamp(0, size[1] - 1)), known
