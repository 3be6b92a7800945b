"""Give a thing the look of a picture: its patterns and palette, matched by VGG16's features (3D-NNFM)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from rpaug.assets.textures import folder, shipped
from rpaug.core.errors import BadInput, TargetError, Unsupported
from rpaug.core.interfaces import Edit, Examples, Needs, Operator, Painted
from rpaug.core.types import Effect, Scene, Surface
from rpaug.gaussians.painting import Painting
from rpaug.operators import fields, texturing
from rpaug.operators.painting import Paint, painted
from rpaug.scene.targets import targets

SHADE = (
    0.3,
    1.7,
)  # how much darker or brighter than on average a recorded pixel may make the new color


@dataclass(frozen=True)
class Stylised(Paint):
    """Pixel = new color x shading, where shading is how bright the recorded pixel is beside the old color.

    Old and new colors are those of the fitted Gaussians, in even light, at the pixel's place on its body.
    """

    instance_ids: frozenset[int]
    old: Painting
    new: Painting

    def __call__(
        self, color: Float32[np.ndarray, "n 3"], surface: Surface
    ) -> Float32[np.ndarray, "n 3"]:
        place = surface.ids, surface.points, surface.footprint
        (old, known), (new, drawn) = self.old.at(*place), self.new.at(*place)
        shade = (color * old).sum(-1) / np.maximum((old * old).sum(-1), 1e-3)
        styled = new * np.clip(shade, *SHADE)[:, None]
        out = np.where(((known > 0) & (drawn > 0))[:, None], styled, color)
        return np.clip(out, 0, 1).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Stylize(Operator):
    """Draw a picture, and optimise the colors of the target's Gaussians until they look like it to VGG16.

    What comes of it is a color for each place on the body: fixed cameras show it inside the target's mask and stay
    bit for bit outside. Needs fitted Gaussians, and VGG16's weights
    (`weights`, the path of an ImageNet state dict; torchvision's in torch's cache if not given).
    """

    target: targets.Target
    style: str | texturing.Sample = texturing.ANY
    textures: Path | None = None
    steps: Annotated[int, Field(ge=1, le=5000)] = 120
    weights: Path | None = None

    effect: ClassVar[Effect] = Effect.RGB
    needs: ClassVar[Needs] = Needs(targets=("target",), gaussians=True)
    asked_as: ClassVar[Mapping[str, str]] = {
        "style": "stylize, stylise, style, restyle, in the style of",
    }
    phrases: ClassVar[tuple[str, ...]] = ("stylize {target} [like {style:rust|denim}]",)
    examples: ClassVar[Examples] = (
        ("the cup in the style of rust", {"target": "cup", "style": "rust"}),
        ("stylize the drawer like denim", {"target": "drawer", "style": "denim"}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("texture", "textures")
    settles: ClassVar[str] = "look"

    def __post_init__(self) -> None:
        texturing.check(self.style, self.textures)

    def ready(self) -> None:
        from rpaug.providers import features  # only here: it brings torch

        features.load(self.weights)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        from rpaug.providers import features  # only here: it brings torch

        instance_ids = sorted(targets.find(scene, self.target))
        if scene.gaussians is None:
            raise Unsupported("stylize works on Gaussians, and this scene has none")
        if not np.isin(scene.gaussians.ids, instance_ids).any():
            raise TargetError(f"{self.target}: no Gaussian stands for it")
        network = features.load(self.weights)
        name = texturing.draw(self.style, self.textures, rng)
        return {
            "style": name,
            "digest": folder.digest(self.textures, name) if self.textures else None,
            "handles": instance_ids,
            "seed": fields.seed(rng),
            "weights": {"origin": network.origin, "digest": network.digest},
        }

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        from rpaug.gaussians import nnfm
        from rpaug.providers import features  # only here: both bring torch

        network = features.load(self.weights)
        if network.digest != edit["weights"]["digest"]:
            raise BadInput(
                self.weights or features.default(),
                "VGG16 weights",
                found=f"{network.digest}, {network.origin}",
                expected="{digest}, {origin}, as this edit was drawn with".format(
                    **edit["weights"]
                ),
            )
        if self.textures is None:
            picture = shipped.image(edit["style"])
        else:
            texturing.same(self.textures, edit["style"], edit["digest"])
            picture = folder.image(self.textures, edit["style"])
        instance_ids = frozenset(edit["handles"])
        settings = nnfm.StyleSettings(steps=self.steps)
        styled = nnfm.stylise(scene, instance_ids, picture, network, edit["seed"], settings)
        return painted(scene, [Stylised(instance_ids, styled.old, styled.new)])

    def says(self, edit: Edit) -> tuple[Painted, ...]:
        return (Painted(frozenset(edit["handles"]), None, anew=True),)
