"""The tabletop as MuJoCo simulates it: things with weight, a drawer on its rail, a gripper without an arm."""

from dataclasses import replace
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
from jaxtyping import Float

from rpaug.twin.look import Look
from rpaug.twin.mjcf import resized
from rpaug.twin.panda import FINGER_END, FINGER_HALF, OPEN
from rpaug.twin.tabletop import BUTTON_TRAVEL, CUP_SMALL, DEPTH
from rpaug.twin.world import Geom, TwinBody, World

STEP = 0.002  # seconds
LOOSE = (
    "block_plain",
    "block_two_coloured",
    "block_textured",
    "block_small",
    "cylinder",
    "cup_small",
    "cup_large",
)
RAILS = {  # body: axis in its own frame, range in metres, friction in newtons
    "drawer": ((1.0, 0.0, 0.0), (0.0, 0.8 * DEPTH), 1.0),
    "button": ((0.0, 0.0, 1.0), (-BUTTON_TRAVEL, 0.0), 0.6),
}
WEIGHTLESS = ("button",)  # its friction alone holds it where it was pressed to
# A thin wall would give way to a finger; nothing ever goes into this cup.
SOLID = {"cup_small": Geom("cylinder", (CUP_SMALL[0],), (0, 0, 0), (0, 0, CUP_SMALL[2]))}
DENSITY = 400.0  # kg per cubic metre: dry wood
PALM = 0.045  # metres above the tip at which the hand's own box begins
GRASP = 40.0  # newtons each finger presses with, at most; a Panda can do 70


def compile_physics(world: World, look: Look) -> mujoco.MjModel:
    """The model that is simulated: the world's own shapes without pictures, and a gripper that follows `target`."""
    root = Xml.Element("mujoco", model="physics")
    Xml.SubElement(root, "compiler", angle="radian")
    Xml.SubElement(
        root,
        "option",
        timestep=str(STEP),
        cone="elliptic",
        impratio="10",
        integrator="implicitfast",
    )
    scene = Xml.SubElement(root, "worldbody")
    for body in world.bodies:
        if body.parent is None and not body.name.startswith("link"):
            _add(scene, body, look)
    _gripper(root, scene)
    return mujoco.MjModel.from_xml_string(Xml.tostring(root, encoding="unicode"))


def _add(scene: Xml.Element, body: TwinBody, look: Look) -> None:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, body.pose[:3, :3].ravel())
    held = {"gravcomp": "1"} if body.name in WEIGHTLESS else {}
    element = Xml.SubElement(
        scene, "body", name=body.name, pos=_text(body.pose[:3, 3]), quat=_text(quaternion), **held
    )
    if body.name in LOOSE:
        Xml.SubElement(element, "freejoint", name=body.name)
    if body.name in RAILS:
        axis, span, friction = RAILS[body.name]
        Xml.SubElement(
            element,
            "joint",
            name=body.name,
            type="slide",
            axis=_text(axis),
            range=_text(span),
            limited="true",
            frictionloss=str(friction),
            damping="2",
        )
    for part in body.parts:
        if part.name in look.absent:
            continue
        if part.name in SOLID:
            part = replace(part, geoms=(SOLID[part.name],))
        for geom in resized(part, look.scales.get(part.name, 1.0)).geoms:
            _shape(element, geom)


def _shape(body: Xml.Element, geom: Geom) -> None:
    element = Xml.SubElement(
        body,
        "geom",
        type=geom.shape,
        size=_text(geom.size),
        density=str(DENSITY),
        friction="0.8 0.01 0.001",
        condim="4",
    )
    if geom.end is not None:
        element.set("fromto", _text((*geom.start, *geom.end)))
        return
    element.set("pos", _text(geom.start))
    if geom.yaw:
        element.set("euler", _text((0.0, 0.0, geom.yaw)))


def _gripper(root: Xml.Element, scene: Xml.Element) -> None:
    """Two fingers and a palm that hang on a target by a stiff weld; the frame is the tip's, z the approach."""
    Xml.SubElement(scene, "body", name="target", mocap="true", pos="0 0 2")
    hand = Xml.SubElement(scene, "body", name="gripper", gravcomp="1", pos="0 0 2")
    Xml.SubElement(hand, "freejoint", name="gripper")
    Xml.SubElement(
        hand, "geom", type="box", size="0.02 0.095 0.024", pos=f"0 0 {-PALM - 0.024}", mass="0.6"
    )
    actuators = Xml.SubElement(root, "actuator")
    long = (PALM + FINGER_END) / 2
    for name, side in (("left", 1.0), ("right", -1.0)):
        finger = Xml.SubElement(hand, "body", name=name, gravcomp="1")
        Xml.SubElement(
            finger,
            "joint",
            name=name,
            type="slide",
            axis=_text((0.0, side, 0.0)),
            range=_text((0.0, OPEN)),
            limited="true",
            armature="0.1",
            damping="5",
        )
        Xml.SubElement(
            finger,
            "geom",
            type="box",
            size=_text((FINGER_HALF, 0.006, long)),
            pos=_text((0.0, side * 0.006, FINGER_END - long)),
            mass="0.1",
            friction="1.2 0.02 0.001",
            condim="4",
            priority="1",
        )
        Xml.SubElement(
            actuators,
            "position",
            name=name,
            joint=name,
            kp="2000",
            kv="60",
            forcerange=_text((-GRASP, GRASP)),
        )
    welds = Xml.SubElement(root, "equality")
    Xml.SubElement(
        welds, "weld", body1="target", body2="gripper", solref="0.01 1", solimp="0.95 0.99 0.001"
    )


def _text(numbers: Float[np.ndarray, "n"] | tuple[float, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
