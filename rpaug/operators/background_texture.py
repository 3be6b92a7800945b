"""Give walls and floor another texture, as COLOSSEUM's `background_texture` does."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from rpaug.core.interfaces import Examples
from rpaug.operators.texturing import Texturing
from rpaug.scene.targets.targets import BACKGROUND, Target


@dataclass(frozen=True, kw_only=True)
class BackgroundTexture(Texturing):
    """Lay an image on all that stands around the table, found by its role."""

    target: Target = BACKGROUND
    scale: Annotated[float, Field(gt=0)] = 1.2

    phrases: ClassVar[tuple[str, ...]] = ("change the texture of the background",)
    examples: ClassVar[Examples] = (
        ("turn the walls and the floor into brick", {"texture": "bricks_red"}),
        ("random background", {}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("background", "walls", "floor", "texture", "textures")
