"""Roles that a person settled for all episodes of a dataset: `roles.yaml` beside it, or the recipe's key `roles`."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    StrictInt,
    ValidationError,
    field_validator,
    model_validator,
)

from rpaug.core import color_space, safe_yaml
from rpaug.core.errors import BadInput, TargetError
from rpaug.core.files import read_bytes, see_inside
from rpaug.core.types import Belief, Scene
from rpaug.scene.targets import targets

NAME = "roles.yaml"
MOST = 10_000  # values in the file

Role = Literal["manipulated", "receiver", "robot", "table", "background"]


class SettledRole(BaseModel):
    """Exactly one of `handle`, mask ids, and `color`, a color word as `rpaug inspect` prints it.

    Where several things have that color, `all` takes them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    handle: StrictInt | list[StrictInt] | None = None
    color: str | None = None
    name: str | None = None
    all: bool = False

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.name is not None:
            raise ValueError("no layout that rpaug reads names its instances: give handle or color")
        if (self.handle is None) == (self.color is None) or self.handle == []:
            raise ValueError("give exactly one of handle and color")
        if self.color is not None and color_space.canonical(self.color) is None:
            raise ValueError(f"no color is called {self.color!r}")
        return self

    @property
    def target(self) -> targets.Target:
        """What an edit would name it by."""
        if self.handle is not None:
            return targets.Target(handle=self.handle)
        return targets.Target(text=self.color, all=self.all)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")

    version: Literal[1] = 1
    roles: dict[Role, SettledRole]

    @field_validator("roles", mode="before")
    @classmethod
    def _none(cls, value: Any) -> Any:
        """All roles may be comments."""
        return {} if value is None else value


def read(root: Path) -> dict[str, SettledRole]:
    """The roles of a dataset's `roles.yaml`, none where there is no such file. Raises BadInput."""
    path = root / NAME
    if not path.is_file():
        return {}
    see_inside(root, path)
    try:
        tree, _ = safe_yaml.load(read_bytes(path), MOST)
        return dict(_File.model_validate(tree).roles.items())
    except safe_yaml.NotPlain as error:
        line = "file" if error.line is None else f"line {error.line}"
        raise BadInput(path, line, found=error.found, expected=error.expected) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "file"
        expected = first["msg"].removeprefix("Value error, ")
        raise BadInput(path, where, found=f"{first['input']!r:.80}", expected=expected) from None


def settle(scene: Scene, wanted: Mapping[str, SettledRole]) -> tuple[Scene, tuple[str, ...]]:
    """The scene in which these roles are what was settled, for certain, and what is wrong where one cannot be found.

    Of several ids those that are in the episode count. A settled role that this episode has nothing for is absent:
    nothing else is taken for it.
    """
    found: dict[str, Belief] = {}
    for role, one in wanted.items():
        try:
            ids = scene.instance_ids.intersection(
                one.handle if isinstance(one.handle, list) else ()
            )
            found[role] = Belief(ids or _found(scene, one), 1.0, (NAME,))
        except TargetError as error:
            found[role] = Belief(frozenset(), 0.0, (f"{NAME}: {error}",))
    taken = frozenset[int]().union(*(belief.instance_ids for belief in found.values()))
    others = {name: ids - taken for name, ids in scene.roles.items() if name not in found}
    own = {role: belief.instance_ids for role, belief in found.items()}
    roles = {role: ids for role, ids in {**others, **own}.items() if ids}
    wrong = tuple(
        f"{role}: {belief.reasons[0]}" for role, belief in found.items() if not belief.instance_ids
    )
    beliefs = {
        role: replace(belief, instance_ids=belief.instance_ids - taken)
        for role, belief in scene.beliefs.items()
    }
    return replace(scene, roles=roles, beliefs={**beliefs, **found}), wrong


def _found(scene: Scene, one: SettledRole) -> frozenset[int]:
    """What was settled, the table too where it goes by its color. Raises TargetError."""
    if one.color is not None:
        return targets.by_words(scene, one.target, whole=True)
    return targets.find(scene, one.target)
