"""Which items of an epoch are augmented: by chance, by a fixed ratio, more or fewer as epochs go by."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpaug.core.errors import Unsupported
from rpaug.pipeline.recipe import Recipe

SALT = 0x5CED  # sets these draws apart from those of the recipe's steps


def epoch_number(given: int) -> int:
    """The epoch that was given. Raises Unsupported for what is no whole number from 0."""
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or given < 0:
        raise Unsupported(f"epoch {given!r}: expected a whole number from 0")
    return int(given)


@dataclass(frozen=True)
class Schedule:
    """How much of an epoch is augmented.

    `probability` is the chance of each episode, or, as a curriculum, its value at some epochs: linear between them,
    constant before and after. `ratio` (real, synthetic) fixes the share instead: of every epoch's episodes exactly that
    share is augmented, another part each time. Raises Unsupported for a chance outside 0..1 or a ratio without sum.
    """

    probability: float | Mapping[int, float] = 1.0
    ratio: tuple[float, float] | None = None
    _points: tuple[tuple[int, float], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        given = self.probability
        points = sorted(given.items()) if isinstance(given, Mapping) else [(0, float(given))]
        if not points or not all(0 <= chance <= 1 for _, chance in points):
            raise Unsupported(f"probability={given!r}: expected values from 0 to 1")
        if self.ratio is not None and not (min(self.ratio) >= 0 and sum(self.ratio) > 0):
            raise Unsupported(f"ratio={self.ratio!r}: expected (real, synthetic), one above 0")
        if self.ratio is not None and given != 1.0:
            raise Unsupported("probability and ratio: expected one of them")
        object.__setattr__(self, "_points", tuple(points))

    def chance(self, epoch: int) -> float:
        """The share of an epoch that is augmented."""
        if self.ratio is not None:
            return self.ratio[1] / sum(self.ratio)
        epochs, chances = zip(*self._points, strict=True)
        return float(np.interp(epoch, epochs, chances))

    def augmented(self, recipe: Recipe, keys: Sequence[str], epoch: int, index: int) -> bool:
        """Whether episode number `index` of `keys` is augmented in this epoch: the same in any process."""
        share = self.chance(epoch)
        if self.ratio is None:
            return recipe.generator(keys[index], epoch + 1, SALT).random() < share
        rng = recipe.generator("", epoch + 1, SALT)
        count, rest = divmod(share * len(keys), 1.0)
        order = rng.permutation(len(keys))
        return bool(np.argmax(order == index) < count + (rng.random() < rest - 1e-9))
