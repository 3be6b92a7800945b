"""Which models are asked: what a recipe says, then a command's `--models`, then a file of the user's own.

The file is `rpaug/models.toml` in `$XDG_CONFIG_HOME` (`~/.config`), with the keys of a recipe's `models`. What is taken
stands in every report, so that a recipe and its report say all that a result hangs on.
"""

import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from rpaug.core.errors import RpaugError

Name = Annotated[str, Field(min_length=1)]
OFF = "off"  # instead of a name: none, whatever the file says


class Models(BaseModel):
    """Models by folder or id of the hub (`rpaug models pull`): `text` finds what words mean, `instances` its outline,
    `depth` how far it is, `inpaint` paints what nobody saw, `poses` says where a moving camera was.

    `instances` is `grabcut` where only `text` is given and gives boxes alone; `depth` may be `torchscript:FILE` or
    `torchscript-inverse:FILE`, `poses` is `torchscript:FILE` or `export:FILE`, `inpaint` a way of `remove`. `device` is
    torch's, or `auto`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    text: Name | None = None
    instances: Name | None = None
    depth: Name | None = None
    inpaint: Name | None = None
    poses: Name | None = None
    device: Name = "auto"

    @property
    def finds(self) -> bool:
        """Whether they tell instances apart."""
        return self.text is not None


USES = tuple(name for name in Models.model_fields if name != "device")


def path() -> Path:
    """Where the user's file is, if there is one."""
    home = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(home) / "rpaug" / "models.toml"


def given(options: Sequence[str], recipe: Mapping[str, Any]) -> dict[str, str]:
    """The models of a run, as a recipe's `models` has them: `recipe` is that of the recipe, `options` those of
    `--models`, `USE=NAME` each, or `off` for none but the recipe's. Raises RpaugError.
    """
    known = {} if OFF in options else _kept()
    stated = dict[str, str]()
    for option in options:
        use, equals, name = option.partition("=")
        if option == OFF:
            continue
        if not equals or not name or use not in Models.model_fields:
            expected = f"USE=NAME with a USE of {', '.join(Models.model_fields)}; or off"
            raise RpaugError(f"--models {option}: expected {expected}")
        stated[use] = name
    return {
        use: name for use, name in {**known, **recipe, **stated}.items() if name not in (None, OFF)
    }


def _kept() -> dict[str, str]:
    """What the user's file says; nothing where there is none. Raises RpaugError."""
    place = path()
    try:
        with place.open("rb") as stream:
            found = tomllib.load(stream)
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except (OSError, ValueError) as error:
        raise RpaugError(f"{place}: {error}") from None
    if set(found) - set(Models.model_fields) or not all(
        isinstance(one, str) for one in found.values()
    ):
        raise RpaugError(f"{place}: expected names under {', '.join(Models.model_fields)} alone")
    return found
