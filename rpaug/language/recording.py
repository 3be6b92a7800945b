"""The recorded scene that a wish is about: what it holds, what earlier edits draw, whether an answer holds."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64, UInt8

from rpaug.core import color_space, geometry
from rpaug.core.errors import TargetError, Unsupported
from rpaug.core.files import encode_png
from rpaug.core.pixels import grown
from rpaug.core.types import Scene
from rpaug.language import declared
from rpaug.language.messages import Answer, Entry, Trace
from rpaug.pipeline import copies, prepare
from rpaug.pipeline import recipe as recipes
from rpaug.scene.lighting import albedo
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import places, targets
from rpaug.scene.targets.survey import survey

WIDE = 640  # pixels that a numbered picture is enlarged to at least
INK, PAPER = (255, 255, 255), (0, 0, 0)


@dataclass(frozen=True)
class Recording:
    """What a wish can be held against. `build` is called when it is first needed, and once."""

    build: Callable[[], Scene]

    @cached_property
    def scene(self) -> Scene:
        return self.build()

    @cached_property
    def inventory(self) -> list[dict[str, Any]]:
        """Every instance in measured facts; `at_m` is its middle in the world.

        No words out of the recording stand in it, so it cannot ask for anything.
        """
        scene = self.scene
        rows = survey(scene.episode, scene.bodies, scene.roles)
        sampled = look(scene.episode)
        groups = [frozenset([row.instance_id]) for row in rows]
        at = places.places(scene, sampled, groups) if sampled.cameras else {}
        frame = places.robot_frame(scene, sampled)
        foot = -frame[:3, 3] @ frame[:3, :3]
        found = []
        for row, group in zip(rows, groups, strict=True):
            facts: dict[str, Any] = {"id": row.instance_id, "color": row.color_name}
            facts |= {"rgb": color_space.to_hex(row.color)}
            shown = albedo.words(scene.episode, row.instance_id) if row.role != "robot" else ()
            facts |= {"shows": list(shown)} if len(shown) > 1 else {}
            facts |= {"role": row.role} if row.role else {}
            facts |= {"size_cm": _whole(row.size_cm)} if any(row.size_cm) else {}
            facts |= (
                {"at_m": _metres(at[group].middle @ frame[:3, :3] + foot)} if group in at else {}
            )
            facts |= {"moves": True} if row.moving else {}
            end = self._end(row.instance_id) if row.moving and row.role != "robot" else None
            if end is not None and group in at:
                there = at[group].middle @ frame[:3, :3] + foot
                facts["ends_at_m"] = _metres(geometry.transform(end, there))
            facts |= {"moves_with": sorted(row.body - group)} if len(row.body) > 1 else {}
            found.append(facts | {"cameras": sorted(k for k, n in row.pixels.items() if n)})
        return found

    def _end(self, instance_id: int) -> Float64[np.ndarray, "4 4"] | None:
        """The motion in the world from the first frame to the last."""
        body = next((one for one in self.scene.bodies if instance_id in one.instance_ids), None)
        if body is None:
            return None
        return np.asarray(body.to_world[-1] @ geometry.inverse(body.to_world[0]))

    @cached_property
    def axes(self) -> dict[str, Any]:
        """In the world: where the robot's foot is, what is ahead of it and to its left, where cameras are and look."""
        frame = places.robot_frame(self.scene, look(self.scene.episode))
        views = {
            name: view.camera.cam_to_world[0] for name, view in self.scene.episode.views.items()
        }
        return {
            "robot_at_m": _metres(-frame[:3, 3] @ frame[:3, :3]),
            "ahead": _metres(frame[0, :3]),
            "left": _metres(frame[1, :3]),
            "views": {
                name: {"at_m": _metres(pose[:3, 3]), "looks": _metres(pose[:3, 2])}
                for name, pose in views.items()
            },
        }

    def drawn(self, earlier: Answer) -> list[dict[str, Any]]:
        """What the first copy draws for each earlier edit, so that "darker" has something to be darker than."""
        made = recipes.build(earlier.recipe(), name="the talk so far")
        _, draws = copies.draw(self.scene, made, 1)
        return [_told(draw) for draw in draws]

    def picture(self) -> bytes:
        """A PNG of the view that shows most instances at the first frame, each outlined, its id on it."""
        views = {k: v for k, v in self.scene.episode.views.items() if v.ids}
        if not views:
            raise Unsupported("a picture with numbers: this recording has no masks")
        view = max(views.values(), key=lambda one: len(np.unique(one.ids(0))))  # type: ignore[misc]
        assert view.ids is not None
        return encode_png(_numbered(view.rgb(0), view.ids(0), self.scene.instance_ids))

    def check(self, answer: Answer) -> None:
        """See that every edit can be drawn on this scene. Raises RpaugError with what is amiss."""
        steps = recipes.build(answer.recipe(), name="the wish").steps
        for number, step in enumerate(steps):
            for option in step.options:
                if option.operator.needs.gaussians:  # fitted only when the recipe runs
                    continue
                try:
                    prepare.see_possible(self.scene, steps[:number], option)
                except TargetError:
                    raise
                except Unsupported as error:
                    raise Unsupported(f"{option.name}: {error}") from None

    def ground(self, answer: Answer) -> Iterator[Trace]:
        """Every target and the things it is told by, found in the scene. Raises RpaugError."""
        for value in _targets(answer.edits):
            found = {}
            for phrase in declared.phrases(value):
                every = targets.Target(text=phrase, all=True)
                found[phrase] = sorted(targets.find(self.scene, every))
            whole = targets.Target.model_validate(value)
            found[str(whole)] = sorted(targets.find(self.scene, whole))
            yield Trace(stage="grounding", by="scene", input=value, output=found)


def _targets(edits: tuple[Entry, ...]) -> Iterator[Any]:
    """Each target once. What an edit before brings along is not looked for: it was never recorded."""
    seen = []
    for edit in edits:
        for one in edit.get("one_of", [edit]):
            for value in (*declared.targets(one), *declared.anchors(one)):
                if value not in seen:
                    seen.append(value)
                    yield value


def _told(draw: copies.Draw) -> dict[str, Any]:
    """A draw without what is measured of surfaces, which no wish speaks of."""
    if draw.option is None or draw.edit is None:
        return {"left_out": draw.left_out or "not drawn in the first copy"}
    told: Mapping[str, Any] = {k: v for k, v in draw.edit.items() if _short(v)}
    return {"op": draw.option.name, **told}


def _short(value: Any) -> bool:
    return len(str(value)) <= 60


def _metres(lengths: Iterable[float]) -> list[float]:
    return [round(float(one), 2) + 0.0 for one in lengths]


def _whole(lengths: Iterable[float]) -> list[int]:
    return [round(float(one)) for one in lengths]


def _numbered(
    rgb: UInt8[np.ndarray, "h w 3"], ids: Any, known: frozenset[int]
) -> UInt8[np.ndarray, "h2 w2 3"]:
    """The image enlarged, outlines drawn around the known instances and their ids written on their middles."""
    factor = max(1, -(-WIDE // rgb.shape[1]))
    size = rgb.shape[1] * factor, rgb.shape[0] * factor
    image = cv2.resize(rgb, size, interpolation=cv2.INTER_NEAREST)
    large = cv2.resize(ids.astype(np.int32), size, interpolation=cv2.INTER_NEAREST)
    there = [one for one in np.unique(ids).tolist() if one in known]
    for one in there:
        inside = large == one
        image[inside & grown(~inside, 1)] = INK
    for one in there:
        depth = cv2.distanceTransform((large == one).astype(np.uint8), cv2.DIST_L2, 3)
        y, x = np.unravel_index(int(depth.argmax()), depth.shape)
        for color, thick in ((PAPER, 3), (INK, 1)):
            foot = int(x) - 6, int(y) + 5
            cv2.putText(image, str(one), foot, cv2.FONT_HERSHEY_SIMPLEX, 0.45, color, thick)
    return image
