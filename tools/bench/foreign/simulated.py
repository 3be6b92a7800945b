"""A MuJoCo model's states as images: what is recorded, and what is truly rendered again with something changed."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

SIZE = 128  # pixels a side, as RLBench
MOVED = 0.01  # metres
SHADOW = (
    1024  # texels a side of the lamps' map; a processor renders the usual 4096 at half the pace
)
HIDDEN = 5  # a group that no world draws
STATE = ("qpos", "qvel", "act", "mocap_pos", "mocap_quat")


@dataclass(frozen=True, kw_only=True)
class Eye:
    """A camera: where it stands and looks, in the world or in the frame of `body`; vertical field of view, degrees."""

    eye: tuple[float, float, float]
    at: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    body: str | None = None
    fovy: float = 40.0

    @property
    def pose(self) -> np.ndarray:
        """Camera to world or body, (4, 4), OpenCV's axes."""
        ahead = np.subtract(self.at, self.eye)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, self.up)
        right /= np.linalg.norm(right)
        out = np.eye(4)
        out[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
        out[:3, 3] = self.eye
        return out


def intrinsics(fovy: float, size: int = SIZE) -> np.ndarray:
    """K (3, 3) of a square image with integer pixel centers."""
    focal = size / 2 / np.tan(np.deg2rad(fovy) / 2)
    return np.array([[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1.0]])


def state(data: mujoco.MjData) -> dict[str, np.ndarray]:
    """A copy of everything that moves."""
    return {name: np.array(getattr(data, name)) for name in STATE}


def restore(model: mujoco.MjModel, data: mujoco.MjData, states: Mapping[str, Any], t: int) -> None:
    """Bring the simulation to frame t."""
    for name in STATE:
        getattr(data, name)[:] = states[name][t]
    mujoco.mj_forward(model, data)


def edits(model: mujoco.MjModel, fresh: mujoco.MjModel) -> dict[str, np.ndarray]:
    """The numeric fields in which a model differs from its file: geometry drawn anew for an episode."""
    out = {}
    for name in dir(fresh):
        value = getattr(fresh, name)
        if not isinstance(value, np.ndarray) or name == "geom_group":
            continue
        used = np.array(getattr(model, name))
        if not np.array_equal(value, used, equal_nan=value.dtype.kind == "f"):
            out[name] = used
    return out


def load(source: str, folder: Path, marks: Sequence[str] = ()) -> mujoco.MjModel:
    """A model from its file, or from its XML, which is then kept in `folder`."""
    if source.lstrip().startswith("<"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "model.xml").write_text(source)
        source = str(folder / "model.xml")
    return hidden(mujoco.MjModel.from_xml_path(source), marks)


def hidden(model: mujoco.MjModel, marks: Sequence[str]) -> mujoco.MjModel:
    """The model without the handles of mocap bodies and without bodies whose names begin as `marks` say."""
    mark = [
        model.body_mocapid[body] >= 0 or model.body(body).name.startswith(tuple(marks))
        for body in range(model.nbody)
    ]
    model.geom_group[np.array(mark)[model.geom_bodyid]] = HIDDEN
    return model


def apply(model: mujoco.MjModel, edits: Mapping[str, np.ndarray]) -> mujoco.MjModel:
    """The model with an episode's own numbers; bodies and geoms that were added at its end keep theirs."""
    for name, value in edits.items():
        getattr(model, name)[: len(value)] = value
    return model


def body_name(model: mujoco.MjModel, body: int) -> str:
    """A body's name; one without has its parent's and its place among the parent's."""
    if name := model.body(body).name:
        return name
    parent = int(model.body_parentid[body])
    brothers = [b for b in range(1, model.nbody) if model.body_parentid[b] == parent]
    return f"{body_name(model, parent)}.{brothers.index(body)}"


def shown(model: mujoco.MjModel, groups: Sequence[int]) -> dict[str, list[int]]:
    """The geoms that are drawn, by instance: one a body, and each of the world's own by itself."""
    out: dict[str, list[int]] = {}
    for geom in range(model.ngeom):
        material = int(model.geom_matid[geom])
        alpha = model.geom_rgba[geom, 3] if material < 0 else model.mat_rgba[material, 3]
        alpha = min(alpha, model.geom_rgba[geom, 3])
        if model.geom_group[geom] not in groups or alpha == 0:
            continue
        body = int(model.geom_bodyid[geom])
        name = body_name(model, body) if body else (model.geom(geom).name or f"world.{geom}")
        out.setdefault(name, []).append(geom)
    return out


def numbered(names: Sequence[str], seed: int) -> dict[str, int]:
    """Instance ids from 1, in an order that the seed draws: no number tells what a thing is."""
    order = np.random.default_rng(seed).permutation(len(names))
    return {name: int(place) + 1 for name, place in zip(names, order, strict=True)}


def pushed(model: mujoco.MjModel, states: Mapping[str, np.ndarray], robot: Set[str]) -> set[str]:
    """The names of bodies that go farther than MOVED while they touch the robot, or what that pushed."""
    data = mujoco.MjData(model)
    names = [body_name(model, body) for body in range(model.nbody)]
    at, touching = [], []
    for t in range(len(states["qpos"])):
        restore(model, data, states, t)
        at.append(data.xipos.copy())
        pairs = model.geom_bodyid[data.contact.geom]
        touching.append({(names[a], names[b]) for a, b in (*pairs, *pairs[:, ::-1])})
    steps = np.linalg.norm(np.diff(at, axis=0), axis=-1)
    out: set[str] = set()
    while True:
        acting = robot | out
        went = dict.fromkeys(names, 0.0)
        for t, lengths in enumerate(steps):
            near = {one for one, other in touching[t] | touching[t + 1] if other in acting}
            for name, length in zip(names, lengths, strict=True):
                went[name] += length if name in near else 0.0
        fresh = {name for name, way in went.items() if way > MOVED} - acting
        if not fresh:
            return out
        out |= fresh


def below(model: mujoco.MjModel, roots: Sequence[str]) -> set[str]:
    """The names of bodies and of all that hangs on them."""
    out: set[str] = set()
    for body in range(1, model.nbody):
        at = body
        while at:
            if body_name(model, at) in roots:
                out.add(body_name(model, body))
            at = int(model.body_parentid[at])
    return out


@dataclass
class Studio:
    """Renders a model's states: color as the simulator draws it, depth and instance ids of pixel centers.

    `headlamp`: cameras are the model's own. MuJoCo places them itself: the last bit of a place changes pixels by a
    level. Where one was moved its light goes with it.
    """

    model: mujoco.MjModel
    ids: np.ndarray  # by geom
    groups: Sequence[int]
    size: int = SIZE
    headlamp: bool = False

    def __post_init__(self) -> None:
        self.data = mujoco.MjData(self.model)
        self.option = mujoco.MjvOption()
        self.option.geomgroup[:] = [group in self.groups for group in range(6)]
        self.option.sitegroup[:] = 0
        self.model.vis.quality.shadowsize = SHADOW
        samples = int(self.model.vis.quality.offsamples)
        self.color = mujoco.Renderer(self.model, self.size, self.size)
        self.model.vis.quality.offsamples = 0  # a depth has no half
        self.exact = mujoco.Renderer(self.model, self.size, self.size)
        self.model.vis.quality.offsamples = samples
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self.exact.scene.flags[flag] = 0  # seconds alone

    def pose(self, eye: Eye) -> np.ndarray:
        """Camera to world now."""
        if eye.body is None:
            return eye.pose
        body = self.data.body(eye.body)
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = body.xmat.reshape(3, 3), body.xpos
        return frame @ eye.pose

    def shoot(
        self, pose: np.ndarray, fovy: float, own: str | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Color (h, w, 3) uint8, depth (h, w) metres and instance ids (h, w) from a camera; 0 where nothing is.

        `own` names the model's camera that stands there.
        """
        self.model.vis.global_.fovy = fovy
        rgb = self._drawn(self.color, pose, own)
        self.exact.enable_depth_rendering()
        depth = self._drawn(self.exact, pose, own).astype(np.float32)
        self.exact.disable_depth_rendering()
        self.exact.enable_segmentation_rendering()
        geom, kind = np.moveaxis(self._drawn(self.exact, pose, own), -1, 0)
        self.exact.disable_segmentation_rendering()
        hit = (geom >= 0) & (kind == mujoco.mjtObj.mjOBJ_GEOM)
        ids = np.where(hit, self.ids[np.where(hit, geom, 0)], 0).astype(np.int32)
        return rgb, np.where(ids > 0, depth, 0).astype(np.float32), ids

    def _drawn(self, renderer: mujoco.Renderer, pose: np.ndarray, own: str | None) -> np.ndarray:
        renderer.update_scene(self.data, -1 if own is None else own, self.option)
        if own is not None:
            return renderer.render().copy()
        for camera in renderer.scene.camera:
            camera.pos[:] = pose[:3, 3]
            camera.forward[:] = pose[:3, 2]
            camera.up[:] = -pose[:3, 1]
        for light in renderer.scene.lights if self.headlamp else ():
            if light.headlight:
                light.pos[:], light.dir[:] = pose[:3, 3], pose[:3, 2]
        return renderer.render().copy()

    def film(
        self,
        states: Mapping[str, Any],
        cameras: Mapping[str, Eye],
        bumps: Mapping[str, Any] | None = None,
    ) -> dict[str, dict[str, np.ndarray]]:
        """All frames of all cameras, as the neutral folder keeps them. `bumps` are (4, 4), in each camera's frame."""
        reels: dict[str, dict[str, list]] = {
            name: {"rgb": [], "depth": [], "ids": [], "cam_to_world": []} for name in cameras
        }
        for t in range(len(states["qpos"])):
            restore(self.model, self.data, states, t)
            for name, eye in cameras.items():
                bump = (bumps or {}).get(name)
                pose = self.pose(eye) @ (np.eye(4) if bump is None else bump)
                own = name if self.headlamp and bump is None else None
                shots = *self.shoot(pose, eye.fovy, own), pose
                for reel, shot in zip(reels[name].values(), shots, strict=True):
                    reel.append(shot)
        return {
            name: {key: np.stack(shots) for key, shots in reel.items()}
            | {"K": intrinsics(cameras[name].fovy, self.size)}
            for name, reel in reels.items()
        }

    def close(self) -> None:
        """Give the contexts back."""
        self.color.close()
        self.exact.close()
