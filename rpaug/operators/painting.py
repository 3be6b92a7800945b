"""What edits that paint a thing share: what is painted on it later takes the place of what was painted before."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float32

from rpaug.core.types import Appearance, Scene, Surface


class Paint(ABC):
    """Base of appearances that make a thing's new look from its recorded pixels; frozen dataclasses.

    What a paint knows of a thing, its albedo and its hues, was recorded: over another paint it would go by what is not
    there any more.
    """

    instance_ids: frozenset[int]

    @abstractmethod
    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        """The thing's new colors, from recorded ones."""

    def over(self, before: Any) -> "Paint":
        """This paint on a thing that had another `before`: all of that is hidden."""
        return self


def painted(scene: Scene, laid: Sequence[Paint]) -> Scene:
    """The scene with paint on its things, each in the place of what was painted on it before; light edits that came
    after that stay after it."""
    appearance = scene.appearance
    for paint in laid:
        appearance = _with(appearance, paint)
    return replace(scene, appearance=appearance)


def _with(appearance: Sequence[Appearance], paint: Paint) -> tuple[Appearance, ...]:
    out: list[Appearance] = []
    place = None
    for one in appearance:
        if not isinstance(one, Paint) or paint.instance_ids.isdisjoint(one.instance_ids):
            out.append(one)
            continue
        place = len(out) if place is None else place
        paint = paint.over(one)
        if left := one.instance_ids - paint.instance_ids:
            out.append(replace(one, instance_ids=left))  # type: ignore[type-var]
    out.insert(len(out) if place is None else place, paint)
    return tuple(out)
