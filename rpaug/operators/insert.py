"""Put a thing that was never recorded onto the table."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from jaxtyping import Float64, UInt8
from pydantic import AfterValidator, Field

from rpaug.assets import library, settle
from rpaug.assets.library import Asset
from rpaug.compose.inserted import draw as draw_all
from rpaug.core import geometry, instance_ids
from rpaug.core.color_space import from_linear, nearest, to_linear
from rpaug.core.errors import RpaugError, Unsupported
from rpaug.core.interfaces import Added, Edit, Examples, Needs, Operator
from rpaug.core.types import Ambience, Body, Effect, Gaussians, Scene
from rpaug.operators.fields import Interval
from rpaug.providers import harmonise
from rpaug.scene.lighting import ambience, shadows
from rpaug.scene.placement import standing
from rpaug.scene.placement.placing import find_free_space, hull
from rpaug.scene.targets import targets

AS_IT_COMES: Edit = {"ambience": None, "lamps": []}
TRIES = 12  # things or turns drawn before giving up


def _metres(value: tuple[float, float]) -> tuple[float, float]:
    if not 0 < value[0] <= value[1] <= 3:
        raise ValueError(f"{list(value)} is not within 0..3 metres")
    return value


def _known(method: str) -> str:
    try:
        harmonise.check(method)
    except RpaugError as error:
        raise ValueError(str(error)) from None
    return method


Harmoniser = Annotated[str, AfterValidator(_known)]
Sizes = Annotated[Interval[float], AfterValidator(_metres)]


@dataclass(frozen=True, kw_only=True)
class Insert(Operator):
    """Insert one thing of the library: by name, or drawn from a category, a color word and a longest side in metres.

    What the library has in no such color or size is painted or scaled. It stands at rest on a free place of the table,
    5 cm away from other things and from all that moves, or at `at`, 2 cm away from them. It is lit by the light that
    the recording shows, unless `harmonise` is off. With `near` its place is drawn from those that are `within` so many
    metres of that thing. With `harmoniser` "libcom:FOLDER", what libcom's network makes of it in all views becomes one
    factor a channel, the same for all of them.
    """

    asset: str | None = None
    category: str | None = None
    color: str | None = None
    size: Sizes | None = None
    scale: Annotated[float, Field(gt=0, le=100)] = 1.0
    at: tuple[float, float] | None = None
    near: targets.Target | None = None
    within: Annotated[float, Field(gt=0, le=10)] = 0.15  # metres
    harmonise: bool = True
    harmoniser: Harmoniser = "scene"

    effect: ClassVar[Effect] = Effect.PIXELS | Effect.BODIES
    puts: ClassVar[bool] = True
    needs: ClassVar[Needs] = Needs(anchors=("near",))
    asked_as: ClassVar[Mapping[str, str]] = {
        "add": "add, insert, place, introduce, spawn, include, throw in, toss in, put in, "
        "drop in, bring in, mix in, put down, stand, stands, scatter some, sprinkle, "
        "throw some, there is, there should be, there must be, added, inserted, "
        "introduced, throw in, set down, litter, lay",
    }
    phrases: ClassVar[tuple[str, ...]] = ("add a {category:mug|bowl|book} [near {near}]",)
    examples: ClassVar[Examples] = (
        ("a mug next to the drawer", {"category": "mug", "near": "drawer"}),
        ("put a lemon on the table", {"category": "lemon"}),
    )

    def __post_init__(self) -> None:
        if self.at is not None and self.near is not None:
            raise ValueError("give `at` or `near`, not both")

    def ready(self) -> None:
        harmonise.ready(self.harmoniser)

    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        if self.asset is None:
            choices, paint = library.closest(self.category, self.color, self.size)
        else:
            choices, paint = (library.get(self.asset),), None
        near = None if self.near is None else (targets.find(scene, self.near), self.within)
        size = None if self.asset is not None else self.size
        thing = _draw(scene, choices, self.scale, size, rng, self.at, near)
        things = [thing if paint is None else {**thing, "color": list(paint)}]
        if not self.harmonise:
            return {"things": things, **AS_IT_COMES}
        return suited(scene, {"things": things, **light(scene)}, self.harmoniser)

    def apply(self, scene: Scene, edit: Edit) -> Scene:
        return inserted(scene, edit)

    def says(self, edit: Edit) -> tuple[Added, ...]:
        return added(edit)


def _draw(
    scene: Scene,
    choices: tuple[Asset, ...],
    scale: float,
    size: tuple[float, float] | None,
    rng: np.random.Generator,
    at: tuple[float, float] | None,
    near: tuple[frozenset[int], float] | None,
) -> Edit:
    """A thing at rest on the table. Raises Unsupported if it finds no place."""
    around = find_free_space(scene)
    for _ in range(TRIES):
        asset = choices[int(rng.integers(len(choices)))]
        turn = float(rng.uniform(-np.pi, np.pi))
        longest = asset.largest if size is None else float(np.clip(asset.largest, *size))
        times = scale * (longest / asset.largest)
        pose, outline, top = at_rest(asset.name, times, turn)
        beside = None if near is None else standing.beside(scene, near[0], outline, near[1])
        if at is not None:
            middle = np.array(at) if around.free(outline, top, np.array(at)) else None
        else:
            middle = around.draw(outline, top, rng, beside)
        if middle is not None:
            break
    else:
        where = f"at {list(at)}" if at is not None else "there" if near else "on the table"
        raise Unsupported(f"inserting {asset.name}: there is no room {where}")
    pose[:3, 3] += [*middle, around.level]
    (fresh,) = instance_ids.free(scene, 1)
    return {"asset": asset.name, "scale": times, "handle": fresh, "pose": pose.tolist()}


def at_rest(
    name: str, scale: float, turn: float
) -> tuple[Float64[np.ndarray, "4 4"], Float64[np.ndarray, "k 2"], float]:
    """Pose, outline around the origin and height of a thing at rest on z = 0 with its middle above the origin."""
    thing = library.mesh(name)
    about = geometry.rigid(np.array([0.0, 0.0, turn]), np.zeros(3))
    pose = about @ settle.resting(thing, scale)
    points = geometry.transform(pose, scale * thing.points)
    outline = hull(points)
    middle = (outline.min(0) + outline.max(0)) / 2
    pose[:2, 3] -= middle
    return pose, outline - middle, float(points[:, 2].max())


def light(scene: Scene) -> Edit:
    """The recorded light, and the lamps whose shadows the recording shows, as plain values."""
    found = ambience.estimate(scene.episode)
    ends = None if found.lightness is None else list(found.lightness)
    shown = {"light": list(found.light), "tint": list(found.tint), "lightness": ends}
    return {"ambience": shown, "lamps": shadows.lamps(scene)}


def suited(scene: Scene, edit: Edit, harmoniser: str) -> Edit:
    """The edit, its light's color as a harmoniser would have it: the typical factor by channel over all views."""
    if harmoniser == harmonise.SCENE:
        return edit
    after = inserted(scene, edit)
    new = [thing["handle"] for thing in edit["things"]]
    ratios = []
    for view in scene.episode.views.values():
        if view.depth is None:
            continue
        ids = view.ids(0) if view.ids else np.zeros(view.depth(0).shape, np.int32)
        rgb, _, seen = draw_all(after, view.camera, 0, (view.rgb(0), view.depth(0), ids))
        mask = np.isin(seen, new)
        if mask.any():
            made = harmonise.harmonised(harmoniser, rgb, mask)
            ratios.append((made[mask] + 1.0) / (rgb[mask] + 1.0))
    if not ratios:
        return edit
    factor = np.median(np.concatenate(ratios), 0)
    shown = edit["ambience"]
    tint = [round(float(old * new), 4) for old, new in zip(shown["tint"], factor, strict=True)]
    return edit | {"ambience": shown | {"tint": tint}}


def inserted(scene: Scene, edit: Edit) -> Scene:
    """The scene with the things of an edit standing in it."""
    shown = edit["ambience"]
    light = None
    if shown is not None:
        red, green, blue = shown["tint"]
        ends = None if shown["lightness"] is None else tuple(shown["lightness"])
        light = Ambience(tuple(shown["light"]), (red, green, blue), ends)
    new = tuple(inserted_body(thing, light, scene.episode.length) for thing in edit["things"])
    after = replace(scene, bodies=(*scene.bodies, *new), ambience=light or scene.ambience)
    if light is None:
        return after
    return shadows.grounded(scene, shadows.follow(scene, after, edit["lamps"]))


def added(edit: Edit) -> tuple[Added, ...]:
    """What an edit put in, as the library calls it."""
    assets = [(library.get(thing["asset"]), thing.get("color")) for thing in edit["things"]]
    return tuple(
        Added(asset.category, asset.name, nearest(np.array(color)) if color else asset.color)
        for asset, color in assets
    )


def inserted_body(thing: Edit, light: Ambience | None, length: int) -> Body:
    """One thing where it stands over the whole episode; its Gaussians in the scene's light."""
    name, scale, pose = thing["asset"], thing["scale"], np.array(thing["pose"])
    mesh, splats = library.mesh(name), library.gaussians(name)
    if scale != 1.0:
        mesh = replace(mesh, points=scale * mesh.points)
    if "color" in thing:
        mesh = replace(mesh, image=_painted(mesh.image, np.array(thing["color"])))
    if splats is not None:
        size = np.float32(scale)
        splats = replace(splats, means=size * splats.means, scales=size * splats.scales)
        splats = splats if light is None else _in_light(splats, pose, light)
    return Body(
        instance_ids=frozenset([thing["handle"]]),
        to_world=np.tile(pose, (length, 1, 1)),
        motion="static",
        mesh=mesh,
        splats=splats,
        outlined=library.outlined(name),
    )


def _painted(
    image: UInt8[np.ndarray, "h w 3"], color: Float64[np.ndarray, "3"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The picture in one display color, as bright here and there as it was beside its mean."""
    bright = to_linear(image / 255.0).mean(-1, keepdims=True)
    shown = from_linear(np.clip(to_linear(color) * bright / max(bright.mean(), 1e-6), 0, 1))
    return np.rint(255 * shown).astype(np.uint8)


def _in_light(splats: Gaussians, pose: Float64[np.ndarray, "4 4"], light: Ambience) -> Gaussians:
    from rpaug.compose import tuned  # only here: it brings the rasteriser

    return tuned.tuned(splats, pose, light)
