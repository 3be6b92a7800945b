"""What the texture operators share: drawing a texture, finding its frame, and laying it under the recorded light."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import BaseModel, ConfigDict, Field

from rpaug.assets.textures import folder, shipped
from rpaug.assets.textures.mapping import Mapping, Texture
from rpaug.core import color_space, geometry, white
from rpaug.core.errors import BadInput, TargetError, there_are
from rpaug.core.interfaces import Edit, Needs, Operator, Painted
from rpaug.core.jit import kernel
from rpaug.core.types import Effect, Scene, Stacked, Surface
from rpaug.operators.fields import RGB
from rpaug.operators.painting import Paint, painted
from rpaug.scene.lighting import albedo, intrinsic, rig, shading
from rpaug.scene.recorded import surface as surfaces
from rpaug.scene.targets import agreement, targets

Triple = tuple[float, float, float]
COARSE = 32  # texels a side at which a texture's colors are counted
WHITE = 1.0, 1.0, 1.0
MOSTLY = 0.9  # of them in one color, and people call it by that


class Sample(BaseModel):
    """Draw a texture: of one kind, or any."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    sample: Literal["all", "wood", "stone", "fabric", "checker", "noise", "metal"]


ANY = Sample(sample="all")


def check(texture: str | Sample, textures: Path | None) -> None:
    """That a texture's name or kind can be drawn from. Raises ValueError."""
    if textures is None and isinstance(texture, str):
        paint = texture in color_space.NAMES or color_space.from_hex(texture) is not None
        if texture not in shipped.NAMES and not paint:
            raise ValueError(
                f"no texture is called {texture!r}; {there_are(texture, shipped.NAMES)}; "
                "or a color word"
            )
    elif textures is not None and texture != ANY and isinstance(texture, Sample):
        raise ValueError("kinds are of the shipped textures; from a folder sample all, or name one")


def draw(texture: str | Sample, textures: Path | None, rng: np.random.Generator) -> str:
    """A texture's name: the one given, or one of those meant, each as likely. Raises BadInput for an empty folder."""
    if isinstance(texture, str):
        return texture
    if textures is not None:
        known = folder.names(textures)
    elif texture.sample == "all":
        known = list(shipped.NAMES)
    else:
        known = list(shipped.KINDS[texture.sample])
    return known[int(rng.integers(len(known)))]


def same(textures: Path, name: str, digest: str) -> None:
    """That a folder still holds the image an edit was drawn with. Raises BadInput."""
    if folder.digest(textures, name) != digest:
        raise BadInput(
            textures / name,
            "texture",
            found="another image",
            expected="the one this edit was drawn with",
        )


@dataclass(frozen=True)
class Textured(Paint):
    """Pixel = albedo x shading (+ highlight): the albedo comes from the texture at the pixel's place on its body.

    Shading is what the old albedo leaves of the pixel; where the old surface was patterned, `smooth` tells the pattern
    from the light, and shadows that wander over it stay. `to_texture` carries points from the body's frame into the
    texture's; `white` is what an albedo of 1 shows where it is fully lit.
    """

    instance_ids: frozenset[int]
    texture: Texture
    to_texture: Float64[np.ndarray, "4 4"]
    scale: float
    mapping: Mapping
    old: Triple
    plain: bool
    smooth: shading.Smooth | None
    white: Triple = WHITE

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        place = surfaces.of_places(surface, self, self._of_places)
        new, fitted = place[:, :3], place[:, 3]
        old = np.array(self.old, np.float32)
        highlight = albedo.shine(color, surface, old, self.plain and self.smooth is None)
        shade = (color - highlight) @ old / max(float(old @ old), 1e-4)
        if self.smooth is not None:
            lit = surface.lit
            shade = self.smooth.of(shade / np.maximum(lit, 0.02), fitted) * lit
        return _laid(new, shade, np.broadcast_to(highlight, color.shape))

    @staticmethod
    def stacked(several: Sequence["Textured"], device: Any) -> Stacked:
        """Edits of many images at once."""
        from rpaug.operators import stacked  # only here: it brings torch

        return stacked.textures(several, device)

    def _of_places(self, surface: Surface) -> Float32[np.ndarray, "n 4"]:
        """The new albedo, and what the old shading comes to by its fit, which hang on the place alone."""
        turn, shift = self.to_texture[:3, :3], self.to_texture[:3, 3]
        points, normals = _carried(
            surface.points.astype(np.float32), surface.normals.astype(np.float32),
            turn.astype(np.float32), shift.astype(np.float32),
        )  # fmt: skip
        out = np.ones((len(points), 4), np.float32)
        image = self.texture.on(points, normals, surface.footprint, self.scale, self.mapping)
        out[:, :3] = image * np.array(self.white, np.float32)
        if self.smooth is not None:
            out[:, 3] = self.smooth.fitted(surface.points, surface.facing)
        return out


@kernel
def _laid(
    new: Float32[np.ndarray, "n 3"],
    shade: Float32[np.ndarray, "n"],
    highlight: Float32[np.ndarray, "n 3"],
) -> Float32[np.ndarray, "n 3"]:
    """The new albedo in its shade, and its highlight."""
    out = np.empty_like(new)
    for n in range(len(new)):
        for k in range(3):
            lit = new[n, k] * shade[n] + highlight[n, k]
            out[n, k] = min(max(lit, np.float32(0)), np.float32(1))
    return out


@kernel
def _carried(
    points: Float32[np.ndarray, "n 3"],
    normals: Float32[np.ndarray, "n 3"],
    turn: Float32[np.ndarray, "3 3"],
    shift: Float32[np.ndarray, "3"],
) -> tuple[Float32[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]:
    """Points and normals in another frame: of each the same, whichever others there are, unlike BLAS's products."""
    moved, turned = np.empty_like(points), np.empty_like(normals)
    for n in range(len(points)):
        for i in range(3):
            p = q = np.float32(0)
            for j in range(3):
                p += turn[i, j] * points[n, j]
                q += turn[i, j] * normals[n, j]
            moved[n, i], turned[n, i] = p + shift[i], q
    return moved, turned


@dataclass(frozen=True, kw_only=True)
class Texturing(Operator):
    """Base of the operators that lay an image on things; they differ in what they are laid on.

    `texture` names an image of the shipped set, or of the folder `textures` if one is given, or draws one; a color word
    is plain paint that hides the old pattern. `scale` is the metres it is wide. Its frame stands in the target's
    middle, turned about the vertical to its side faces; `origin` (metres) and `turn` (a rotation vector, radians) set
    it in the body's own frame instead.
    """

    target: targets.Target
    texture: str | Sample = ANY
    textures: Path | None = None
    scale: Annotated[float, Field(gt=0)] = 0.25
    mapping: Mapping = "triplanar"
    repeat: Literal["wrap", "mirror"] | None = None
    origin: Triple | None = None
    turn: Triple | None = None
    albedo: RGB | None = None

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(targets=("target",))
    undone_as: ClassVar[tuple[str, ...]] = ("texture", "textures")
    settles: ClassVar[str] = "look"

    def __post_init__(self) -> None:
        check(self.texture, self.textures)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        instance_ids = sorted(targets.find(scene, self.target))
        seen = shading.sample(intrinsic.unshadowed(scene), scene.bodies, tuple(instance_ids))
        if not seen:
            raise TargetError(f"{self.target}: no camera shows it at a known depth")
        described = shading.paintable(seen, lambda one: self._surface(scene, one, seen[one]))
        shown = {one["handle"]: seen[one["handle"]] for one in described["surfaces"]}
        name = draw(self.texture, self.textures, rng)
        return {
            "texture": name,
            "digest": folder.digest(self.textures, name) if self.textures else None,
            "to_texture": self._frame(shown).tolist(),
            **self._white(scene),
            **described,
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        texture = self._texture(edit)
        laid: list[Paint] = []
        for one in edit["surfaces"]:
            smooth = shading.Smooth(**one["smooth"]) if one["smooth"] else None
            laid.append(
                Textured(
                    instance_ids=frozenset([one["handle"]]),
                    texture=texture,
                    to_texture=np.array(edit["to_texture"]),
                    scale=self.scale,
                    mapping=self.mapping,
                    old=tuple(one["albedo"]),
                    plain=one["plain"],
                    smooth=smooth,
                    white=tuple(edit.get("white", WHITE)),
                )
            )
        return painted(scene, laid)

    def says(self, edit: Edit) -> tuple[Painted, ...]:
        word = _prevailing(*self._named(edit))
        if word is None and not edit["digest"]:  # an own image has no word
            word = shipped.pattern(edit["texture"])
        return (Painted(frozenset(one["handle"] for one in edit["surfaces"]), word, anew=True),)

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        return albedo.guessed(edit["surfaces"])

    def _white(self, scene: Scene) -> dict[str, Any]:
        """What white shows in a photograph's light and exposure; elsewhere an image is shown as it is."""
        if not agreement.told(scene):
            return {}
        return {"white": [round(float(one), 4) for one in white.full(scene.episode)]}

    def _frame(self, seen: dict[int, shading.ShadedPixels]) -> Float64[np.ndarray, "4 4"]:
        back = shading.frame(seen)
        if self.origin is None and self.turn is None:
            return back
        pose = geometry.inverse(back)
        if self.turn is not None:
            pose[:3, :3] = geometry.rotation(np.array(self.turn))
        if self.origin is not None:
            pose[:3, 3] = self.origin
        return geometry.inverse(pose)

    def _surface(
        self, scene: Scene, instance_id: int, seen: shading.ShadedPixels
    ) -> dict[str, Any]:
        described = albedo.describe(intrinsic.unshadowed(scene), instance_id, self.albedo)
        if self.albedo is None:
            described["albedo"] = shading.fully_lit(scene, described)
        if agreement.of_one_tint(scene, instance_id) and not agreement.modelled(scene):
            # It has one tint, and the proxy knows neither basin nor rim: what its brightness varies by is light.
            return described | {"smooth": None}
        best = intrinsic.best_light(scene, instance_id)
        known = self.albedo is not None
        smooth = shading.fit(seen, tuple(described["albedo"]), known, best)
        if smooth is not None:
            smooth = replace(smooth, casts=not rig.nothing_casts(scene))
        return described | {"smooth": smooth.describe() if smooth else None}

    def _texture(self, edit: Edit) -> Texture:
        if self.textures is not None:
            same(self.textures, edit["texture"], edit["digest"])
        return _pyramid(*self._named(edit))

    def _named(self, edit: Edit) -> tuple[Path | None, str, str | None, bool]:
        mirror = self.repeat == "mirror" or (self.repeat is None and self.textures is not None)
        return self.textures, edit["texture"], edit["digest"], mirror


def _pyramid(where: Path | None, name: str, digest: str | None, mirror: bool) -> Texture:
    return _shipped(name, mirror) if where is None else _own(where, name, digest, mirror)


@lru_cache(64)  # the whole set, 0.3 MB each
def _shipped(name: str, mirror: bool) -> Texture:
    return Texture.of(shipped.image(name), mirror)


@lru_cache(8)  # of up to 17 MB each
def _own(where: Path, name: str, digest: str | None, mirror: bool) -> Texture:
    return Texture.of(folder.image(where, name), mirror)


@lru_cache(256)
def _prevailing(where: Path | None, name: str, digest: str | None, mirror: bool) -> str | None:
    """The color word for nearly all of an image, None for a pattern of several."""
    texture = _pyramid(where, name, digest, mirror)
    start, rows, columns = next(size for size in texture.sizes if max(size[1:]) <= COARSE)
    texels = texture.texels[start : start + rows * columns] / 255.0
    named = [color_space.nearest(texel) for texel in texels]
    name = max(sorted(set(named)), key=named.count)
    return name if named.count(name) >= MOSTLY * len(named) else None
