"""Give a thing another texture, lying still on it in every camera and frame, under the light it was recorded in."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from rpaug.core.interfaces import Examples
from rpaug.operators.texturing import Texturing


@dataclass(frozen=True, kw_only=True)
class Retexture(Texturing):
    """Lay an image on `target`, in the frame of its body: as COLOSSEUM's `object_texture` does."""

    asked_as: ClassVar[Mapping[str, str]] = {
        "lay": "cover, wrap, texture, retexture, re-texture, textures, pattern, patterns, "
        "surface, material, materials, finish, drape, clad, skin, line, look of, "
        "covered",
        "width": "wide, across, large each, per tile, in size",
    }
    phrases: ClassVar[tuple[str, ...]] = ("cover {target} with {texture:denim|walnut|terrazzo}",)
    examples: ClassVar[Examples] = (
        ("cover the box with denim", {"target": "box", "texture": "denim"}),
        ("any pattern on where it goes", {"target": {"role": "receiver"}}),
    )
