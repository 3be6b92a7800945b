"""Put things onto the table that have nothing to do with the task."""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Bool, Float64
from pydantic import AfterValidator, Field

from rpaug.assets import library
from rpaug.assets.library import Asset
from rpaug.core import geometry, instance_ids
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.interfaces import Added, Edit, Examples, Operator
from rpaug.core.types import Effect, Scene
from rpaug.operators.fields import Unit
from rpaug.operators.insert import (
    AS_IT_COMES,
    Harmoniser,
    Sizes,
    added,
    at_rest,
    inserted,
    light,
    suited,
)
from rpaug.providers import harmonise
from rpaug.scene.lighting import albedo
from rpaug.scene.placement import policy_views, zones
from rpaug.scene.placement.free_space import MARGIN, FreeSpace
from rpaug.scene.placement.placing import find_free_space, points_of
from rpaug.scene.placement.policy_views import PolicyViews
from rpaug.scene.targets.survey import size_cm

CLOSE = 0.02  # metres that things near the action, or of one group, keep from all others at least
GROUPED = 0.05  # metres between things of one group, at most
TRIES = 12  # things and turns drawn for one place before giving up
SPOTS = 4  # places looked at of one thing
# Shares of things by the path and the target, where a recording shows them.
NEAR: dict[Literal["path", "target"], float] = {"path": 1 / 6, "target": 1 / 6}
ALIKE = 0.25  # of the things to choose from: those whose proportions are nearest to the target's


def _shares(value: dict[str, float]) -> dict[str, float]:
    if sum(value.values()) > 1 + 1e-9:
        raise ValueError(f"the shares come to {sum(value.values())}, more than 1")
    return value


Group = Bool[np.ndarray, "r c"] | None
"""The cells that things of a group stand on so far."""

Shares = Annotated[dict[Literal["path", "target"], Unit], AfterValidator(_shares)]


@dataclass(frozen=True)
class Alike:
    """Things to draw from: how large each is shown, by its name, and the color that all have, None for their own."""

    choices: tuple[Asset, ...]
    scales: Mapping[str, float] = field(default_factory=dict)
    color: tuple[float, float, float] | None = None

    def longest(self, asset: Asset) -> float:
        """Metres of its longest side as it is shown."""
        return self.scales.get(asset.name, 1.0) * asset.largest


@dataclass(frozen=True, kw_only=True)
class Distractors(Operator):
    """Insert `count` things drawn from the library, any that fits as likely, none again while others fit there;
    painted and scaled as `insert` does.

    `near` gives the shares of them that stand `within` so many metres of the gripper's low path and of the target, what
    the robot handles; the others stand farther from both. By default none is asked to stand by what is not recorded. A
    word means all of them, `anywhere` any free place. They stand in the `workspace`, by default around all that the
    gripper reached. At least one of the policy's `cameras` shows them, and none sees the target partly hidden by them
    in more than a share `hides` of the frames. With `like` they have the target's color or its proportions. So many
    stand together as `groups` says.
    """

    count: Annotated[int, Field(ge=1, le=30)] = 2
    assets: tuple[str, ...] | None = None
    category: str | None = None
    color: str | None = None
    size: Sizes | None = (0.04, 0.16)  # metres of the longest side
    near: Literal["path", "target", "anywhere"] | Shares = field(default_factory=lambda: {**NEAR})
    within: Annotated[float, Field(ge=0.05, le=1)] = 0.15  # metres
    workspace: zones.Box | None = None
    cameras: tuple[str, ...] | None = None
    hides: Unit = 0.02
    like: Literal["target", "color", "shape"] | None = None
    groups: Annotated[int, Field(ge=1, le=10)] = 1
    harmonise: bool = True
    harmoniser: Harmoniser = "scene"

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    asked_as: ClassVar[Mapping[str, str]] = {
        "strangers": "everything not needed, everything not needed for the task, stuff not needed, "
        "clutter up, mess up, distract, distractors, distractor, clutter, distractor objects, "
        "other objects, random objects, random things, distracting objects, small objects, "
        "objects not needed, unneeded objects, unneeded things, irrelevant objects, "
        "more clutter, more objects, more things, other stuff, side objects, objects not needed for the task, "
        "things not needed for the task, stuff not needed for the task, "
        "what is not needed for the task, unrelated objects, random items, random stuff, "
        "random clutter, junk, extra objects, extra things, household things, small things, "
        "small household things, objects lying around, things lying around, "
        "random objects lying around, pieces of clutter",
    }
    phrases: ClassVar[tuple[str, ...]] = ("add {count} distractors",)
    examples: ClassVar[Examples] = (
        ("three random objects near where the gripper goes", {"count": 3, "near": "path"}),
        ("clutter that looks like the target", {"count": 4, "like": "target", "groups": 2}),
    )
    undone_as: ClassVar[tuple[str, ...]] = ("distractor", "distractors", "clutter")

    def ready(self) -> None:
        harmonise.ready(self.harmoniser)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        edit = self._stood(scene, self._offered(), rng)
        if not self.harmonise:
            return {**edit, **AS_IT_COMES}
        return suited(scene, {**edit, **light(scene)}, self.harmoniser)

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return inserted(scene, edit)

    def says(self, edit: Edit) -> tuple[Added, ...]:
        return added(edit)

    def falls_short(self, edit: Edit) -> dict[str, tuple[int, int]]:
        near = f"{100 * self.within:.0f} cm"
        words = {
            "path": f"within {near} of the gripper's low path",
            "target": f"within {near} of the target",
            "beyond": f"over {near} from target and path",
            "anywhere": "in the workspace",
        }
        elsewhere, every = edit.get("elsewhere", {}), sum(edit.get("asked", {}).values())
        return {
            f"added things stand elsewhere: no room {where}": (
                elsewhere.get(zone, 0),
                every,
            )
            for zone, where in words.items()
        }

    def _offered(self) -> Alike:
        """What the recipe lets be drawn: assets as they are, or what comes to category, color and size."""
        if self.assets is not None:
            return Alike(tuple(library.get(name) for name in self.assets))
        choices, paint = library.closest(self.category, self.color, self.size)
        if self.size is None:
            return Alike(choices, color=paint)
        longest = {one.name: float(np.clip(one.largest, *self.size)) for one in choices}
        return Alike(choices, {one.name: longest[one.name] / one.largest for one in choices}, paint)

    def _stood(self, scene: Scene, offered: Alike, rng: np.random.Generator) -> Edit:
        """Things where they stand, and of which zones some found no room and stand `elsewhere`."""
        target = zones.acted_on(scene)
        if self.like and not target:
            raise TargetError("nothing was seen to be the target, so nothing can be like it")
        room = find_free_space(scene)
        found = zones.find(scene, room, self.within, self.workspace)
        views = policy_views.find(scene.episode, target, self.cameras)
        fresh = instance_ids.free(scene, self.count)
        things: list[Edit] = []
        asked: Counter[str] = Counter()
        stand: Counter[str] = Counter()
        elsewhere: Counter[str] = Counter()
        group: Group = None
        # Chances a step apart, so that the shares hold as nearly as so few things allow.
        start = float(rng.random())
        for number in range(self.count):
            if number % self.groups == 0:
                wanted, group = self._wanted((start + number / self.count) % 1, found.known), None
            asked[wanted] += 1
            alike = self._alike(scene, target, offered, rng)
            order = itertools.product(self._order(wanted, group), _fewest_first(alike, stand))
            for (zone, beside), choices in order:
                close = MARGIN if zone == "anywhere" and beside is None else CLOSE
                stood = _stood_in(room, found[zone], beside, close, choices, views, self.hides, rng)
                if stood is not None:
                    break
            else:
                raise Unsupported(
                    f"thing {number + 1} of {self.count}: there is no room to stand ({wanted})"
                )
            if zone != wanted:
                elsewhere[wanted] += 1
            one, outline, views = stood
            stand[one["asset"]] += 1
            room = room.with_thing(outline)
            group = room.covered(outline) | (False if group is None else group)
            things.append({"handle": fresh[number], **one})
        return {"things": things, "asked": dict(asked), "elsewhere": dict(elsewhere)}

    def _wanted(self, chance: float, known: frozenset[str]) -> str:
        """The zone that the next things shall stand in, by a chance in 0..1; `known` are those that are recorded."""
        if isinstance(self.near, str):
            return self.near
        for zone, share in self.near.items():
            if chance < share:
                return zone if self.near != NEAR or zone in known else "beyond"
            chance -= share
        return "beyond"

    def _order(self, wanted: str, group: Group) -> Iterator[tuple[str, Group]]:
        """Zones in which to look for room, all of them beside the group first: one that stands together may stand in
        another zone. So may what shares or `anywhere` are asked of."""
        zones_ = [wanted]
        if wanted == "anywhere":
            zones_ += ["outside"]
        elif not isinstance(self.near, str):
            zones_ += [*self.near, "beyond", "outside"]
        for beside in (group, None) if group is not None else (None,):
            for zone in dict.fromkeys(zones_):
                yield zone, beside

    def _alike(
        self,
        scene: Scene,
        target: frozenset[int],
        offered: Alike,
        rng: np.random.Generator,
    ) -> Alike:
        """What to draw from so that a thing is like the target as it was recorded, where it shall be."""
        like = str(rng.choice(["color", "shape"])) if self.like == "target" else self.like
        if like == "color":
            painted = tuple(asset for asset in offered.choices if not asset.gaussians)
            pixels = [albedo.pixels(scene.episode, one) for one in sorted(target)]
            red, green, blue = albedo.estimate(np.concatenate(pixels)).rgb
            return replace(offered, choices=painted, color=(red, green, blue))
        if like == "shape":
            size = np.array(size_cm(points_of(scene, target))) / 100
            return replace(_shaped(offered.choices, size, self.size), color=offered.color)
        return offered


def _fewest_first(alike: Alike, stand: Counter[str]) -> Iterator[Alike]:
    """Those of which the fewest stand already, then any."""
    least = min(stand[asset.name] for asset in alike.choices)
    fewest = tuple(one for one in alike.choices if stand[one.name] == least)
    if len(fewest) < len(alike.choices):
        yield replace(alike, choices=fewest)
    yield alike


def _shaped(
    choices: tuple[Asset, ...], size: Float64[np.ndarray, "3"], sizes: tuple[float, float] | None
) -> Alike:
    """Those with the most alike proportions, as large as the target or as near to that as they may be.

    `size` is (length, width, height) in metres; `sizes` bound the longest side.
    """

    def unlike(asset: Asset) -> float:
        x, y, z = asset.size
        own = np.array([max(x, y), min(x, y), z])
        return float(np.abs(np.log(own / own.max()) - np.log(size / size.max())).sum())

    size = size.clip(1e-3)
    longest = float(size.max()) if sizes is None else float(np.clip(size.max(), *sizes))
    best = sorted(choices, key=unlike)[: int(np.ceil(ALIKE * len(choices)))]
    return Alike(tuple(best), {asset.name: longest / asset.largest for asset in best})


def _stood_in(
    room: FreeSpace,
    zone: Bool[np.ndarray, "r c"],
    group: Group,
    margin: float,
    alike: Alike,
    views: PolicyViews,
    hides: float,
    rng: np.random.Generator,
) -> tuple[Edit, Float64[np.ndarray, "k 2"], PolicyViews] | None:
    """A thing in a free place of the zone, by its group if there is one; its outline in the world and the views with
    it. None if nothing fits there, however small, or cameras show no place well."""
    fits = alike.choices
    for _ in range(TRIES if zone.any() else 0):
        asset = fits[int(rng.integers(len(fits)))]
        scale = alike.scales.get(asset.name, 1.0)
        pose, outline, top = at_rest(asset.name, scale, float(rng.uniform(-np.pi, np.pi)))
        here = zone & room.spots(outline, top, margin)
        if group is not None:
            reach = float(np.linalg.norm(outline, axis=1).mean())
            here &= room.near(room.at(np.argwhere(group)), GROUPED + reach)
        cells = np.argwhere(here)
        for cell in rng.permutation(len(cells))[:SPOTS]:
            middle = room.at(cells[cell, None])[0]
            pose[:3, 3] += [*middle, room.level]
            points = geometry.transform(pose, scale * library.mesh(asset.name).points)
            after = views.with_thing(points, hides)
            if after is not None:
                painted = {} if alike.color is None else {"color": list(alike.color)}
                thing = {"asset": asset.name, "scale": scale, "pose": pose.tolist(), **painted}
                return thing, outline + middle, after
            pose[:3, 3] -= [*middle, room.level]
        if not len(cells):
            smaller = (one for one in fits if alike.longest(one) < alike.longest(asset))
            fits = tuple(smaller) or fits
    return None
