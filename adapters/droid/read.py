"""Reading a raw episode of DROID.

An episode is a folder `<lab>/{success,failure}/<date>/<time>`: `trajectory.h5` (`action/`, `observation/`, one row a
step), `metadata_<uuid>.json`, `recordings/MP4/<serial>.mp4` (the left eye) and `<serial>-stereo.mp4` (both eyes side by
side), `recordings/SVO/<serial>.svo` (the ZED cameras' own format, which only their SDK reads), and, where someone
exported it, `recordings/Depth/<serial>/<number>.png`. From droid's own code (`droid/robot_env.py`,
`postprocessing/parse.py`, `trajectory_utils/misc.py`):

- camera type 0 is the wrist's; the others are exterior 1 and 2 in the order of their serials;
- frame i of a video belongs to step i, whatever rate the video's header says; an episode ends with its shortest video;
- poses are position and Euler angles about the fixed x, y, z axes, of the camera in the robot's base, OpenCV axes;
  those of the wrist's camera are its poses at each step. Without a calibration they are zeros;
- `gripper_position` is 0 where the gripper is open and 1 where it is shut;
- early recordings have no intrinsics: they are in the SVO files;
- `svo2depth.py` multiplies millimetres by 1000 before it rounds to 16 bits: such depth has wrapped around.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
from jaxtyping import Float64, UInt16
from rpaug_adapters.hdf5_sim.layouts import datasets
from rpaug_adapters.hdf5_sim.places import Place
from rpaug_adapters.shared import cameras, episodes
from rpaug_adapters.shared.cameras import Beside
from rpaug_adapters.shared.hdf5 import member, opened
from rpaug_adapters.shared.images import lazy_depth
from rpaug_adapters.shared.texts import read_json, stamp
from rpaug_adapters.video.stream import Video

from rpaug import BadInput, Camera, CameraView, Episode, Robot, files

TRAJECTORY, GROUPS = "trajectory.h5", ("action", "observation")
EXTRINSICS, INTRINSICS = "observation/camera_extrinsics", "observation/camera_intrinsics"
STATE = "observation/robot_state"
STARTS = "observation/timestamp/control/step_start"  # milliseconds
TASK = "current_task"  # an attribute of the trajectory, and a key of the metadata
LANGUAGE = "language.json"  # an episode's own words, until they are gathered
ANNOTATIONS = (
    "aggregated-annotations*.json"  # {uuid: {language_instruction1: ...}}, above the episodes
)
ABOVE = 5  # folders: time, date, outcome, lab, dataset
WIDE = 3  # times as wide as high: two ZED images side by side, each 16:9
SVO = "recordings/SVO: raw files of ZED cameras are not read, and edited copies have none of edited cameras"
DEPTH = "recordings/Depth stays as it is recorded: cameras.yaml may say whose it is (depth) and its unit (metres)"


@dataclass(frozen=True)
class Eye:
    """One eye of a ZED camera, `left` or `right`: the videos that show it, and which columns of each; the first counts.

    `depth` is the image of its first step.
    """

    serial: str
    side: str
    shown: tuple[tuple[Video, slice], ...]
    depth: Path | None = None
    metres: float = 1.0

    @property
    def length(self) -> int:
        """Number of frames."""
        return self.shown[0][0].length

    @property
    def name(self) -> str:
        """As the trajectory calls it."""
        return f"{self.serial}_{self.side}"

    def rgb(self, t: int) -> np.ndarray:
        """Frame t."""
        video, columns = self.shown[0]
        return np.ascontiguousarray(video.rgb(t)[:, columns])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its images."""
        video, columns = self.shown[0]
        return len(range(video.size[0])[columns]), video.size[1]


@dataclass(frozen=True)
class DroidSource:
    """Where an episode came from: its folder, eyes and views by name, what lies beside, metadata, words, and the views
    that the trajectory places."""

    folder: Path
    eyes: Mapping[str, Eye]
    views: Mapping[str, CameraView]
    beside: Beside
    metadata: Path | None
    about: Mapping[str, Any]
    words: tuple[str, ...]
    annotated: bool
    placed: frozenset[str]


def read_episode(root: Path, folder: Path, key: str) -> Episode:
    """The episode of a folder. Raises BadInput."""
    path = folder / TRAJECTORY
    beside = cameras.load(root, (folder, *folder.parents[:ABOVE]))
    held = numbers(path)
    steps = len(held["action/joint_position"]) if "action/joint_position" in held else 0
    if not steps:
        raise BadInput(path, "action/joint_position", found="nothing", expected="one row a step")
    tracks = {name: rows.reshape(steps, -1) for name, rows in held.items() if len(rows) == steps}
    eyes, unread = _eyes(folder, tracks)
    eyes = cameras.chosen(beside, eyes, eyes)
    length = min(steps, *(eye.length for eye in eyes.values()))
    tracks = {name: rows[:length] for name, rows in tracks.items()}
    eyes = {name: _with_depth(folder, beside, name, eye, length) for name, eye in eyes.items()}
    placed = {
        name
        for name, eye in eyes.items()
        if (given := beside.cameras.get(name)) is None
        or (given.cam_to_world is None and given.pose_key is None)
        if _poses(tracks.get(f"{EXTRINSICS}/{eye.name}")) is not None
    }

    def view(name: str, camera: Camera) -> CameraView:
        eye = eyes[name]
        camera = _calibrated(path, camera, eye, tracks, name in placed)
        if (first := eye.depth) is None:
            return CameraView(camera, eye.rgb)
        depth = lazy_depth(lambda t: codes(depth_file(first, t)), eye.metres)
        return CameraView(camera, eye.rgb, depth)

    metadata = next(iter(sorted(folder.glob("metadata_*.json"))), None)
    about = {} if metadata is None else names_and_values(metadata)
    words, annotated = _words(root, folder, metadata, _task(path))
    sizes = {name: eye.size for name, eye in eyes.items()}
    made = episodes.episode(
        key, beside, sizes, tracks, length, words, view,
        lambda views: DroidSource(
            folder, eyes, views, beside, metadata, about, words, annotated, frozenset(placed)
        ),
    )  # fmt: skip
    if any((folder / "recordings").glob("**/*.svo")):
        unread = (*unread, SVO)
    if (folder / "recordings/Depth").is_dir() and not any(eye.depth for eye in eyes.values()):
        unread = (*unread, DEPTH)
    rate = made.rate if made.rate is not None else _rate(tracks.get(STARTS))
    return replace(made, robot=_robot(made.robot, tracks), rate=rate, unread=unread)


def numbers(path: Path) -> dict[str, np.ndarray]:
    """The datasets of numbers below `action` and `observation`, by their paths. Raises BadInput."""
    with opened(path, GROUPS) as file:
        return {
            f"{group}/{name}": np.asarray(held[()], float)
            for group in GROUPS
            for name, held in stored(path, file, group)
            if held.ndim and held.dtype.kind in "biuf"
        }


def stored(path: Path, file: h5py.File, group: str) -> Iterator[tuple[str, h5py.Dataset]]:
    """The datasets below a group. Raises BadInput."""
    held = member(path, file, group)
    if not isinstance(held, h5py.Group):
        raise BadInput(path, group, found="a dataset", expected="a group")
    return datasets(Place(path, group), held)


def _eyes(folder: Path, tracks: Mapping[str, np.ndarray]) -> tuple[dict[str, Eye], tuple[str, ...]]:
    """The eyes that were filmed, by the names that DROID's RLDS gives them; and what was not. Raises BadInput."""
    kinds = {
        name.rpartition("/")[2]: rows[0]
        for name, rows in tracks.items()
        if name.startswith("observation/camera_type/") and rows.shape[1] == 1
    }
    if not kinds:
        where, expected = "observation/camera_type", "a dataset named by each camera's serial"
        raise BadInput(folder / TRAJECTORY, where, found="nothing", expected=expected)
    names = {serial: "wrist_image" for serial in kinds if kinds[serial] == 0}
    exterior = sorted(serial for serial in kinds if serial not in names)
    names |= {serial: f"exterior_image_{n}" for n, serial in enumerate(exterior, 1)}
    eyes, unread = {}, []
    for serial, name in names.items():
        found = _filmed(folder / "recordings", serial)
        if not found:
            unread.append(f"{name}: camera {serial} has no video")
        broken = {eye.shown[0][0].facts.broken for eye in found} - {0}
        unread += [f"{name}: the last {n} frames of its video do not decode" for n in broken]
        eyes |= {f"{name}_{eye.side}": eye for eye in found}
    if not eyes:
        raise BadInput(folder / "recordings/MP4", "videos", found="none", expected="SERIAL.mp4")
    return eyes, tuple(unread)


def _filmed(recordings: Path, serial: str) -> list[Eye]:
    """The eyes of a camera: the left one of its own video, if there is one, else of both eyes' video. Raises BadInput
    for a camera of which there is an SVO file alone."""
    whole, both = (recordings / "MP4" / f"{serial}{end}.mp4" for end in ("", "-stereo"))
    shown: dict[str, list[tuple[Video, slice]]] = {}
    for path in (path for path in (whole, both) if path.is_file()):
        video = Video(path)
        width, height = video.size
        half = width // 2
        if path == both or width >= WIDE * height:
            shown.setdefault("left", []).append((video, slice(0, half)))
            shown["right"] = [(video, slice(half, 2 * half))]
        else:
            shown["left"] = [(video, slice(None))]
    eyes = [Eye(serial, side, tuple(found)) for side, found in sorted(shown.items())]
    for eye in eyes:
        for video, columns in eye.shown[1:]:
            if (
                replace(eye, shown=((video, columns),)).size != eye.size
                or video.length < eye.length
            ):
                expected = f"the left half as in {eye.shown[0][0].path.name}"
                raise BadInput(video.path, "size or length", found="another", expected=expected)
    raw = next((path for path in recordings.glob(f"**/{serial}.svo")), None)
    if not eyes and raw is not None:
        expected = (
            "an MP4 of it: the ZED SDK writes one (droid/postprocessing/util/svo2mp4.py) to "
            f"{recordings / 'MP4' / serial}.mp4"
        )
        raise BadInput(raw, "video", found="an SVO file alone", expected=expected)
    return eyes


def _with_depth(folder: Path, beside: Beside, name: str, eye: Eye, length: int) -> Eye:
    """An eye with the depth that the side file names for it. Raises BadInput."""
    given = beside.cameras.get(name)
    if given is None or given.depth is None:
        return eye
    where = (folder / given.depth).resolve()
    if not where.is_relative_to(folder.resolve()):
        expected = "a folder below the episode's"
        raise BadInput(beside.where, f"cameras.{name}.depth", found=given.depth, expected=expected)
    where = folder / given.depth
    found = sorted(where.glob("*.png"), key=lambda path: files.natural(path.stem))
    wanted = {path.stem for path in found}
    first = int(found[0].stem) if found and found[0].stem.isdecimal() else 0
    if first > 1 or not all(str(first + t) in wanted for t in range(length)):
        expected = f"{length} images numbered from 0 or 1 without gaps"
        raise BadInput(where, "depth", found=f"{len(found)} images", expected=expected)
    eye = replace(eye, depth=where / f"{first}.png", metres=given.metres)
    if codes(eye.depth).shape[::-1] != eye.size:
        raise BadInput(eye.depth, "size", found="another", expected="that of the video")
    return eye


def depth_file(first: Path, t: int) -> Path:
    """The depth image of step t, given that of the first."""
    return first.with_name(f"{int(first.stem) + t}.png")


def codes(path: Path) -> UInt16[np.ndarray, "h w"]:
    """The numbers of a depth image. Raises BadInput."""
    data = files.read_bytes(path)
    files.check_image(path, data)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise BadInput(path, "pixels", found="other ones", expected="16-bit gray")
    return image


def _calibrated(
    path: Path, camera: Camera, eye: Eye, tracks: Mapping[str, np.ndarray], placed: bool
) -> Camera:
    """A camera as the trajectory has it, where the side file says nothing of it. Raises BadInput."""
    rows = tracks.get(f"{INTRINSICS}/{eye.name}")
    if camera.assumed and rows is not None and rows.shape[1] == 9:
        K = rows[0].reshape(3, 3)
        inside = 0 < K[0, 2] < camera.width and 0 < K[1, 2] < camera.height
        if not (np.isfinite(K).all() and min(K[0, 0], K[1, 1]) > 0 and inside):
            found, expected = "no camera of this image size", "fx, fy and a center in the image"
            raise BadInput(path, f"{INTRINSICS}/{eye.name}", found=found, expected=expected)
        camera = replace(camera, K=K, assumed=False, unplaced=True)
    if camera.unplaced and placed:
        track = _poses(tracks[f"{EXTRINSICS}/{eye.name}"])
        assert track is not None
        camera = replace(camera, cam_to_world=track, unplaced=False)
    return camera


def _poses(rows: np.ndarray | None) -> Float64[np.ndarray, "t 4 4"] | None:
    """Poses of positions and Euler angles; None where these are none, or no calibration was made."""
    if rows is None or rows.shape[1] != 6 or not np.isfinite(rows).all() or not rows.any(1).all():
        return None
    return cameras.euler_pose(rows[:, :3], rows[:, 3:])


def _robot(given: Robot, tracks: Mapping[str, np.ndarray]) -> Robot:
    """The robot as the trajectory has it, but for what the side file says of it."""
    made = given
    for field, name in (("joint_positions",) * 2, ("joint_velocities",) * 2):
        rows = tracks.get(f"{STATE}/{name}")
        if rows is not None and not getattr(made, field).shape[1]:
            made = replace(made, **{field: rows})
    if made.gripper_to_world is None:
        pose = _poses(tracks.get(f"{STATE}/cartesian_position"))
        shut = tracks.get(f"{STATE}/gripper_position")
        known = pose is not None and shut is not None and shut.shape[1] == 1
        opening = 1 - shut[:, 0] if known else None
        made = replace(made, gripper_to_world=pose, gripper_open=opening)
    return made


def _rate(starts: np.ndarray | None) -> float | None:
    """Steps a second, a whole number, by when they began."""
    if starts is None or len(starts) < 2 or starts.shape[1] != 1:
        return None
    apart = float(np.median(np.diff(starts[:, 0])))
    return float(max(1, round(1000 / apart))) if 0 < apart < 1e6 else None


def _task(path: Path) -> str:
    with opened(path, GROUPS) as file:
        given = file.attrs.get(TASK, "")
    return given.decode("utf-8", "replace") if isinstance(given, bytes) else str(given)


def names_and_values(path: Path) -> dict[str, Any]:
    """What a JSON file says by names. Raises BadInput."""
    given = read_json(path, "names and values")
    if not isinstance(given, dict):
        raise BadInput(path, "JSON", found=type(given).__name__, expected="names and values")
    return given


def _words(
    root: Path, folder: Path, metadata: Path | None, task: str
) -> tuple[tuple[str, ...], bool]:
    """The instructions: the annotations of the episode, else its task; and whether they are annotations."""
    if (folder / LANGUAGE).is_file():
        found = names_and_values(folder / LANGUAGE)
    else:
        listed = annotations(root, folder)
        uuid = None if metadata is None else metadata.stem.removeprefix("metadata_")
        found = {} if listed is None else _listed(listed, *stamp(listed)).get(uuid, {})
    found = found if isinstance(found, dict) else {}
    words = [
        text
        for name, text in sorted(found.items())
        if name.startswith("language_instruction") and isinstance(text, str) and text.strip()
    ]
    if words:
        return tuple(words), True
    return ((task,) if task else ()), False


def annotations(root: Path, folder: Path) -> Path | None:
    """The list of annotations above an episode, and maybe above the dataset's root. Raises BadInput."""
    for above in folder.parents[:ABOVE]:
        if found := sorted(above.glob(ANNOTATIONS)):
            if above.is_relative_to(root):
                files.see_inside(root, found[0])
            return found[0]
    return None


@lru_cache(2)
def _listed(path: Path, _modified: int, _size: int) -> dict[str, Any]:
    return names_and_values(path)
