"""Rigid things left to physics, rebuilt from the twin's images, against MuJoCo with the twin's true shapes and poses.

python tools/bench/physics_rigid.py [drop topple roll push drawer lid] [--seeds 0 1] [--json]

The operator sees rgb, depth and masks; the truth has the thing's own boxes and cylinders, the table, the things around
it, and the robot's true fingers on their true way, in the same MuJoCo with the same material. `drawer` and `lid`
have no simulated truth: they are held against the recorded track, along which the recorded gripper is to move them.
"""

import argparse
import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float64

from rpaug import twin
from rpaug.core import geometry
from rpaug.operators.physics import Physics
from rpaug.physics import materials
from rpaug.physics.colliders import Boxes
from rpaug.physics.rigid import Rigid
from rpaug.scene.build import build
from rpaug.scene.targets.targets import Target
from rpaug.twin import mjcf, tabletop
from rpaug.twin.look import Look

FRAMES, SIZE, FPS, MATERIAL = 40, 128, 20.0, "wood"
FLAT = "patch"  # a millimetre thick: no edge of it catches a block
HELD = ("drawer", "lid")
HANDS = ("hand", "finger_left", "finger_right")


@dataclass(frozen=True)
class Try:
    """What is left to physics where, and how."""

    task: str
    name: str
    height: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    friction: float = 0.5


TRIES = {
    "drop": Try("pick_block", "cylinder", height=0.1),
    "topple": Try("open_drawer", "block_plain", velocity=(1.2, 0.0, 0.0), friction=1.5),
    "roll": Try("open_drawer", "cylinder", velocity=(0.0, 1.2, 0.0), friction=1.5),
    "push": Try("slide_block", "block_plain"),
    "drawer": Try("open_drawer", "drawer"),
    "lid": Try("close_box", "lid"),
}


@dataclass(frozen=True)
class True_(Rigid):
    """The thing and what stands around it in the shapes that the twin gives them (MJCF)."""

    own: str = ""
    around: str = ""

    def _shaped(self, how: str) -> tuple[str, str]:
        return "", self.own

    def _described(self) -> str:
        return super()._described().replace("<worldbody>", "<worldbody>" + self.around)


class Stage:
    """A twin's recording, and MuJoCo's own account of where all shapes were in it."""

    def __init__(self, task: str, seed: int) -> None:
        self.take = twin.perform(task, seed, frames=FRAMES, size=SIZE)
        first = {name: track[0] for name, track in self.take.poses.items()}
        self.world = tabletop.build(first, np.random.default_rng(0), 0)
        self.model = mjcf.compile_model(self.world, Look(), 64)

    @cached_property
    def tracks(self) -> Float64[np.ndarray, "t g 4 4"]:
        """Poses of all shapes."""
        model, data, robot = self.model, mujoco.MjData(self.model), self.take.episode.robot
        out = np.tile(np.eye(4), (FRAMES, model.ngeom, 1, 1))
        fingers = robot.extra["gripper_joint_positions"]
        for t in range(FRAMES):
            data.qpos[:] = (*robot.joint_positions[t], *fingers[t])
            for name, track in self.take.poses.items():
                number = model.body(name).mocapid[0]
                if number >= 0:
                    data.mocap_pos[number] = track[t, :3, 3]
                    mujoco.mju_mat2Quat(data.mocap_quat[number], track[t, :3, :3].ravel())
            mujoco.mj_forward(model, data)
            out[t, :, :3, :3] = data.geom_xmat.reshape(-1, 3, 3)
            out[t, :, :3, 3] = data.geom_xpos
        return out

    def shapes(self, names: tuple[str, ...]) -> list[int]:
        """Numbers of the shapes of some bodies."""
        model = self.model
        return [g for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name in names]

    def written(self, shape: int, up: Float64[np.ndarray, "3"], how: str = "") -> str:
        """A shape in MJCF, as it stands in the first frame, lifted by `up`."""
        pose, turn = self.tracks[0, shape], np.empty(4)
        mujoco.mju_mat2Quat(turn, pose[:3, :3].ravel())
        kind = mujoco.mjtGeom(self.model.geom_type[shape]).name[7:].lower()
        rows = {"size": self.model.geom_size[shape], "pos": pose[:3, 3] + up, "quat": turn}
        stated = " ".join(f'{k}="{" ".join(f"{v:.9g}" for v in row)}"' for k, row in rows.items())
        return f'<geom type="{kind}" {stated} {how}/>'


def true_motions(stage: Stage, what: Try) -> Float64[np.ndarray, "t 4 4"]:
    """World motions of the thing from where it was recorded, in MuJoCo with the true shapes."""
    up = np.array([0.0, 0.0, what.height])
    mine, hand = stage.shapes((what.name,)), stage.shapes(HANDS)
    assert (stage.model.geom_type[hand] == mujoco.mjtGeom.mjGEOM_BOX).all()
    others = stage.shapes(tuple(n for n in stage.take.poses if n not in (what.name, FLAT)))
    density = materials.named(MATERIAL).density
    own = f'density="{density:g}" contype="3" conaffinity="3"'
    tracks = np.swapaxes(stage.tracks[:, hand], 0, 1)
    thing = True_(
        points=np.concatenate([np.eye(3), -np.eye(3)]),
        density=density,
        level=tabletop.TABLE,
        boxes=Boxes(tracks, stage.model.geom_size[hand].copy(), np.zeros(len(hand)), 1 / FPS),
        friction=what.friction,
        velocity=what.velocity,
        own="".join(stage.written(g, up, own) for g in mine),
        around="".join(stage.written(g, np.zeros(3)) for g in others),
    )
    motions = thing.run(FRAMES, 1 / FPS).motions
    motions[:, :3, 3] += motions[:, :3, :3] @ up
    return motions


def ours(stage: Stage, what: Try) -> tuple[Float64[np.ndarray, "t 4 4"], dict[str, Any]]:
    """The same as the operator has it, from the images alone, and what it tells."""
    instance_id = stage.take.truth.handles[what.name]
    operator = Physics(
        target=Target(handle=instance_id), material=MATERIAL, height=(what.height, what.height),
        velocity=what.velocity, friction=what.friction, fps=FPS,
    )  # fmt: skip
    scene = build(stage.take.episode, with_bodies=True)
    after = operator.apply(scene, operator.sample(scene, np.random.default_rng(0)))
    before = next(body for body in scene.tracked if instance_id in body.instance_ids).to_world[0]
    body = next(body for body in after.bodies if instance_id in body.instance_ids)
    return body.to_world @ geometry.inverse(before), dict(after.simulated[0])


def compare(name: str, seed: int) -> dict[str, float]:
    """How far the thing's middle and its turning are off: in the last frame, and at worst."""
    what = TRIES[name]
    stage = Stage(what.task, seed)
    found, given = ours(stage, what)
    assert given["solver"] == "rigid"
    start = stage.take.poses[what.name][0]
    middle = stage.tracks[0, stage.shapes((what.name,)), :3, 3].mean(0)
    recorded = stage.take.poses[what.name] @ geometry.inverse(start)
    true = recorded if name in HELD else true_motions(stage, what)
    places = [motions[:, :3, :3] @ middle + motions[:, :3, 3] for motions in (found, true)]
    off = np.linalg.norm(places[0] - places[1], axis=-1)
    turn = np.einsum("tji,tjk->tik", found[:, :3, :3], true[:, :3, :3])
    angle = np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))
    gone = np.linalg.norm(places[1][-1] - middle)
    top = np.rad2deg(np.arccos(np.clip(true[-1, 2, 2], -1, 1)))
    return {
        "went_mm": 1000 * float(gone), "tilted_degrees": float(top),
        "end_mm": 1000 * float(off[-1]), "worst_mm": 1000 * float(off.max()),
        "end_degrees": float(np.rad2deg(angle[-1])),
        "worst_degrees": float(np.rad2deg(angle.max())),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tries", nargs="*", help=f"of {', '.join(TRIES)}; all by default")
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1])
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = {}
    for name in asked.tries or TRIES:
        for seed in asked.seeds:
            found[f"{name} {seed}"] = compare(name, seed)
            if not asked.json:
                stated = "  ".join(f"{k} {v:.2f}" for k, v in found[f"{name} {seed}"].items())
                print(f"{name:8s} {seed}  {stated}", flush=True)
    if asked.json:
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
