"""Arms described in URDF: frames and axes of joints, read without meshes or masses, which files in the wild often lack.

A joint's frame is its parent link's times `origin`; its child link's frame is that one turned about, or slid along,
`axis`. https://wiki.ros.org/urdf/XML/joint
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float64

from rpaug.core import geometry
from rpaug.core.errors import BadInput

TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)


@dataclass(frozen=True)
class Joint:
    """One joint of the tree: where its frame is in its parent's, and which recorded number moves it, if any."""

    name: str
    parent: int  # place of the joint that its parent link hangs on, -1 for the root
    origin: Float64[np.ndarray, "4 4"]
    axis: Float64[np.ndarray, "3"]
    slides: bool
    number: int | None


@dataclass(frozen=True)
class Tree:
    """An arm's joints, each after the one it hangs on. The first `joints` that move are the recorded ones."""

    links: tuple[Joint, ...]
    joints: int

    def forward(self, joints: Float64[np.ndarray, "t j"]) -> Float64[np.ndarray, "j t 4 4"]:
        """Pose of the link that each recorded joint moves, in the root's frame, over time; other joints at zero."""
        poses: list[Float64[np.ndarray, "t 4 4"]] = []
        out = np.empty((self.joints, len(joints), 4, 4))
        for link in self.links:
            base = poses[link.parent] if link.parent >= 0 else np.eye(4)[None]
            at = np.broadcast_to(base @ link.origin, (len(joints), 4, 4))
            if link.number is not None:
                at = at @ _motions(link, joints[:, link.number])
                out[link.number] = at
            poses.append(at)
        return out


def _motions(joint: Joint, values: Float64[np.ndarray, "t"]) -> Float64[np.ndarray, "t 4 4"]:
    """What the joint does at each value: Rodrigues' rotation about its axis, or a shift along it."""
    out = np.tile(np.eye(4), (len(values), 1, 1))
    if joint.slides:
        out[:, :3, 3] = values[:, None] * joint.axis
        return out
    x, y, z = joint.axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(values)[:, None, None], np.cos(values)[:, None, None]
    out[:, :3, :3] += sine * cross + (1 - cosine) * (cross @ cross)
    return out


def read(path: Path, root: ElementTree.Element, joints: int) -> Tree:
    """The arm of a URDF's `robot` element. Raises BadInput for one that lacks so many joints, or is no tree."""
    found = list(_ordered(path, root))
    moving = [e for e in found if _kind(e) != "fixed" and e.find("mimic") is None][:joints]
    if len(moving) < joints:
        given = f"{len(moving)} that move: {', '.join(_name(e) for e in moving) or 'none'}"
        raise BadInput(path, "joints", found=given, expected=f"{joints}, as many as are recorded")
    for element in moving:
        if _kind(element) not in TURNING + SLIDING:
            raise BadInput(
                path, f"joint {_name(element)!r}", found=f"type {_kind(element)!r}",
                expected="one that turns or slides: revolute, continuous, prismatic",
            )  # fmt: skip
    numbers = {id(element): k for k, element in enumerate(moving)}
    hangs = {_link(path, element, "child"): k for k, element in enumerate(found)}
    links = tuple(
        Joint(
            name=_name(element),
            parent=hangs.get(_link(path, element, "parent"), -1),
            origin=_origin(path, element),
            axis=_axis(path, element),
            slides=_kind(element) in SLIDING,
            number=numbers.get(id(element)),
        )
        for element in found
    )
    return Tree(links, joints)


def _ordered(path: Path, root: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """All joints from the root on, those of one link in the file's order. Raises BadInput for loops."""
    every = root.findall("joint")
    below: dict[str, list[ElementTree.Element]] = {}
    children = [_link(path, element, "child") for element in every]
    for element in every:
        below.setdefault(_link(path, element, "parent"), []).append(element)
    if len(set(children)) < len(children):
        twice = sorted({name for name in children if children.count(name) > 1})
        raise BadInput(path, "joints", found=f"links with two parents: {twice}", expected="a tree")
    waiting = [e for name in below if name not in children for e in below[name]][::-1]
    seen = 0
    while waiting:
        element = waiting.pop()
        seen += 1
        yield element
        waiting += below.get(_link(path, element, "child"), [])[::-1]
    if seen < len(every):
        raise BadInput(path, "joints", found="a loop of joints", expected="a tree")


def _name(element: ElementTree.Element) -> str:
    return element.get("name", "?")


def _kind(element: ElementTree.Element) -> str:
    return element.get("type", "?")


def _link(path: Path, element: ElementTree.Element, which: str) -> str:
    found = element.find(which)
    name = None if found is None else found.get("link")
    if name is None:
        raise BadInput(
            path, f"joint {_name(element)!r}", found=f"no {which} link", expected="a name"
        )
    return name


def _origin(path: Path, element: ElementTree.Element) -> Float64[np.ndarray, "4 4"]:
    """URDF's fixed axes: first about x (roll), then y (pitch), then z (yaw)."""
    origin = element.find("origin")
    out = np.eye(4)
    if origin is not None:
        out[:3, 3] = _numbers(path, element, origin.get("xyz", "0 0 0"))
        roll, pitch, yaw = _numbers(path, element, origin.get("rpy", "0 0 0"))
        turns = np.diag([roll, pitch, yaw])
        out[:3, :3] = geometry.rotation(turns[2]) @ geometry.rotation(turns[1])
        out[:3, :3] @= geometry.rotation(turns[0])
    return out


def _axis(path: Path, element: ElementTree.Element) -> Float64[np.ndarray, "3"]:
    axis = element.find("axis")
    found = _numbers(path, element, "1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
    length = float(np.linalg.norm(found))
    if not length > 0:
        raise BadInput(
            path, f"joint {_name(element)!r}", found="axis 0 0 0", expected="a direction"
        )
    return found / length


def _numbers(path: Path, element: ElementTree.Element, text: str) -> Float64[np.ndarray, "3"]:
    try:
        found = np.array([float(part) for part in text.split()])
    except ValueError:
        found = np.zeros(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise BadInput(path, f"joint {_name(element)!r}", found=text[:60], expected="three numbers")
    return found
