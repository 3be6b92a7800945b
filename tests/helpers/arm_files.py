"""The Panda as files describe it."""

import numpy as np

from rpaug.scene.tracking.arms import PANDA


def panda_mjcf() -> str:
    """The Panda's measures as nested MJCF bodies."""
    text, ends = "", ""
    for a, d, alpha in zip(PANDA.a, PANDA.d, PANDA.alpha, strict=True):
        # Modified Denavit-Hartenberg: turn by alpha about x, then shift along x by a and the new z by d.
        c, s = np.cos(alpha), np.sin(alpha)
        text += (
            f'<body pos="{a} {-d * s} {d * c}" quat="{np.cos(alpha / 2)} {np.sin(alpha / 2)} 0 0">'
            '<joint type="hinge" axis="0 0 1"/><geom size="0.01" mass="1"/>'
        )
        ends += "</body>"
    return f'<mujoco><compiler angle="radian"/><worldbody>{text}{ends}</worldbody></mujoco>'


def panda_urdf() -> str:
    """The Panda as its makers' files have it: meshes that are not there, no masses, a world link, a hand, a mimic."""
    mesh = '<visual><geometry><mesh filename="package://nowhere/link.dae"/></geometry></visual>'
    text = f'<link name="world"/><link name="link0">{mesh}</link>'
    text += '<joint name="fix" type="fixed"><parent link="world"/><child link="link0"/></joint>'
    for k, (a, d, alpha) in enumerate(zip(PANDA.a, PANDA.d, PANDA.alpha, strict=True)):
        c, s = np.cos(alpha), np.sin(alpha)
        text += (
            f'<link name="link{k + 1}">{mesh}</link><joint name="joint{k + 1}" type="revolute">'
            f'<parent link="link{k}"/><child link="link{k + 1}"/><axis xyz="0 0 2"/>'
            f'<origin xyz="{a} {-d * s} {d * c}" rpy="{alpha} 0 0"/></joint>'
        )
    for name, rest in (("left", ""), ("right", '<mimic joint="left"/>')):
        text += (
            f'<link name="{name}"/><joint name="{name}" type="prismatic">{rest}'
            f'<parent link="link7"/><child link="{name}"/><axis xyz="0 1 0"/></joint>'
        )
    return f'<?xml version="1.0"?><robot name="panda">{text}</robot>'
