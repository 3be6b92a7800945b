"""A space as a recording that Rerun's viewer opens: points, cameras with their images, what was put in, over frames."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import geometry, progress
from rpaug.core.errors import BadInput, MissingExtra
from rpaug.core.files import PART
from rpaug.pages.space import REST, UNNAMED, Cloud, Space

MOST_POINTS = 30_000  # of each frame
TIMELINE = "frame"


def write(space: Space, path: Path, most: int = MOST_POINTS) -> int:
    """Write all frames to a new `.rrd` file and return how many they are. Raises BadInput, MissingExtra."""
    if path.suffix != ".rrd":
        expected = "a name that ends in .rrd; `rpaug scenes export` writes .ply and .spz"
        raise BadInput(path, "--rerun", found=repr(path.suffix), expected=expected)
    if path.exists():
        raise BadInput(path, "--rerun", found="a file", expected="a new one")
    rr = _rerun()
    part = path.with_name(f".{path.name}{PART}")
    stream = rr.RecordingStream("rpaug", recording_id=space.title)
    try:
        stream.save(part)
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _standing(rr, stream, space)
        for t in range(space.length):
            progress.told(space.title, "writing frames", t, space.length)
            stream.set_time(TIMELINE, sequence=t)
            _frame(rr, stream, space, t, most)
        stream.flush()
        stream.disconnect()
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return space.length


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise MissingExtra("rerun-sdk", "rerun") from None
    return rerun


def _standing(rr: Any, stream: Any, space: Space) -> None:
    """What holds at all times: names and colors of classes, and the shape of what was put in."""
    named = [(n, name, color) for n, name, color in _classes(space)]
    stream.log("world", rr.AnnotationContext(named), static=True)
    for one in space.meshes(0):
        flipped = one.mesh.uv * [1, -1] + [0, 1]  # Rerun's (0, 0) is the image's upper left
        solid = rr.Mesh3D(
            vertex_positions=one.scale * one.mesh.points,
            triangle_indices=one.faces,
            vertex_normals=one.mesh.normals,
            vertex_texcoords=flipped,
            albedo_texture=one.mesh.image,
        )
        stream.log(f"world/put_in/{_part(one.name)}", solid, static=True)


def _classes(space: Space) -> Iterator[tuple[int, str, tuple[int, int, int]]]:
    yield 0, REST, UNNAMED
    for number, (name, (_, color)) in enumerate(space.entities().items(), 1):
        yield number, name, color


def _part(name: str) -> str:
    """Of an entity's path."""
    return name.replace(" ", "_")


def _named(rr: Any, stream: Any, space: Space, cloud: Cloud) -> None:
    """Each name as an entity: its pixels, as large as they are, and its label. One that is out of sight is cleared."""
    apart = space.apart(cloud)
    for number, name, color in _classes(space):
        part, place = apart[name], f"world/instances/{_part(name)}"
        if not len(part.points):
            stream.log(place, rr.Clear(recursive=True))
            continue
        pixels = rr.Points3D(part.points, colors=part.colors, radii=part.radii, class_ids=number)
        stream.log(place, pixels)
        if name != REST:
            middle = [np.median(part.points, axis=0)]
            label = rr.Points3D(middle, colors=[color], labels=[name], class_ids=number)
            stream.log(f"{place}/name", label)


def _frame(rr: Any, stream: Any, space: Space, t: int, most: int) -> None:
    _named(rr, stream, space, space.cloud(t, most))
    for name, view in (space.episode.views if space.episode else {}).items():
        pose, place = view.camera.cam_to_world[t], f"world/cameras/{name}"
        turned = rr.Quaternion(xyzw=geometry.quaternion_of(pose))
        stream.log(place, rr.Transform3D(translation=pose[:3, 3], rotation=turned))
        lens = rr.Pinhole(
            image_from_camera=view.camera.K, resolution=[view.camera.width, view.camera.height]
        )
        stream.log(place, lens)
        stream.log(place, rr.Image(np.ascontiguousarray(view.rgb(t))).compress())
    for one in space.meshes(t):
        turned = rr.Quaternion(xyzw=geometry.quaternion_of(one.to_world))
        where = rr.Transform3D(translation=one.to_world[:3, 3], rotation=turned)
        stream.log(f"world/put_in/{_part(one.name)}", where)
    if (splats := space.splats(t)) is not None:
        colors = np.concatenate([splats.colors, splats.opacities[:, None]], 1)
        stream.log("world/Gaussians", rr.Points3D(splats.centers, colors=colors))
