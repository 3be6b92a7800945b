"""Give a thing another color and leave its shading, texture, highlights and outline as they were."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float32

from rpaug.core import color_space, white
from rpaug.core.errors import there_are
from rpaug.core.interfaces import Edit, Examples, Needs, Operator, Painted
from rpaug.core.jit import kernel
from rpaug.core.types import Effect, Scene, Stacked, Surface
from rpaug.operators.fields import RGB, Color
from rpaug.operators.painting import Paint, painted
from rpaug.scene.lighting import albedo, gamut, intrinsic, shading
from rpaug.scene.targets import agreement, targets


@dataclass(frozen=True)
class AlbedoRatio(Paint):
    """Pixel = albedo x shading (+ highlight): swap the albedo, keep the rest.

    Shading is the least-squares scale of the old albedo, led by its bright channels (so pure red can turn pure blue).
    What a pixel has beside that, texture's hues and noise, is scaled with its channel, but never up: where the old
    albedo returns little light it is noise and mirrored light rather than texture. Highlights stay where the surface is
    known to mirror; else, on a plain surface or one of a few `hues`, what of a pixel is white rather than albedo
    (dichromatic model, Shafer 1985). A `metal` mirrors in its own color, so that all of a pixel changes. Of a `part`
    only the pixels of these hues are painted; the others are as the paint `beneath` makes them, or as recorded.
    """

    instance_ids: frozenset[int]
    old: tuple[float, float, float]
    new: tuple[float, float, float]
    plain: bool
    hues: tuple[tuple[float, float, float], ...] = ()
    part: tuple[int, ...] = ()  # of the hues: pixels of others stay
    metal: bool = False
    beneath: Paint | None = None

    @property
    def scales(self) -> bool:
        """Whether light beyond white is painted too."""
        return self.beneath is None or getattr(self.beneath, "scales", False)

    @property
    def asked(self) -> tuple[float, float, float]:
        """The color it was asked for, by which gates judge it."""
        return self.new

    def over(self, before: Paint) -> Paint:
        """A part leaves the rest in the paint that the thing had before."""
        if not self.part:
            return self
        return replace(self, beneath=replace(before, instance_ids=self.instance_ids))  # type: ignore[type-var]

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        old, new = np.array(self.old, np.float32), np.array(self.new, np.float32)
        highlight = np.zeros((len(color), 1), np.float32)
        if not self.metal:
            highlight = albedo.shine(color, surface, old, self.plain, self.hues)
        lit = _lit(color, highlight, old, new)
        if not self.part:
            return lit
        mine = np.isin(albedo.owners(color, self.hues), self.part)
        rest = color if self.beneath is None else self.beneath(color, surface)
        return np.where(mine[:, None], lit, rest)

    @staticmethod
    def stacked(several: Sequence["AlbedoRatio"], device: Any) -> Stacked:
        """Edits of many images at once."""
        from rpaug.operators import stacked  # only here: it brings torch

        return stacked.ratios(several, device)


@kernel
def _lit(
    color: Float32[np.ndarray, "n 3"],
    highlight: Float32[np.ndarray, "n k"],
    old: Float32[np.ndarray, "3"],
    new: Float32[np.ndarray, "3"],
) -> Float32[np.ndarray, "n 3"]:
    """Colors with another albedo under their highlights, of one part for all channels or one for each."""
    out = np.empty(color.shape, np.float32)
    own = old / max(old[0] * old[0] + old[1] * old[1] + old[2] * old[2], np.float32(1e-6))
    gain = np.minimum(new / np.maximum(old, np.float32(1e-6)), np.float32(1))
    matte, shine = np.empty(3, np.float32), np.empty(3, np.float32)
    for n in range(len(color)):
        shading = np.float32(0)
        for k in range(3):
            shine[k] = highlight[n, min(k, highlight.shape[1] - 1)]
            matte[k] = color[n, k] - shine[k]
            shading += matte[k] * own[k]
        for k in range(3):
            lit = shading * new[k] + gain[k] * (matte[k] - shading * old[k]) + shine[k]
            out[n, k] = min(max(lit, np.float32(0)), np.float32(1))
    return out


@dataclass(frozen=True)
class LabShift(Paint):
    """RoboPearls' way: chroma becomes the new color's, lightness is scaled by new over old (CIELAB)."""

    instance_ids: frozenset[int]
    old: tuple[float, float, float]
    new: tuple[float, float, float]

    @property
    def asked(self) -> tuple[float, float, float]:
        """The color it was asked for, by which gates judge it."""
        return self.new

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        old, new = color_space.to_lab(np.array(self.old)), color_space.to_lab(np.array(self.new))
        lab = color_space.to_lab(color)
        lab[:, 0] = np.clip(lab[:, 0] * new[0] / max(old[0], 1.0), 0, 100)
        lab[:, 1:] = new[1:]
        return np.clip(color_space.from_lab(lab), 0, 1).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Recolor(Operator):
    """Paint `target` in `color`. Depth, masks and every other pixel stay as recorded.

    `albedo` is the old color where it is known (a simulation's material); else it is estimated from the pixels of
    each instance. Of several colors none is drawn like that of another thing that the same copy repaints, while there
    are others. `mode: lab` is the paper's shift in CIELAB, kept for comparison. `only`, a color word, paints what is
    of that color on a thing of several: the red handle of a hammer.
    """

    target: targets.Target
    color: Color
    albedo: RGB | None = None
    mode: Literal["albedo", "lab"] = "albedo"
    only: str | None = None

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(targets=("target",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "paint": "paint, repaint, recolor, recolour, color, colors, colour, dye, tint, coat, "
        "spray, spray-paint, tinted, painted, dyed, recolored, shade, stain, hue, hues, "
        "paint job, colored",
        "gloss": "matte, matt",
    }
    phrases: ClassVar[tuple[str, ...]] = ("paint {target} {color}", "recolor {target} in {color}")
    examples: ClassVar[Examples] = (
        ("paint the cup navy", {"target": "cup", "color": "navy"}),
        ("the hammer's red handle green", {"target": "hammer", "color": "green", "only": "red"}),
        (
            "some other color for what is grasped",
            {"target": {"role": "manipulated"}, "color": {"sample": "colosseum"}},
        ),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("color", "colour", "colors", "colours", "paint")
    settles: ClassVar[str] = "look"

    def __post_init__(self) -> None:
        if self.only is not None and color_space.canonical(self.only) is None:
            raise ValueError(
                f"only: no such color word: {self.only!r}; {there_are(self.only, color_space.NAMES)}"
            )
        if self.only is not None and (self.mode == "lab" or self.albedo is not None):
            raise ValueError(
                "only: parts are told by their recorded colors, without mode lab or albedo"
            )

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        instance_ids = sorted(targets.find(scene, self.target))
        taken = [
            one.asked
            for one in scene.appearance
            if isinstance(one, AlbedoRatio | LabShift) and one.instance_ids.isdisjoint(instance_ids)
        ]
        if self.only is not None:
            word = color_space.canonical(self.only) or self.only
            found = shading.paintable(
                instance_ids, lambda one: albedo.part(intrinsic.unshadowed(scene), one, word)
            )
            return {"color": self._drawn(scene, rng, taken), **found}
        described = shading.describe(scene, instance_ids, self.albedo)
        return {"color": self._drawn(scene, rng, taken), **described}

    def _drawn(
        self, scene: Scene, rng: np.random.Generator, taken: Sequence[white.Triple]
    ) -> list[float]:
        """The new color; in photographs what paint of it shows there."""
        red, green, blue = self.color.draw(rng, taken)
        if self.color.exact or not agreement.told(scene):
            return [red, green, blue]
        return list(gamut.painted(scene.episode, (red, green, blue)))

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        red, green, blue = edit["color"]
        laid: list[Paint] = []
        for surface in edit["surfaces"]:
            instance_ids, old = frozenset([surface["handle"]]), tuple(surface["albedo"])
            if self.mode == "lab":
                laid.append(LabShift(instance_ids, old, (red, green, blue)))
            else:
                laid.append(ratio(surface, (red, green, blue)))
        return painted(scene, laid)

    def says(self, edit: Edit) -> tuple[Painted, ...]:
        return named(edit)

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        return albedo.guessed(edit["surfaces"])


def ratio(surface: Edit, new: tuple[float, float, float]) -> AlbedoRatio:
    """The repainting of one surface, as an edit stores it, in a new color."""
    hues = tuple(tuple(hue) for hue in surface.get("hues", ()))
    old = tuple(surface["albedo"])
    part = tuple(surface.get("part", ()))
    metal, own = surface.get("metal", False), frozenset([surface["handle"]])
    return AlbedoRatio(own, old, new, surface["plain"], hues, part, metal)


def named(edit: Edit) -> tuple[Painted, ...]:
    """The color word of an edit that paints surfaces in one color."""
    # A part that is not most of a thing leaves it its color word.
    mostly = frozenset(s["handle"] for s in edit["surfaces"] if 0 in s.get("part", [0]))
    return (Painted(mostly, color_space.nearest(np.array(edit["color"])), anew=True),)
