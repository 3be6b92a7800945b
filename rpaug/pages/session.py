"""One episode under changing recipes: its scene is built once, copies are drawn and single frames made as asked."""

import json
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from rpaug.core import registry
from rpaug.core.ahead import in_order
from rpaug.core.types import CameraView, Effect, Episode
from rpaug.pages import told
from rpaug.pages.document import color_of, jpeg, png, webp
from rpaug.pages.instances import labels
from rpaug.pipeline import inspect, plan, prepare
from rpaug.pipeline.copies import Made, PreparedEpisode, StepMemory, draw_copy, rendered
from rpaug.pipeline.recipe import Recipe
from rpaug.scene.recorded import surfels
from rpaug.scene.targets import settled
from rpaug.scene.targets.survey import InstanceSummary

WIDEST = 320  # pixels of an image on a page
LEVELS = 5  # of 255 between two grays of depth: a quarter of what exact ones take
BLOCK = 16  # pixels: JPEG's blocks of one frame must not reach into the next
DRAWN = {"edits", "seed", "copies", "gates", "select", "keep_originals", "on_missing"}
"""Keys of a recipe that the scene does not depend on."""
KEPT_COPIES = 2  # whose frames are kept: looking at another frame draws nothing anew

Images = dict[str, dict[str, Any]]
"""By camera: `after`, `depth`, `ids` as data URLs, all frames of one in a sheet of `columns` tiles of `tile` pixels."""


@dataclass(frozen=True)
class ShownCopy:
    """A copy, whether gates judged it as a run does, and the faults of the draws before it that they rejected."""

    made: Made
    judged: bool = False
    failed: tuple[str, ...] = ()

    def verdict(self) -> dict[str, Any]:
        """Plain values."""
        figures = self.judged and not self.made.known
        return {
            "judged": self.judged,
            "faults": list(self.made.faults),
            "failed": list(self.failed),
            "measured": self.made.figures.describe() if figures else {},
        }


KeptCopies = OrderedDict[tuple[str, int], ShownCopy]


def _kept(copies: KeptCopies, key: tuple[str, int], shown: ShownCopy) -> ShownCopy:
    """The copy, the latest of the few that are kept."""
    copies[key] = shown
    copies.move_to_end(key)
    while len(copies) > KEPT_COPIES:
        copies.popitem(last=False)
    return shown


@dataclass
class Session:
    """An episode of a dataset. Raises BadInput where there is none of that key."""

    root: Path
    key: str | None = None
    _reading: Lock = field(default_factory=Lock)
    _scenes: dict[str, Any] = field(default_factory=dict)
    _before: tuple[tuple[int, ...], Images] = (), {}
    _copies: KeptCopies = field(default_factory=OrderedDict)
    _judged: KeptCopies = field(default_factory=OrderedDict)  # apart: others are drawn unasked

    @property
    def episode(self) -> Episode:
        """As it was recorded."""
        with self._reading:
            return self._episode

    @cached_property
    def _episode(self) -> Episode:
        return registry.read(self.root, self.key)

    @cached_property
    def found(self) -> tuple[dict[str, Any], tuple[InstanceSummary, ...], Episode]:
        """What `inspect` says of it."""
        return inspect.inspect(self.episode, roles=settled.read(self.root))

    @property
    def names(self) -> dict[int, tuple[str, tuple[int, int, int]]]:
        """Name and color of each instance."""
        return labels(self.found[1])

    def recorded(self) -> dict[str, Any]:
        """What a page says of the episode before anything was looked for in it."""
        shown = self.episode
        return {
            "key": shown.key,
            "instruction": shown.instruction,
            "length": shown.length,
            "cameras": {name: _size(view) for name, view in shown.views.items()},
            "roles": {},
            "instances": [],
        }

    def describe(self) -> dict[str, Any]:
        """What a page says of the episode itself."""
        described, rows, _ = self.found
        names = self.names
        return {
            **self.recorded(),
            "roles": {
                role: {"ids": one["handles"], "why": list(one["reasons"])}
                for role, one in described.get("roles", {}).items()
            },
            "instances": [
                {"id": one.instance_id, "name": names[one.instance_id][0], "color": names[one.instance_id][1],
                 "words": f"{one.instance_id}: {f'{one.role}, ' if one.role else ''}{one.color_name}"}
                for one in rows
            ],
        }  # fmt: skip

    def prepared(self, recipe: Recipe) -> PreparedEpisode:
        """The episode made ready for a recipe. Raises RpaugError."""
        recipe = recipe.settled(self.root)
        wanted = plan.make(prepare.operators(recipe), self.episode)
        name = _asked_of_scene(recipe, wanted)
        if name not in self._scenes:
            scene, made = prepare.prepare_scene(self.episode, recipe, 0)
            kept = cache(partial(surfels.recorded, scene))
            self._scenes[name] = scene, made, kept, StepMemory()
        scene, made, kept, memory = self._scenes[name]
        chosen = made if recipe.accuracy else wanted
        return PreparedEpisode(scene, chosen, recipe, kept, memory=memory)

    def copy(self, recipe: Recipe, copy: int) -> ShownCopy:
        """Copy number `copy`, not judged unless it is kept as `judged` made it. Raises RpaugError."""
        prepared = self.prepared(recipe)
        key = json.dumps(prepared.recipe.source), copy
        if key in self._judged:
            return self._judged[key]
        shown = self._copies.get(key) or ShownCopy(draw_copy(prepared, copy, lambda _: ()))
        return _kept(self._copies, key, shown)

    def judged(
        self, recipe: Recipe, copy: int, before: Callable[[], None] = lambda: None
    ) -> ShownCopy:
        """The same as a run judges it, over all frames, and draws it again where its gates reject it.

        `before` is called before each frame, and may raise to end it. Raises RpaugError.
        """
        prepared, faults = self.prepared(recipe), list[tuple[str, ...]]()

        def judge(made: Made) -> Sequence[str]:
            faults.append(tuple(rendered(made, before)))
            return faults[-1]

        made = draw_copy(prepared, copy, judge)
        before_it = faults if made.known else faults[:-1]
        failed = tuple(fault for draw in before_it for fault in draw)
        shown = ShownCopy(made, True, failed)
        return _kept(self._judged, (json.dumps(prepared.recipe.source), copy), shown)

    def before(self, frames: Sequence[int]) -> Images:
        """The recorded images, the latest kept; many of them as JPEG only where that is smaller than exact pixels."""
        name, views = tuple(frames), self.episode.views
        held = self._before  # another thread may put its own there
        if held[0] != name:
            made = {camera: {"before": smallest(view, frames)} for camera, view in views.items()}
            held = self._before = name, made
        return held[1]

    def drawn(
        self, recipe: Recipe, copy: int, frames: Sequence[int], judged: bool
    ) -> dict[str, Any]:
        """Copy number `copy`: words, faults, and the images of these frames.

        `judged` measures the gates over all frames, as a run does, and draws again where they fail. Raises RpaugError.
        """
        shown = self.judged(recipe, copy) if judged else self.copy(recipe, copy)
        made = shown.made
        numbers = self._numbers(made, frames)
        before, images, change = self.before(frames), dict[str, Any](), dict[str, float]()
        for name, view in made.recorded.views.items():
            exact = before[name]["before"]["exact"]
            images[name], change[name] = _images(
                view, self.episode.views[name], frames, numbers, exact
            )
        return {
            "seed": recipe.seed,
            "copy": copy,
            "words": told.draws((one.describe() for one in made.draws), made.repainted),
            "instruction": made.recorded.instruction,
            **shown.verdict(),
            "added": self._added(made, numbers),
            "change": change,
            "warnings": list(made.lacking),
            "images": images,
        }

    def _numbers(self, made: Made, frames: Sequence[int]) -> dict[int, int]:
        """The number that a page's masks have for each instance: recorded ones first, then added ones."""
        known = [row.instance_id for row in self.found[1]]
        seen: set[int] = set()
        for view in made.recorded.views.values():
            if view.ids is not None:
                for t in frames:
                    seen |= set(np.unique(view.ids(t)).tolist())
        added = sorted(added_ids(made) & seen)
        return {one: number for number, one in enumerate((*known, *added), 1) if number < 256}

    def _added(self, made: Made, numbers: Mapping[int, int]) -> list[dict[str, Any]]:
        names = {
            thing["handle"]: f"new: {thing['asset'].replace('_', ' ')}"
            for one in made.draws
            for thing in (one.edit or {}).get("things", ())
        }
        return [
            {"id": one, "name": names.get(one, f"new {one}"), "color": color_of(number, "")}
            for one, number in numbers.items()
            if one in added_ids(made)
        ]


def added_ids(made: Made) -> set[int]:
    """Ids of what edits brought in."""
    return {
        one
        for body in made.scene.bodies
        if body.mesh is not None or body.copy_of
        for one in body.instance_ids
    }


def _asked_of_scene(recipe: Recipe, wanted: plan.Plan) -> str:
    """What of a recipe its scene depends on, in words: recipes of the same words share one."""
    rest = {name: value for name, value in recipe.source.items() if name not in DRAWN}
    moved = any(one.effect & Effect.CAMERA for one in prepare.operators(recipe))
    asked = [wanted.bodies, wanted.lamps, wanted.gaussians, moved and bool(recipe.arms)]
    words = [*map(str, wanted.parts), *(prepare.phrases(recipe) if recipe.models.finds else ())]
    measured = recipe.source.get("edits") if recipe.accuracy else None
    return json.dumps([asked, words, measured, rest])


def _size(view: CameraView) -> dict[str, int]:
    scale = min(1.0, WIDEST / view.camera.width)
    return {"width": round(view.camera.width * scale), "height": round(view.camera.height * scale)}


def _images(
    view: CameraView,
    seen: CameraView,
    frames: Sequence[int],
    numbers: Mapping[int, int],
    exact: bool,
) -> tuple[dict[str, Any], float]:
    """An edited camera's sheets; and its mean change in levels of 255 from what was `seen`, over these frames and all
    pixels. Each frame is drawn once for both."""
    size = _size(view)

    def edited(t: int) -> tuple[np.ndarray, list[float]]:
        image, before = view.rgb(t), seen.rgb(t)
        alike = image.shape == before.shape
        change = [float(cv2.absdiff(image, before).mean())] if alike else []
        return _fitted(image, size, cv2.INTER_AREA), change

    made = list(in_order(partial(edited, t) for t in frames))
    images = {"after": packed([tile for tile, _ in made], exact)}
    if view.depth is not None:
        images["depth"] = packed(tiles(view, "depth", frames))
    if view.ids is not None:
        images["ids"] = packed(tiles(view, "ids", frames, numbers))
    means = [one for _, change in made for one in change]
    return images, round(float(np.mean(means)), 1) if means else 0.0


def smallest(view: CameraView, frames: Sequence[int]) -> dict[str, Any]:
    """A camera's frames exactly, or as JPEG if that is smaller: of what a renderer drew exact ones mostly are."""
    shown = tiles(view, "rgb", frames)
    exact = packed(shown)
    if len(frames) == 1:
        return exact
    return min(exact, packed(shown, exact=False), key=lambda one: len(one["url"]))


def tiles(
    view: CameraView, kind: str, frames: Sequence[int], numbers: Mapping[int, int] | None = None
) -> list[np.ndarray]:
    """The frames of a camera as small as a page shows them: `rgb`, `depth` (white is near), or `ids` by their
    numbers."""
    size = _size(view)

    def tile(t: int) -> np.ndarray:
        if kind == "rgb":
            return _fitted(view.rgb(t), size, cv2.INTER_AREA)
        if kind == "ids":
            assert view.ids is not None
            return _fitted(_numbered(view.ids(t), numbers or {}), size, cv2.INTER_NEAREST)
        assert view.depth is not None
        return _fitted(_gray(view.depth(t)), size, cv2.INTER_NEAREST)

    return list(in_order(partial(tile, t) for t in frames))


def packed(tiles: Sequence[np.ndarray], exact: bool = True) -> dict[str, Any]:
    """Images of one size side by side in one picture.

    One alone is asked for in haste: packing it well would take longer than sending it.
    """
    height, width = tiles[0].shape[:2]
    wide, high = (-(-side // BLOCK) * BLOCK for side in (width, height))
    columns = int(np.ceil(np.sqrt(len(tiles))))
    rows = -(-len(tiles) // columns)
    whole = np.zeros((rows * high, columns * wide, *tiles[0].shape[2:]), np.uint8)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        whole[row * high :, column * wide :][:height, :width] = tile
    pack = partial(png, level=1) if len(tiles) == 1 else webp if exact else jpeg
    return {"url": pack(whole), "columns": columns, "tile": [wide, high], "exact": exact}


def _fitted(image: np.ndarray, size: Mapping[str, int], how: int) -> np.ndarray:
    wanted = size["width"], size["height"]
    if (image.shape[1], image.shape[0]) == wanted:
        return image
    return cv2.resize(image, wanted, interpolation=how)


def _numbered(ids: np.ndarray, numbers: Mapping[int, int]) -> UInt8[np.ndarray, "h w"]:
    out = np.zeros(ids.shape, np.uint8)
    for one in np.unique(ids).tolist():
        out[ids == one] = numbers.get(one, 0)
    return out


def _gray(depth: np.ndarray) -> UInt8[np.ndarray, "h w"]:
    """White at 30 cm, by the inverse of the distance: what is near is told apart. In as many levels as eyes tell."""
    near = np.where(depth > 0, 0.3 / np.maximum(depth, 0.3), 0)
    return (LEVELS * np.rint(255 / LEVELS * near)).astype(np.uint8)
