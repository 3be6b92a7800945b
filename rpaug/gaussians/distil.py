"""A part that is finer than the masks, told apart from the instance that it belongs to.

Incremental Semantic Distillation (RoboPearls, arXiv 2506.22756): draw the mask of what was retrieved and compare it
with a detector's box; if it caught more than was asked for, prompt a segmenter with the box, and fine-tune what the
retrieved Gaussians, and only they, are told by. Nothing else of the scene changes, bit for bit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64, Int

from rpaug.core import geometry
from rpaug.core.errors import TargetError
from rpaug.core.instance_ids import free
from rpaug.core.sampling import frames
from rpaug.core.types import Body, Scene
from rpaug.gaussians.encoding import Identities, Learning, descend, learn, neighbours
from rpaug.gaussians.gaussian_view import plane_depth, standing
from rpaug.gaussians.labels import UNKNOWN, Labelled, LabelRenderer
from rpaug.gaussians.vote import ballots
from rpaug.providers.detect import Detector
from rpaug.providers.segment import Box, GrabCut, Segmenter, whole_pixels

AGREES = 0.5  # overlap (IoU) of the retrieved mask's box with the prompt's, from which nothing finer is needed
MARGIN = 0.12  # of a carried box's sides, added on each side, beside one pixel
SAME_DEPTH = (0.01, 0.01)  # metres, and share of the depth: what a view shows is the point itself
VISIBLE = 0.6  # share of the part's points that a view must show to be asked
HELD = 0.6  # share of the part's points that the segmenter's mask must hold to be believed
TIMES = 4  # frames of each camera that are asked
FINE_TUNING = Learning(steps=60, rate=0.1, smoothness=0.02)


@dataclass(frozen=True)
class PartPrompt:
    """Where the part is: a box (left, top, right, bottom in pixels) in one image, a user's or a detector's."""

    camera: str
    t: int
    box: Box


@dataclass(frozen=True)
class Told:
    """The scene in which the part has an instance id of its own, and what it was told by.

    `finer` is False where the retrieved mask already agreed with the box: then `instance_id` is the instance's own and
    the scene is unchanged. `rows` are the part's Gaussians.
    """

    scene: Scene
    instance_id: int
    finer: bool
    rows: Int[np.ndarray, "m"]
    pictures: tuple[Labelled, ...] = ()
    identities: Identities | None = None


def tell_apart(
    scene: Scene,
    whole: frozenset[int],
    prompt: PartPrompt,
    segmenter: Segmenter | None = None,
    *,
    instance_id: int | None = None,
    by: Literal["vote", "encodings"] = "vote",
    identities: Identities | None = None,
    seed: int = 0,
) -> Told:
    """Give the part of `whole` that the prompt's box holds an instance id of its own (default: the next free one).

    The box is carried to other cameras and times by the surface points that the segmenter finds in it, and each
    view's mask takes part. `by` says what is fine-tuned: the weighted vote of these masks among the Gaussians
    of `whole`, or their learned encodings (`identities`; learned from the recorded masks if not given) with one
    new row of the head. Raises TargetError if the box shows nothing of `whole` or nothing stands out in it, or if
    `whole` is not one rigid body; Unsupported without Gaussians.
    """
    stage = LabelRenderer(scene)
    assert scene.gaussians is not None
    body, number = _body(scene, whole), min(whole)
    retrieved = np.isin(scene.gaussians.ids, list(whole))
    shown = _shown(stage, retrieved, prompt.camera, prompt.t)
    if overlap(_bounds(shown), prompt.box) >= AGREES:
        return Told(scene, number, False, np.flatnonzero(retrieved))
    segmenter = segmenter or GrabCut()
    fresh = free(scene, 1)[0] if instance_id is None else instance_id
    if fresh in scene.instance_ids:
        raise TargetError(f"instance id {fresh} is taken; {free(scene, 1)[0]} is free")
    masks = _masks(scene, stage, retrieved, body, prompt, segmenter)
    pictures = tuple(
        Labelled(name, t, np.where(part, fresh, np.where(seen, number, UNKNOWN)).astype(np.int32))
        for name, t, part, seen in masks
    )
    rows = np.flatnonzero(retrieved)
    if by == "vote":
        chosen = _voted(scene, stage, pictures, fresh)[rows]
    else:
        identities = identities or learn(scene, seed=seed, stage=stage)
        identities = finer(scene, stage, identities, pictures, rows, number, fresh, seed=seed)
        chosen = identities.ids[rows] == fresh
    if not chosen.any():
        raise TargetError("no Gaussian belongs to what the box shows: is the box on the instance?")
    made = renamed(scene, rows[chosen], whole, fresh)
    return Told(made, fresh, True, rows[chosen], pictures, identities)


def finer(
    scene: Scene,
    stage: LabelRenderer,
    identities: Identities,
    pictures: Sequence[Labelled],
    rows: Int[np.ndarray, "m"],
    whole: int,
    part: int,
    *,
    settings: Learning = FINE_TUNING,
    seed: int = 0,
) -> Identities:
    """Encodings of `rows` fine-tuned with one new row of the head, which begins near the whole's.

    All other encodings and rows of the head come back bit for bit.
    """
    assert scene.gaussians is not None
    like = int(np.flatnonzero(identities.instance_ids == whole)[0])
    rng = np.random.default_rng(seed)
    order = np.argsort(np.append(identities.instance_ids, part), kind="stable")
    spread = float(identities.weight.std())  # the part must be tellable, as other instance ids are
    nudge = rng.normal(0, spread, size=identities.weight.shape[1:]).astype(np.float32)
    begun = Identities(
        identities.encodings,
        np.concatenate([identities.weight, (identities.weight[like] + nudge)[None]])[order],
        np.append(identities.offset, identities.offset[like])[order],
        np.append(identities.instance_ids, part).astype(np.int32)[order],
    )
    head = begun.instance_ids == part
    near = neighbours(scene.gaussians.means, settings.neighbours)
    return descend(begun, pictures, stage, near, settings=settings, rng=rng, rows=rows, head=head)


def renamed(
    scene: Scene, rows: Int[np.ndarray, "m"], whole: frozenset[int], instance_id: int
) -> Scene:
    """The scene whose Gaussians `rows` have the instance id `instance_id`, which moves with `whole` and shares its
    role.
    """
    assert scene.gaussians is not None
    ids = scene.gaussians.ids.copy()
    ids[rows] = instance_id

    def joined(bodies: tuple[Body, ...]) -> tuple[Body, ...]:
        return tuple(
            replace(body, instance_ids=body.instance_ids | {instance_id})
            if whole <= body.instance_ids
            else body
            for body in bodies
        )

    recorded = scene.recorded_bodies
    return replace(
        scene,
        gaussians=replace(scene.gaussians, ids=ids),
        bodies=joined(scene.bodies),
        recorded_bodies=None if recorded is None else joined(recorded),
        roles={
            name: found | {instance_id} if whole <= found else found
            for name, found in scene.roles.items()
        },
    )


def overlap(a: Box | None, b: Box) -> float:
    """Intersection over union of two boxes; 0 if there is no first one."""
    if a is None:
        return 0.0
    wide = min(a[2], b[2]) - max(a[0], b[0]) + 1
    high = min(a[3], b[3]) - max(a[1], b[1]) + 1
    both = max(wide, 0.0) * max(high, 0.0)
    areas = sum((box[2] - box[0] + 1) * (box[3] - box[1] + 1) for box in (a, b))
    return both / (areas - both)


def detected(
    scene: Scene, whole: frozenset[int], words: str, detector: Detector, camera: str, t: int
) -> PartPrompt:
    """A prompt from a detector: its surest box most of which lies on `whole`. Raises TargetError if there is none."""
    assert scene.gaussians is not None
    shown = _shown(LabelRenderer(scene), np.isin(scene.gaussians.ids, list(whole)), camera, t)
    for found in detector(scene.episode.views[camera].rgb(t), words):
        left, top, right, bottom = whole_pixels(found.box, shown.shape[1], shown.shape[0])
        inside = shown[top:bottom, left:right]
        if inside.size and inside.mean() > 0.5:
            return PartPrompt(camera, t, found.box)
    raise TargetError(
        f"the detector finds no {words!r} on the target in camera {camera} at frame {t}"
    )


def _body(scene: Scene, whole: frozenset[int]) -> Body:
    for body in scene.bodies:
        if whole and whole <= body.instance_ids:
            return body
    raise TargetError(f"instances {sorted(whole)} are not one rigid body: a part belongs to one")


def _shown(
    stage: LabelRenderer, retrieved: Bool[np.ndarray, "n"], camera: str, t: int
) -> Bool[np.ndarray, "h w"]:
    """Where most of a pixel's light comes from the retrieved Gaussians."""
    drawn = stage.draw(camera, t, retrieved[:, None].astype(np.float32).repeat(16, 1))
    assert drawn.features is not None
    return np.asarray(drawn.features[..., 0] > 0.5)


def _bounds(mask: Bool[np.ndarray, "h w"]) -> Box | None:
    if not mask.any():
        return None
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return float(columns[0]), float(rows[0]), float(columns[-1]), float(rows[-1])


def _masks(
    scene: Scene,
    stage: LabelRenderer,
    retrieved: Bool[np.ndarray, "n"],
    body: Body,
    prompt: PartPrompt,
    segmenter: Segmenter,
) -> Iterator[tuple[str, int, Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]]:
    """Camera, frame, mask of the part and mask of the whole: of the prompted view, then of all that show the part."""
    first, seen = _ask(scene, stage, retrieved, segmenter, prompt)
    if not first.any():
        raise TargetError(
            f"box {tuple(round(edge) for edge in prompt.box)} of camera {prompt.camera} at frame {prompt.t}: "
            "nothing of the target stands out in it"
        )
    yield prompt.camera, prompt.t, first, seen
    depth = _depth(scene, stage, retrieved, prompt.camera, prompt.t)
    eye = standing(scene, prompt.camera)
    at = geometry.world_points(depth.astype(np.float64), eye, prompt.t)[first & (depth > 0)]
    points = geometry.transform(geometry.inverse(body.to_world[prompt.t]), at)
    for t in sorted({prompt.t, *frames(scene.episode.length, TIMES)}):
        for name in scene.episode.views:
            if (name, t) == (prompt.camera, prompt.t):
                continue
            depth = _depth(scene, stage, retrieved, name, t)
            found = _carried(scene, name, t, geometry.transform(body.to_world[t], points), depth)
            if found is None:
                continue
            box, pixels = found
            part, seen = _ask(scene, stage, retrieved, segmenter, PartPrompt(name, t, box))
            if part[pixels[:, 1], pixels[:, 0]].mean() > HELD:
                yield name, t, part, seen


def _ask(
    scene: Scene,
    stage: LabelRenderer,
    retrieved: Bool[np.ndarray, "n"],
    segmenter: Segmenter,
    prompt: PartPrompt,
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The segmenter's mask of one box, inside what shows the retrieved Gaussians, and the mask of those."""
    seen = _shown(stage, retrieved, prompt.camera, prompt.t)
    image = scene.episode.views[prompt.camera].rgb(prompt.t)
    height, width = seen.shape
    left, top, right, bottom = whole_pixels(prompt.box, width, height)
    if not seen[top:bottom, left:right].any():
        return np.zeros_like(seen), seen
    return segmenter(image, prompt.box, seen) & seen, seen


def _depth(
    scene: Scene, stage: LabelRenderer, retrieved: Bool[np.ndarray, "n"], camera: str, t: int
) -> np.ndarray:
    """Recorded depth, or that of the Gaussians where none was recorded."""
    view = scene.episode.views[camera]
    if view.depth is not None:
        return np.nan_to_num(view.depth(t), posinf=0.0, neginf=0.0)
    blank = np.zeros((len(retrieved), 16), np.float32)
    drawn = stage.draw(camera, t, blank, surface=True)
    return plane_depth(drawn, stage.placed(camera, t), standing(scene, camera), t)


def _carried(
    scene: Scene,
    camera: str,
    t: int,
    points: Float64[np.ndarray, "m 3"],
    depth: np.ndarray,
) -> tuple[Box, Int[np.ndarray, "k 2"]] | None:
    """A box around the part's points in another view and the pixels of those it shows; None if it shows too few."""
    eye = standing(scene, camera)
    at, z = geometry.project(points, eye, t)
    pixel = np.rint(at).astype(int)
    inside = (z > 0) & (pixel >= 0).all(-1) & (pixel < (eye.width, eye.height)).all(-1)
    column, row = np.where(inside[:, None], pixel, 0).T
    near = np.abs(depth[row, column] - z) < SAME_DEPTH[0] + SAME_DEPTH[1] * np.abs(z)
    visible = inside & near
    if not len(points) or visible.mean() < VISIBLE:
        return None
    low, high = at[inside].min(0), at[inside].max(0)
    room = 1 + MARGIN * (high - low)
    left, top = (low - room).tolist()
    right, bottom = (high + room).tolist()
    return (left, top, right, bottom), pixel[visible]


def _voted(
    scene: Scene, stage: LabelRenderer, pictures: Sequence[Labelled], part: int
) -> Bool[np.ndarray, "n"]:
    """Gaussians on which more of the part's mask falls than of the rest."""
    labels, count = ballots(scene, pictures, stage)
    mine = labels == part
    return count[:, mine].sum(-1) > count[:, ~mine].sum(-1)
