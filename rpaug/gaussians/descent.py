"""The descent of a fit: Gaussians, tracks and camera poses, stepped together."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float32, Float64

from rpaug.core import devices, geometry
from rpaug.core.types import Body, Camera, Episode, Gaussians, Scene
from rpaug.gaussians.gaussian_view import sharp
from rpaug.gaussians.gaussians import Placement, moved, quaternions
from rpaug.gaussians.refine import CAMERA_STEP, Twists, about, corrected, twist_of
from rpaug.gaussians.stops import Kind, Stop
from rpaug.render.splat import Adam, Gradients, Rates, SplatEngine, Splats, View, cores, engine
from rpaug.scene.lighting.irradiance import Learner
from rpaug.scene.tracking import calibration

FIDELITY_STEPS = 1000  # before moments, which do the rest
PARAMETERS = ("means", "opacities", "sh", "quats", "scales")


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """How a fit is done. One of the `steps` looks at `batch` views; results do not depend on `threads`.

    `backend` is one of `render.splat.engines`: what draws and pulls, and to a part of a decibel the result.
    """

    steps: int = 1500  # at most
    stop: Stop = field(default_factory=Stop)
    batch: int = 2
    threads: int = 2
    backend: str = "auto"
    train_frames: int = 40  # at most, spread over the episode; the frames between them are held out
    depth_weight: float = 3.0  # of squared relative depth error, beside squared color error
    checked_frames: int = 16  # at most, of those trained on and of those held out each
    last_rate: float = 0.03  # share of the rates left at the end (cosine schedule)
    refine: bool = True  # let tracks and moving cameras give way,
    body_limit: float = 1.0  # tracks by so many times their residual at most,
    camera_limit: float = 3.0  # cameras by so many times what they and still ones disagree by
    moment_steps: int = 7  # of one pass over the moments, each on all views of a time
    moment_passes: int = 4  # at most
    rates: Rates = field(
        default_factory=lambda: Rates(means=0.08, quats=1e-2, scales=5e-2, opacities=0.15, sh=7e-2)
    )


def settings_for(
    stop: Kind = "heldout", *, target: float | None = None, steps: int | None = None
) -> FitSettings:
    """The settings that suit a stopping rule; `target` is the decibels that `fidelity` is to reach."""
    rule = Stop(kind=stop) if target is None else Stop(kind=stop, target=target)
    plain = FitSettings(steps=FIDELITY_STEPS) if stop == "fidelity" else FitSettings()
    return replace(plain, stop=rule, steps=plain.steps if steps is None else steps)


def on(settings: FitSettings, device: str) -> FitSettings:
    """The settings for a device; beside a GPU all cores serve, for Adam and what is looked at there."""
    if device == "cpu":
        return settings
    return replace(settings, backend=devices.backend(device), threads=cores())


@dataclass(frozen=True)
class TargetView:
    """One recorded view, ready to be compared: colors in 0..1, depth in metres or 0."""

    camera: str
    t: int
    rgb: Float32[np.ndarray, "h w 3"]
    depth: Float32[np.ndarray, "h w"]


def shot_of(episode: Episode, name: str, t: int) -> TargetView:
    """One view of an episode with depth."""
    view = episode.views[name]
    assert view.depth is not None
    depth = np.nan_to_num(view.depth(t), nan=0.0, posinf=0.0, neginf=0.0)
    return TargetView(name, t, view.rgb(t).astype(np.float32) / 255, depth)


def cosine(done: float, last: float) -> float:
    """From 1 to `last` as `done` goes from 0 to 1 (Loshchilov and Hutter 2017)."""
    return float(last + (1 - last) * 0.5 * (1 + np.cos(np.pi * done)))


@dataclass(frozen=True)
class _ViewPull:
    """What one view asks for: gradients in the bodies' frames, of the light, and twists of bodies and camera."""

    gradients: Gradients
    light: Float64[np.ndarray, "9"]
    bodies: tuple[Float64[np.ndarray, "6"], ...]
    camera: Float64[np.ndarray, "6"]


class Descent:
    """A fit under way. `step` improves it by a few views; `result` says where it stands.

    The first `held` Gaussians stay as they are.
    """

    def __init__(
        self,
        begun: Gaussians,
        scene: Scene,
        trained: Sequence[int],
        settings: FitSettings,
        held: int = 0,
    ) -> None:
        self._scene, self._settings, self._ids = scene, settings, begun.ids
        self._held = held
        self._adam = Adam(Splats.of(begun), settings.rates, threads=settings.threads)
        self._engines = [
            engine(settings.backend, sharp(Splats.of(begun))) for _ in range(settings.batch)
        ]
        self._moving = [
            (body, rows)
            for body in scene.bodies
            if (body.to_world != np.eye(4)).any()
            and len(rows := np.flatnonzero(np.isin(begun.ids, list(body.instance_ids))))
        ]
        self._middles = [np.median(begun.means[rows], 0).astype(float) for _, rows in self._moving]
        self._twists = [
            Twists.of(
                trained,
                float(np.linalg.norm(begun.means[rows] - middle, axis=-1).mean()),
                most=settings.body_limit * body.residual,
            )
            for (body, rows), middle in zip(self._moving, self._middles, strict=True)
        ]
        tracks = [body.to_world.copy() for body, _ in self._moving]
        self._light = Learner()
        self._placement = Placement(
            tuple(rows for _, rows in self._moving),
            tuple(tracks),
            tuple(quaternions(track[:, :3, :3]) for track in tracks),
            self._light.light,
        )
        cameras = {name: view.camera for name, view in scene.episode.views.items()}
        self._poses = {name: camera.cam_to_world.copy() for name, camera in cameras.items()}
        reach = 0.5  # metres: about what a hand camera looks at
        still = {h for body in scene.bodies if body.motion == "static" for h in body.instance_ids}
        self._drifts = {
            name: Twists.of(
                trained,
                reach,
                CAMERA_STEP,
                settings.camera_limit * calibration.disagreement(scene.episode, name, still),
            )
            for name, camera in cameras.items()
            if not camera.fixed
        }

    def step(self, shots: Sequence[TargetView], factor: float, pool: ThreadPoolExecutor) -> None:
        """One step, every rate times `factor`. Views are worked on side by side and summed in order."""
        jobs = [
            pool.submit(self._look, one, shot)
            for one, shot in zip(self._engines, shots, strict=True)
        ]
        pulls = [job.result() for job in jobs]
        mean = _mean([pull.gradients for pull in pulls])
        for name in PARAMETERS:
            getattr(mean, name)[: self._held] = 0
        self._adam.step(mean, factor)
        self._light.step(np.mean([pull.light for pull in pulls], 0), factor)
        if self._settings.refine:
            for shot, pull in zip(shots, pulls, strict=True):
                self._give_way(shot, pull, factor)

    def _look(self, eye: SplatEngine, shot: TargetView) -> _ViewPull:
        camera, t = self._camera(shot.camera), shot.t
        placed = self._placement.place(self._adam.splats, t)
        pose = geometry.inverse(self._poses[shot.camera][t])
        view = View(camera.K, pose, camera.width, camera.height)
        eye.prepare(placed, view)
        _, _, gradients = eye.backward_squared_error(
            shot.rgb, None, shot.depth, self._settings.depth_weight
        )
        bodies, seen_from = [], np.zeros(6)
        if self._settings.refine:
            for (_, rows), track, middle in zip(
                self._moving, self._placement.motions, self._middles, strict=True
            ):
                bodies.append(
                    twist_of(placed, gradients, rows, geometry.transform(track[t], middle))
                )
            if shot.camera in self._drifts:
                # Moving the camera one way is moving the world the other.
                at = self._poses[shot.camera][t, :3, 3]
                seen_from = -twist_of(placed, gradients, slice(None), at)
        own, light = self._placement.pull_back(gradients, self._adam.splats, placed, t)
        return _ViewPull(own, light, tuple(bodies), seen_from)

    def _give_way(self, shot: TargetView, pull: _ViewPull, factor: float) -> None:
        t, placement = shot.t, self._placement
        for k, (body, _) in enumerate(self._moving):
            self._twists[k].step(t, pull.bodies[k], factor)
            middle = geometry.transform(body.to_world[t], self._middles[k])
            placement.motions[k][t] = about(self._twists[k].at(t), middle) @ body.to_world[t]
            placement.turns[k][t] = quaternions(placement.motions[k][t : t + 1, :3, :3])[0]
        if shot.camera in self._drifts:
            pose_correction = self._drifts[shot.camera]
            pose_correction.step(t, pull.camera, factor)
            recorded = self._camera(shot.camera).cam_to_world[t]
            self._poses[shot.camera][t] = about(pose_correction.at(t), recorded[:3, 3]) @ recorded

    def _camera(self, name: str) -> Camera:
        return self._scene.episode.views[name].camera

    @property
    def light(self) -> Float64[np.ndarray, "9"]:
        """The light that moving bodies turn in, as `irradiance.shading` takes it."""
        return self._light.light.copy()

    def scene(self) -> Scene:
        """The scene as the fit has it by now."""
        gaussians, bodies, pose_correction = self.result()
        return replace(
            self._scene,
            gaussians=gaussians,
            bodies=bodies,
            pose_correction=pose_correction,
            irradiance=self.light,
        )

    def result(self) -> tuple[Gaussians, tuple[Body, ...], dict[str, Float64[np.ndarray, "t 4 4"]]]:
        """Gaussians, and the tracks and drifts they belong to, of all frames."""
        splats = self._adam.splats
        assert splats.quats is not None
        assert splats.scales is not None
        length = np.maximum(np.linalg.norm(splats.quats, axis=-1, keepdims=True), 1e-12)
        gaussians = Gaussians(
            splats.means.astype(np.float32), splats.quats / length, splats.scales, splats.opacities,
            splats.sh, self._ids,
        )  # fmt: skip
        if not self._settings.refine:
            return gaussians, self._scene.bodies, {}
        settled: dict[frozenset[int], Body] = {}
        for (body, rows), middle, twists in zip(
            self._moving, self._middles, self._twists, strict=True
        ):
            around = np.stack([geometry.transform(pose, middle) for pose in body.to_world])
            track = corrected(body.to_world, around, twists)
            # A body's frame is the world at its reference: what that frame was off goes into the Gaussians.
            first = track[body.reference]
            gaussians = _with(gaussians, rows, first)
            settled[body.instance_ids] = replace(body, to_world=track @ geometry.inverse(first))
        bodies = tuple(settled.get(body.instance_ids, body) for body in self._scene.bodies)
        pose_correction = {}
        for name, twists in self._drifts.items():
            poses = self._camera(name).cam_to_world
            truly = corrected(poses, poses[:, :3, 3], twists)
            pose_correction[name] = truly @ geometry.inverse(poses)
        return gaussians, bodies, pose_correction


def _with(gaussians: Gaussians, rows: np.ndarray, motion: Float64[np.ndarray, "4 4"]) -> Gaussians:
    """The Gaussians with some of them moved."""
    there = moved(gaussians, motion)
    means, quats = gaussians.means.copy(), gaussians.quats.copy()
    means[rows], quats[rows] = there.means[rows], there.quats[rows]
    return replace(gaussians, means=means, quats=quats)


def _mean(several: Sequence[Gradients]) -> Gradients:
    """The mean, summed in the order of the batch: threads do not change it."""
    first, *rest = several
    for name in PARAMETERS:
        total = getattr(first, name)
        for other in rest:
            total += getattr(other, name)
        total /= len(several)
    return first
