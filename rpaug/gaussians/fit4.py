"""Fit Gaussians in space and time to the instances that rigid motion leaves unexplained, and to those alone."""

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rpaug.core.errors import Unsupported
from rpaug.core.metrics import FITTED_ERROR, psnr
from rpaug.core.sampling import frames
from rpaug.core.types import Body, Gaussians, Gaussians4, Scene
from rpaug.gaussians import gaussian_view, seeds4
from rpaug.gaussians.descent4 import Crop, Descent4
from rpaug.gaussians.flowing import seen_by, some
from rpaug.gaussians.gaussians import LiftedImage, chosen, joined, lifted, placed
from rpaug.render.splat import Rasteriser, Splats, View
from rpaug.render.zbuffer import SAME_SURFACE
from rpaug.scene.recorded.plates import plate

Progress = Callable[[float], None]
FAR_OFF = 2.0  # widths of a pixel
GAIN = 0.5  # decibels that an instance must gain to be shown in space and time
COVERED = 0.7  # of the light stopped: less is a hole
UNLIKE = 0.08  # difference in display color that shows something else there


@dataclass(frozen=True, kw_only=True)
class FourSettings:
    """What is fitted in four dimensions, and how.

    An instance stays rigid if it is shown with `target_db` of PSNR on its own pixels, over times that were not fitted,
    or if no more than `off_share` of them are off in depth. A fit goes `rounds` times over all fitted frames.
    """

    target_db: float = 28.0
    off_share: float = 0.15
    least_pixels: int = 60  # in the view that shows most of it: smaller instances stay rigid
    rounds: int = 20
    train_frames: int = 40  # as of the rigid fit, so that the same times are held out
    checked_frames: int = 12
    densify_rounds: tuple[int, ...] = (8,)
    densify_share: float = 0.05
    last_rate: float = 0.05
    margin: int = 6  # pixels around the region that are looked at with it
    bridged_share: float = 0.5  # of the steps that are followed by one of the ways alone
    backend: str = "auto"  # one of `render.splat.engines`, for the descent


@dataclass(frozen=True)
class FourReport:
    """What was fitted in four dimensions and how well: decibels of PSNR on its own pixels (up), by instance id.

    `rigid_db` and `db` are over times that were not fitted, where there are such; `gaussians` counts those in 4D.
    """

    instance_ids: tuple[int, ...]
    rigid_db: Mapping[int, float]
    db: Mapping[int, float]
    gaussians: int
    frames: int
    seconds: float
    reason: str = ""

    def describe(self) -> dict[str, Any]:
        """Plain values; instance ids as text where they are keys."""
        by_instance_id = {
            name: {
                str(instance_id): round(db, 2) for instance_id, db in getattr(self, name).items()
            }
            for name in ("rigid_db", "db")
        }
        facts = vars(self) | by_instance_id
        return {"handles": list(facts.pop("instance_ids")), **facts}


def fitted(
    scene: Scene,
    *,
    settings: FourSettings | None = None,
    instance_ids: frozenset[int] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Scene, FourReport]:
    """A scene with rigid Gaussians, those of its badly explained instances replaced by 4D ones; the rest untouched.

    `instance_ids` names the instances instead of the residual. Nothing is fitted, and the report says why, where every
    instance meets the target or there is one frame only. Raises Unsupported if the scene has no Gaussians.
    """
    settings, start = settings or FourSettings(), time.perf_counter()
    if scene.gaussians is None:
        raise Unsupported("4D Gaussians take over from rigid ones: this scene has none (--tier 3)")
    length = scene.episode.length
    trained = frames(length, settings.train_frames)
    if len(trained) == length > 2:
        trained = trained[::2]  # some times must be left to judge by
    if len(trained) < 2:
        reason = f"{length} frame: motion needs two or more"
        return scene, FourReport((), {}, {}, 0, length, 0.0, reason)
    checked = _checked(length, trained, settings.checked_frames)
    rigid = residuals(scene, checked, settings.least_pixels)
    if instance_ids is None:
        instance_ids = unexplained(scene, rigid, settings)
    if not instance_ids:
        reason = f"every moving instance is rigid, or shown with {settings.target_db:.0f} dB"
        seconds = time.perf_counter() - start
        return scene, FourReport((), _db(rigid), {}, 0, length, seconds, reason)
    rest = without(scene, instance_ids)
    crops = {
        t: found for t in trained if (found := list(_crops(rest, instance_ids, t, settings.margin)))
    }
    begun = seeds4.seeds(scene, instance_ids, sorted(crops))
    fitted4 = _descended(begun, crops, length / len(trained), settings, seed, progress)
    made = replace(rest, flowing=fitted4)
    after = residuals(made, checked, settings.least_pixels)
    better = frozenset(h for h in instance_ids if gain(rigid, after, h) > GAIN)
    if better != instance_ids:
        # Going back costs nothing: what time does not explain either stays rigid.
        keep = np.isin(fitted4.ids, list(better))
        made = replace(without(scene, better), flowing=some(fitted4, keep))
        after |= {h: rigid[h] for h in instance_ids - better}
        instance_ids = better
    return made, FourReport(
        instance_ids=tuple(sorted(instance_ids)),
        rigid_db=_db(rigid),
        db=_db(after),
        gaussians=len(made.flowing or ()),
        frames=len(crops),
        seconds=time.perf_counter() - start,
        reason="" if instance_ids else "nothing is shown better in space and time",
    )


def _descended(
    begun: Gaussians4,
    crops: Mapping[int, list[Crop]],
    stride: float,
    settings: FourSettings,
    seed: int,
    progress: Progress | None,
) -> Gaussians4:
    """The Gaussians after all rounds over the fitted times, which are `stride` frames apart."""
    descent = Descent4(begun, float(np.median(begun.scales)), backend=settings.backend)
    rng = np.random.default_rng(seed)
    times = sorted(crops)
    for number in range(settings.rounds):
        if number in settings.densify_rounds:
            descent.densify(settings.densify_share)
        for k, t in enumerate(rng.permutation(times).tolist()):
            done = (number + k / len(times)) / settings.rounds
            factor = _cosine(done, settings.last_rate)
            descent.step(crops[t], factor)
            if rng.random() < settings.bridged_share:
                descent.bridge(crops[t], stride, factor)
            if progress:
                progress(done)
    return descent.gaussians


@dataclass(frozen=True)
class InstanceError:
    """How an instance is shown on its own recorded pixels: decibels of PSNR (up), and the share of its pixels whose
    depth is off by more than `FAR_OFF` pixel widths (down)."""

    db: float
    off: float


def residuals(
    scene: Scene,
    times: Sequence[int],
    least: int = 1,
    cameras: Collection[str] | None = None,
) -> dict[int, InstanceError]:
    """The residual of each instance, all cameras (or the named ones) and the given times together.

    Instances that no view shows with `least` pixels or more are left out.
    """
    sums: dict[int, np.ndarray] = {}
    shown: set[int] = set()
    for name, view in scene.episode.views.items():
        if view.ids is None or view.depth is None or (cameras is not None and name not in cameras):
            continue
        for t in times:
            image, depth, _ = gaussian_view.render_view(scene, name, t)
            error = ((image.astype(float) - view.rgb(t)) ** 2).mean(-1)
            recorded, ids = view.depth(t), view.ids(t)
            off = np.abs(depth - recorded) > FAR_OFF * recorded / view.camera.K[0, 0]
            for instance_id in np.unique(ids).tolist():
                mine = ids == instance_id
                found = np.array([error[mine].sum(), off[mine].sum(), mine.sum()])
                sums[instance_id] = sums.get(instance_id, np.zeros(3)) + found
                if mine.sum() >= least:
                    shown.add(instance_id)
    out = {}
    for instance_id in sorted(shown - {0}):
        error, off, count = sums[instance_id]
        db = psnr(error / count, FITTED_ERROR)
        out[instance_id] = InstanceError(db, float(off / count))
    return out


def unexplained(
    scene: Scene, residual: Mapping[int, InstanceError], settings: FourSettings
) -> frozenset[int]:
    """Instances that are shown below the target, and are not where their rigid motion has them.

    What hangs on the gripper or is a link of the arm is rigid whatever its residual. What bends about a fixed foot is
    taken for static as a whole: then more of it must be off, since thin things at rest are off at their outlines.
    """
    motion = {
        instance_id: body.motion for body in scene.bodies for instance_id in body.instance_ids
    }
    least = {"aligned": 1.0, "unknown": 1.0, "static": 2.0}
    return frozenset(
        instance_id
        for instance_id, found in residual.items()
        if found.db < settings.target_db
        and motion.get(instance_id) in least
        and found.off > least[motion[instance_id]] * settings.off_share
    )


def gain(
    before: Mapping[int, InstanceError], after: Mapping[int, InstanceError], instance_id: int
) -> float:
    """Decibels won by an instance; endless for one that was not or is not measured."""
    if instance_id not in before or instance_id not in after:
        return float("inf")
    return after[instance_id].db - before[instance_id].db


def _db(residual: Mapping[int, InstanceError]) -> dict[int, float]:
    return {instance_id: found.db for instance_id, found in residual.items()}


def without(scene: Scene, instance_ids: frozenset[int]) -> Scene:
    """The scene less the rigid Gaussians of some instances, whose bodies stand still from now on."""
    assert scene.gaussians is not None
    still = np.tile(np.eye(4), (scene.episode.length, 1, 1))
    bodies: list[Body] = []
    for body in scene.bodies:
        stay, go = body.instance_ids - instance_ids, body.instance_ids & instance_ids
        if stay:
            bodies.append(replace(body, instance_ids=stay))
        if go:
            # Their frame is the world: what bends has none of its own.
            bodies.append(Body(go, still, "unknown", residual=body.residual, ambiguous=True))
    kept = chosen(scene.gaussians, ~np.isin(scene.gaussians.ids, list(instance_ids)))
    rest = replace(scene, gaussians=kept, bodies=tuple(bodies))
    resting = {h for body in scene.bodies if body.motion == "static" for h in body.instance_ids}
    if not instance_ids & resting:
        return rest
    # What was taken for static hid what is behind it, which nothing was seeded on.
    behind = list(_behind(rest, frozenset(resting - instance_ids)))
    return replace(rest, gaussians=joined([kept, *behind])) if behind else rest


def _behind(scene: Scene, static: frozenset[int]) -> Iterator[Gaussians]:
    """Static surfaces that fixed cameras saw at some time, where no Gaussian shows any."""
    assert scene.gaussians is not None
    resting = chosen(scene.gaussians, np.isin(scene.gaussians.ids, list(static)))
    engine = Rasteriser(gaussian_view.sharp(Splats.of(resting)))
    for name, view in scene.episode.views.items():
        if not view.camera.fixed or view.depth is None or view.ids is None:
            continue
        seen = plate(view, scene.episode.length, static, 0.0, SAME_SURFACE)
        whole = gaussian_view.view_of(gaussian_view.standing(scene, name), 0)
        bare = engine.forward(seen_by(resting, whole), whole, surface=False).alpha < COVERED
        pose = gaussian_view.standing(scene, name).cam_to_world[0]
        more = lifted(
            LiftedImage(seen.rgb, seen.depth, seen.ids, view.camera.K, pose, seen.known & bare)
        )
        if len(more):
            resting = joined([resting, more])
            yield more


def _crops(scene: Scene, instance_ids: frozenset[int], t: int, margin: int) -> Iterator[Crop]:
    """The region in every view that shows it at t."""
    rest = placed(scene, t)
    engine = Rasteriser(gaussian_view.sharp(Splats.of(rest)))
    for name, view in scene.episode.views.items():
        if view.ids is None or view.depth is None:
            continue
        inside = np.isin(view.ids(t), list(instance_ids))
        if not inside.any():
            continue
        rows, columns = np.nonzero(inside)
        top, left = max(rows.min() - margin, 0), max(columns.min() - margin, 0)
        window = np.s_[top : rows.max() + margin + 1, left : columns.max() + margin + 1]
        inside = inside[window]
        eye = gaussian_view.standing(scene, name)
        whole = gaussian_view.view_of(eye, t)
        K = whole.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        cut = View(K, whole.world_to_camera, inside.shape[1], inside.shape[0])
        near = seen_by(rest, cut)
        alone = engine.forward(near, cut, surface=False).color
        recorded = view.rgb(t)[window].astype(np.float32) / 255
        depth = np.nan_to_num(view.depth(t)[window], nan=0.0, posinf=0.0, neginf=0.0)
        unlike = np.abs(recorded - alone).max(-1) > UNLIKE
        hiding = ~inside & unlike & (depth < depth[inside].max(initial=0.0))
        yield Crop(
            name, t, cut,
            np.where(inside[..., None], recorded, alone).astype(np.float32),
            np.where(inside, depth, 0).astype(np.float32), (~hiding).astype(np.float32), near,
        )  # fmt: skip


def _checked(length: int, trained: Sequence[int], most: int) -> list[int]:
    """Times that are not fitted, or fitted ones where there are no others."""
    others = sorted(set(range(length)) - set(trained)) or list(trained)
    return [others[i] for i in frames(len(others), most)]


def _cosine(done: float, last: float) -> float:
    """From 1 to `last` as `done` goes from 0 to 1 (Loshchilov and Hutter 2017)."""
    return float(last + (1 - last) * 0.5 * (1 + np.cos(np.pi * done)))
