"""Which instance each pixel of an unmasked episode shows, told by how it moves.

A pixel's point is held against every motion it may follow: rest, the gripper, its fingers, the links of a known arm,
what the gripper carries for a while, and whatever is found to be pushed. What none of them explains bends or moves by
itself, and is told apart by where it is. Labels are the same at all times and in all cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from rpaug.core import geometry
from rpaug.core.sampling import frames
from rpaug.core.types import Camera, CameraView, Episode
from rpaug.scene.instances import regions
from rpaug.scene.instances.hypotheses import STATIC, MotionHypothesis, carried, known
from rpaug.scene.instances.sights import Sights, images, see, step_of
from rpaug.scene.instances.witness import scores
from rpaug.scene.sampled_frames import events

SAMPLED = 14  # frames that points are looked up in, beside those where the gripper opens or closes
ENOUGH = 0.2  # score from which on a motion explains a point
AS_GOOD = 0.08  # scores that differ by less explain alike: rest comes first, then what explains most points
PUSHED = 0.15  # share of the unexplained points that a pushing motion must explain to be taken up
RANKED = 60  # points of one image, at most about, that motions are ranked by
TOO_FEW = 2e-3  # share of the moving points: motions that explain fewer are dropped
ROUNDS = 2  # in which neighbours are averaged
LEVEL = 0.02  # of depth: farther apart are not neighbours
FEWEST = 40  # points
MOST_POINTS = 400  # that pushing motions are tried on
CELLS = 3.0  # pixels wide are the cells in which unexplained points hang together
UNEXPLAINED = -1


@dataclass(frozen=True)
class Segmentation:
    """What was found: motions, whose number + 1 is the instance id, and regions that no motion explains."""

    episode: Episode
    sights: Sights
    motions: tuple[MotionHypothesis, ...]
    leftovers: regions.Regions

    @property
    def names(self) -> dict[int, str]:
        """What each instance id stands for."""
        found = {k + 1: motion.name for k, motion in enumerate(self.motions)}
        first = len(self.motions) + 1
        return found | {first + k: f"unexplained {k + 1}" for k in range(self.leftovers.count)}

    def ids(self, camera: str, t: int) -> Int32[np.ndarray, "h w"]:
        """Handles of one image; 0 where depth is unknown."""
        view = self.episode.views[camera]
        depth, color = images(view, t)
        labels = labelled(self.sights, self.motions, view, t, depth, color)
        instance_ids = np.where(depth > 0, labels + 1, 0).astype(np.int32)
        odd = labels == UNEXPLAINED
        if odd.any():
            points = geometry.world_points(depth, thin(view), t)[odd]
            number = self.leftovers.of(points)
            instance_ids[odd] = np.where(number >= 0, len(self.motions) + 1 + number, STATIC + 1)
        instance_ids = regions.tidied(instance_ids, depth)
        step, full = step_of(view), (view.camera.height, view.camera.width)
        return np.repeat(np.repeat(instance_ids, step, 0), step, 1)[: full[0], : full[1]]


def segment(episode: Episode) -> Segmentation:
    """Look at the episode's fixed cameras and find what moves how. Needs depth in at least one of them."""
    chosen = set(frames(episode.length, SAMPLED))
    if episode.robot.gripper_open is not None:
        chosen |= set(events(episode.robot.gripper_open).tolist())
    sights = see(episode, sorted(chosen))
    motions = known(episode.robot, episode.length)
    motions += _pushed(episode, sights, motions)
    motions = _ranked(episode, sights, motions)
    return Segmentation(episode, sights, motions, _leftovers(episode, sights, motions))


def unmasked(episode: Episode) -> bool:
    """Is this an episode without any masks, with depth in all its views, in which something can be seen to move?

    Nothing is in one of one frame or without a fixed camera.
    """
    views = episode.views.values()
    if any(view.ids for view in views) or not all(view.depth for view in views):
        return False
    return episode.length > 1 and any(view.camera.fixed for view in views)


def masked(episode: Episode) -> Episode:
    """An `unmasked` episode with instance ids, `inferred` so that no writer keeps them; any other as it is."""
    if not unmasked(episode):
        return episode
    views, found = episode.views, segment(episode)
    views = {
        name: replace(view, ids=lru_cache(None)(partial(found.ids, name)), inferred=True)
        for name, view in views.items()
    }
    return replace(episode, views=views)


def labelled(
    sights: Sights,
    motions: Sequence[MotionHypothesis],
    view: CameraView,
    t: int,
    depth: Float32[np.ndarray, "h w"],
    color: Float32[np.ndarray, "h w 3"],
) -> Int[np.ndarray, "h w"]:
    """Number of the motion that explains each pixel, UNEXPLAINED where none does; rest where nothing is known."""
    labels = np.zeros(depth.shape, int)
    look = depth > 0
    if view.camera.fixed:
        look &= ~_at_rest(sights, view, depth, color)
    if not look.any():
        return labels
    points = geometry.world_points(depth, thin(view), t)[look]
    alone = scores(points, color[look], ways(motions, sights, t), sights)
    labels[look] = _best(_together(alone, look, depth))
    return labels


def _together(
    score: Float32[np.ndarray, "n k"],
    look: Bool[np.ndarray, "h w"],
    depth: Float32[np.ndarray, "h w"],
) -> Float32[np.ndarray, "n k"]:
    """Scores averaged over neighbours at about the same depth, twice: what moves is larger than a pixel."""
    image = np.zeros((*look.shape, score.shape[1]), np.float32)
    image[look] = score
    for _ in range(ROUNDS):
        total, count = image.copy(), look.astype(np.float32)
        for rows, columns in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
            near = np.roll(depth, (rows, columns), (0, 1))
            same = (
                look & np.roll(look, (rows, columns), (0, 1)) & (abs(near - depth) < LEVEL * depth)
            )
            total += np.where(same[..., None], np.roll(image, (rows, columns), (0, 1)), 0)
            count += same
        image = total / np.maximum(count, 1)[..., None]
    return image[look]


def ways(
    motions: Sequence[MotionHypothesis], sights: Sights, t: int
) -> Float64[np.ndarray, "k s 4 4"]:
    """How each motion carries a point from frame t to the sampled frames."""
    return np.stack([m.to_world[sights.frames] @ geometry.inverse(m.to_world[t]) for m in motions])


def thin(view: CameraView) -> Camera:
    """The camera of the thinned image."""
    step = step_of(view)
    K = np.diag([1 / step, 1 / step, 1.0]) @ view.camera.K
    size = -(-view.camera.width // step), -(-view.camera.height // step)
    return Camera(K, view.camera.cam_to_world, *size)


def _at_rest(
    sights: Sights,
    view: CameraView,
    depth: Float32[np.ndarray, "h w"],
    color: Float32[np.ndarray, "h w 3"],
) -> Bool[np.ndarray, "h w"]:
    """Pixels whose own camera shows the same there whenever it does not show something nearer: surely static."""
    same = [
        c
        for c, name in enumerate(sights.cameras)
        if np.array_equal(sights.world_to_camera[c], np.linalg.inv(view.camera.cam_to_world[0]))
        and sights.K[c, 0, 0] * step_of(view) == view.camera.K[0, 0]
    ]
    if not same:
        return np.zeros(depth.shape, bool)
    h, w = depth.shape
    near, far = (a[:, same[0], :h, :w] for a in (sights.nearest, sights.farthest))
    dark, light = (a[:, same[0], :h, :w] for a in (sights.darkest, sights.brightest))
    foot = depth / sights.K[same[0], 0, 0]
    through = (near > 0) & (depth < near - foot)
    agrees = (near > 0) & (depth >= near - foot) & (depth <= far + foot)
    off = np.maximum(dark - color, color - light).max(-1)
    return ~through.any(0) & ((agrees & (off < 0.1)).sum(0) >= 0.6 * len(near))


def _best(score: Float32[np.ndarray, "n k"]) -> Int[np.ndarray, "n"]:
    """The first motion that is about as good as the best, UNEXPLAINED if all are poor."""
    label = (score >= score.max(1, keepdims=True) - AS_GOOD).argmax(1)
    top = score[np.arange(len(score)), label]
    # Points that hardly any camera could have seen at other times are left at rest, unless it is refuted.
    poor = (top < ENOUGH) & (score[:, STATIC] < 0)
    unknown = (top < ENOUGH) & ~poor
    return np.where(poor, UNEXPLAINED, np.where(unknown, STATIC, label))


def _ranked(
    episode: Episode, sights: Sights, motions: Sequence[MotionHypothesis]
) -> tuple[MotionHypothesis, ...]:
    """Rest, then each motion that explains most of what those before it left, while they explain enough.

    Neighbouring links of an arm explain alike what lies on their common axis: it all goes to one of them.
    """
    found = []
    for t in sights.frames.tolist():
        for name in sights.cameras:
            view = episode.views[name]
            depth, color = images(view, t)
            moving = (depth > 0) & ~_at_rest(sights, view, depth, color)
            some = np.flatnonzero(moving)[:: max(1, int(moving.sum()) // RANKED)]
            points = geometry.world_points(depth, thin(view), t).reshape(-1, 3)[some]
            colors = color.reshape(-1, 3)[some]
            found.append(scores(points, colors, ways(motions, sights, t), sights))
    score = np.concatenate(found)
    explains = (score >= score.max(1, keepdims=True) - AS_GOOD) & (score >= ENOUGH)
    order, open_rows = [STATIC], ~explains[:, STATIC]
    rest = set(range(1, len(motions)))
    while rest:
        count = {k: int((explains[:, k] & open_rows).sum()) for k in sorted(rest)}
        best = max(count, key=lambda k: count[k])
        if count[best] < TOO_FEW * len(score):
            break
        order.append(best)
        open_rows &= ~explains[:, best]
        rest.remove(best)
    return tuple(motions[k] for k in order)


def _unexplained(
    episode: Episode, sights: Sights, motions: Sequence[MotionHypothesis]
) -> list[tuple[int, Float64[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]]:
    """Frame, points and colors of what no motion explains, in each fixed camera and sampled frame."""
    found = []
    for t in sights.frames.tolist():
        for name in sights.cameras:
            view = episode.views[name]
            depth, color = images(view, t)
            odd = labelled(sights, motions, view, t, depth, color) == UNEXPLAINED
            # Lone pixels are edges, where depth belongs to neither side.
            odd &= cv2.filter2D(odd.astype(np.float32), -1, regions.WINDOW) > 5
            if odd.any():
                points = geometry.world_points(depth, thin(view), t)[odd]
                found.append((t, points, color[odd]))
    return found


def _pushed(
    episode: Episode, sights: Sights, motions: Sequence[MotionHypothesis]
) -> tuple[MotionHypothesis, ...]:
    """Motions of what rests, is pushed along by the gripper for a while without being held, and rests again."""
    gripper = episode.robot.gripper_to_world
    found: list[MotionHypothesis] = []
    if gripper is None or len(sights.frames) < 3:
        return ()
    for _ in range(2):
        odd = _unexplained(episode, sights, [*motions, *found])
        total = sum(len(points) for _, points, _ in odd)
        if total < FEWEST:
            break
        share = min(1.0, MOST_POINTS / total)
        rng = np.random.default_rng(0)
        few = [
            (t, p[keep], c[keep]) for t, p, c in odd if (keep := rng.random(len(p)) < share).any()
        ]
        spans = [(a, b) for a in sights.frames for b in sights.frames if a < b]
        best, explained = _most_explaining(gripper, spans, few, sights)
        near = [
            (a, b)
            for a in range(best[0] - 3, best[0] + 4)
            for b in range(best[1] - 3, best[1] + 4)
            if 0 <= a < b < episode.length
        ]
        best, explained = _most_explaining(gripper, near, few, sights)
        if explained < PUSHED:
            break
        found.append(MotionHypothesis(f"pushed from {best[0]}", carried(gripper, *best)))
    return tuple(found)


def _most_explaining(
    gripper: Float64[np.ndarray, "t 4 4"],
    spans: Sequence[tuple[int, int]],
    odd: Sequence[tuple[int, Float64[np.ndarray, "n 3"], Float32[np.ndarray, "n 3"]]],
    sights: Sights,
) -> tuple[tuple[int, int], float]:
    """The span in which being carried by the gripper explains most points, and their share."""
    trial = [MotionHypothesis("", carried(gripper, a, b)) for a, b in spans]
    total, count = np.zeros(len(trial)), 0
    for t, points, colors in odd:
        found = scores(points, colors, ways(trial, sights, t), sights)
        total += np.where(found >= ENOUGH, found, 0).sum(0)
        count += len(points)
    best = int(total.argmax())
    return spans[best], float(total[best]) / count


def _leftovers(
    episode: Episode, sights: Sights, motions: Sequence[MotionHypothesis]
) -> regions.Regions:
    """Where in space, over all sampled times, is what no motion explains."""
    odd = _unexplained(episode, sights, motions)
    if not odd:
        return regions.Regions(1.0, np.zeros(0, int), np.zeros(0, int))
    points = np.concatenate([p for _, p, _ in odd])
    foot = [
        np.linalg.norm(points - np.linalg.inv(sights.world_to_camera[c])[:3, 3], axis=1).mean()
        / sights.K[c, 0, 0]
        for c in range(len(sights.cameras))
    ]
    return regions.connected(points, CELLS * float(min(foot)), FEWEST)
