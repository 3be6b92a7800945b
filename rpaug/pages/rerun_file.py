"""A space as a recording that Rerun's viewer opens: points, cameras with their images, what was put in, over frames."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core import geometry, progress
from rpaug.core.errors import BadInput, MissingExtra
from rpaug.core.files import PART
from rpaug.pages.space import Space

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


def _frame(rr: Any, stream: Any, space: Space, t: int, most: int) -> None:
    cloud = space.cloud(t, most)
    if len(cloud.points):
        shown = rr.Points3D(cloud.points, colors=cloud.colors, class_ids=cloud.ids % 2**16)
        stream.log("world/seen", shown)
    for name, view in (space.episode.views if space.episode else {}).items():
        pose, place = view.camera.cam_to_world[t], f"world/cameras/{name}"
        turned = rr.Quaternion(xyzw=geometry.quaternion_of(pose))
        stream.log(place, rr.Transform3D(translation=pose[:3, 3], rotation=turned))
        lens = rr.Pinhole(
            image_from_camera=view.camera.K, resolution=[view.camera.width, view.camera.height]
        )
        stream.log(place, lens)
        stream.log(place, rr.Image(np.ascontiguousarray(view.rgb(t))).compress())
    for mesh in space.meshes(t):
        solid = rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.faces)
        stream.log(f"world/put_in/{mesh.name.replace(' ', '_')}", solid)
    if (splats := space.splats(t)) is not None:
        colors = np.concatenate([splats.colors, splats.opacities[:, None]], 1)
        stream.log("world/Gaussians", rr.Points3D(splats.centers, colors=colors))
