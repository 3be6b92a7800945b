"""Give the table another texture, as COLOSSEUM's `table_texture` does."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from rpaug.core.interfaces import Examples
from rpaug.operators.texturing import Texturing
from rpaug.scene.targets.targets import TABLE, Target


@dataclass(frozen=True, kw_only=True)
class TableTexture(Texturing):
    """Lay an image on the table, found by its role."""

    target: Target = TABLE
    scale: Annotated[float, Field(gt=0)] = 0.6

    phrases: ClassVar[tuple[str, ...]] = ("change the texture of the table",)
    examples: ClassVar[Examples] = (
        ("a marble table", {"texture": "marble_white"}),
        ("some other table surface", {}),
    )
    undone_as: ClassVar[tuple[str, ...]] = (
        "table",
        "table color",
        "table colour",
        "texture",
        "textures",
    )
