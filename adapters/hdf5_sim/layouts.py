"""What lies where in a demonstration, as each project writes it. Paths are those below its group.

Facts that no file says, from the projects' own code:

- robomimic (`dataset_states_to_obs.py`, `env_robosuite.py`): images stand upright, depth is metres, `next_obs` are
  `obs` one step later, and its last row is nowhere else; `camera_info` holds poses in the world for cameras that stand,
  and, for one on a hand, a product that is no pose; the principal point is at half of the image's width;
- LIBERO (`create_dataset.py`): images as OpenGL has them, upside down, if `macros_image_convention` says `opengl`; its
  depth is a z-buffer, no metres;
- robosuite: the last of an arm's actions closes the gripper where it is above 0; ids of instances begin at 1;
- ManiSkill (`record.py`, `sapien_env.py`): one observation more than actions; depth is millimetres.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float64
from pydantic import ValidationError
from rpaug_adapters.hdf5_sim.places import DATA, Place
from rpaug_adapters.shared.cameras import Beside, Calibration
from rpaug_adapters.shared.hdf5 import dataset, member

from rpaug import BadInput

NEXT = "next_obs"
COLORS = ("_image", "_rgb")  # endings of robosuite's and LIBERO's color
DIMMED = "_dimmed"  # ending of the same color with a share of the light
LIGHT = "light"  # its attribute: that share
WORDS, CAMERAS = "ep_meta", "camera_info"  # attributes of a demonstration that edits reach
PARAMETERS = "obs/sensor_param"  # of ManiSkill's cameras
DEEPEST = 12  # groups in one another
ARM = 7  # numbers of an action that moves one gripper and closes it
ON_ROBOT = re.compile(r"robot\d")  # beginnings of names of cameras that a robot carries
MM = 1e-3


@dataclass(frozen=True)
class StoredCamera:
    """The datasets of one camera, as the file calls it; `metres` of a unit of its depth, `light` of what is dimmed."""

    camera: str
    color: str
    depth: str | None = None
    metres: float = 1.0
    ids: str | None = None
    dimmed: str | None = None
    light: float = 1.0

    @property
    def names(self) -> list[str]:
        """Its datasets."""
        return [name for name in (self.color, self.depth, self.ids, self.dimmed) if name]


@dataclass(frozen=True)
class Demonstration:
    """A demonstration: its cameras' images, how many there are of each, and how many actions.

    `following`: there is an image more than actions, the last one in `next_obs`. `own` are the cameras that the file
    itself places. `tracks` have a row an image: where there are fewer, the last one is repeated. `reworded`: its words
    are others than its file says.
    """

    place: Place
    stored: Mapping[str, StoredCamera]
    length: int
    steps: int
    tracks: Mapping[str, Float64[np.ndarray, "t k"]]
    own: Beside
    following: bool = False
    flipped: bool = False
    words: tuple[str, ...] = ()
    reworded: bool = False
    rate: float | None = None
    unread: tuple[str, ...] = field(default=())


def demo(place: Place, file: h5py.File) -> Demonstration:
    """What the file holds of a demonstration. Raises BadInput."""
    group = member(place.path, file, place.group)
    if not isinstance(group, h5py.Group):
        raise BadInput(place.path, place.group, found="a dataset", expected="a group")
    held = dict(datasets(place, group))
    if "actions" not in held and not any(name.startswith("actions/") for name in held):
        raise BadInput(place.path, f"{place.group}/actions", found="nothing", expected="a dataset")
    return (_robomimic if place.robomimic else _maniskill)(place, file, group, held)


def datasets(place: Place, group: h5py.Group, at: str = "") -> Iterator[tuple[str, h5py.Dataset]]:
    """Every dataset below a group, by its path there. Raises BadInput for what leads elsewhere, or in a circle."""
    if at.count("/") > DEEPEST:
        found, expected = f"more than {DEEPEST} groups in one another", "fewer"
        raise BadInput(place.path, f"{place.group}/{at}", found=found, expected=expected)
    for name in group:
        held = member(place.path, group, name)
        if isinstance(held, h5py.Group):
            yield from datasets(place, held, f"{at}{name}/")
            continue
        if h5py.check_ref_dtype(held.dtype) is not None:
            where = f"{place.group}/{at}{name}"
            raise BadInput(place.path, where, found="references", expected="numbers or texts")
        yield f"{at}{name}", dataset(place.path, group, name)


def attribute(place: Place, held: h5py.Group, name: str) -> Any:
    """What JSON in an attribute says, None where there is none. Raises BadInput."""
    value = held.attrs.get(name)
    if value is None:
        return None
    try:
        return json.loads(value)
    except (ValueError, TypeError, RecursionError):
        where = f"{held.name}, attribute {name}"
        raise BadInput(place.path, where, found=repr(value)[:60], expected="JSON") from None


def _is_color(held: h5py.Dataset) -> bool:
    return held.ndim == 4 and held.dtype == np.uint8 and held.shape[3] == 3 and 0 not in held.shape


def _light(held: h5py.Dataset) -> float | None:
    """The share of the recorded light that a dimmed image has, None if it is no dimmed image."""
    value = held.attrs.get(LIGHT) if held.name.endswith(DIMMED) else None
    known = isinstance(value, float) and 0 < value < 1
    return float(value) if known and _is_color(held) else None


def _robomimic(
    place: Place, file: h5py.File, group: h5py.Group, held: dict[str, h5py.Dataset]
) -> Demonstration:
    steps = len(held["actions"]) if "actions" in held and held["actions"].ndim == 2 else 0
    if not steps or group.attrs.get("num_samples", steps) != steps:
        found = f"{steps} actions, num_samples {group.attrs.get('num_samples')}"
        raise BadInput(place.path, place.group, found=found, expected="as many")
    upside_down = file[DATA].attrs.get("macros_image_convention") in ("opengl", b"opengl")
    stored = {}
    for name in (name for name in held if name.startswith("obs/") and _is_color(held[name])):
        if _light(held[name]) is not None:
            continue
        view = name.removeprefix("obs/")
        view = next((view.removesuffix(end) for end in COLORS if view.endswith(end)), view)
        depth, ids = f"obs/{view}_depth", f"obs/{view}_segmentation_instance"
        metric = not upside_down and like(held, depth, held[name], "f")
        masks = like(held, ids, held[name], "iu")
        stored[view] = StoredCamera(
            view, name, depth if metric else None, ids=ids if masks else None
        )
        dimmed = held.get(f"obs/{view}{DIMMED}")
        light = None if dimmed is None else _light(dimmed)
        if light is not None and dimmed.shape == held[name].shape:
            stored[view] = replace(stored[view], dimmed=f"obs/{view}{DIMMED}", light=light)
    later = [f"next_{one.color}" in held for one in stored.values()]
    if any(later) and not all(later):
        expected = "all cameras, or none"
        raise BadInput(place.path, NEXT, found="some of the cameras", expected=expected)
    following = any(later)
    length = steps + following
    _see_lengths(place, held, stored, steps, following)
    env = attribute(place, file[DATA], "env_args")
    own = _words(attribute(place, group, WORDS), "lang")
    every = _words(attribute(place, file[DATA], "problem_info"), "language_instruction")
    return Demonstration(
        place,
        stored,
        length,
        steps,
        _tracks(place, held, stored, length, following),
        _known_cameras(place, attribute(place, group, CAMERAS), stored),
        following,
        upside_down,
        tuple(own or every),
        bool(own and every and own != every),
        _rate(env),
        _unread(place, held, stored),
    )


def _maniskill(
    place: Place, _: h5py.File, group: h5py.Group, held: dict[str, h5py.Dataset]
) -> Demonstration:
    actions = [one for name, one in held.items() if re.match(r"actions(/|$)", name)]
    steps = max(len(one) if one.ndim else 0 for one in actions)
    stored, calibrated = {}, {}
    for name in (name for name in held if re.fullmatch(r"obs/sensor_data/[^/]+/rgb", name)):
        if not _is_color(held[name]):
            continue
        at, view = name.removesuffix("/rgb"), name.split("/")[2]
        depth, ids = f"{at}/depth", f"{at}/segmentation"
        deep, masks = like(held, depth, held[name], "iuf"), like(held, ids, held[name], "iu")
        unit = MM if deep and held[depth].dtype.kind in "iu" else 1.0
        stored[view] = StoredCamera(
            view, name, depth if deep else None, unit, ids if masks else None
        )
        parameters = f"{PARAMETERS}/{view}"
        if f"{parameters}/intrinsic_cv" in held and f"{parameters}/extrinsic_cv" in held:
            calibrated[view] = {
                "intrinsics": held[f"{parameters}/intrinsic_cv"][:1].reshape(-1, 3).tolist(),
                "extrinsics": _inverted(place, held[f"{parameters}/extrinsic_cv"]),
            }
    if not steps:
        raise BadInput(place.path, f"{place.group}/actions", found="none", expected="some")
    length = steps + 1
    _see_lengths(place, held, stored, length, False)
    tracks = _tracks(place, held, stored, length, False)
    own = _known_cameras(place, calibrated, stored)
    unread = _unread(place, held, stored)
    return Demonstration(place, stored, length, steps, tracks, own, unread=unread)


def _inverted(place: Place, held: h5py.Dataset) -> list[Any]:
    """Camera to world of matrices that lead from the world to the camera. Raises BadInput."""
    if held.shape[1:] not in ((3, 4), (4, 4)):
        raise BadInput(place.path, held.name, found=str(held.shape), expected="3x4 or 4x4")
    whole = np.tile(np.eye(4), (len(held), 1, 1))
    whole[:, :3] = held[:, :3]
    turn, shift = whole[:, :3, :3].swapaxes(1, 2), whole[:, :3, 3:]
    whole[:, :3, :3], whole[:, :3, 3:] = turn, -turn @ shift
    return list(whole)


def like(held: Mapping[str, h5py.Dataset], name: str, color: h5py.Dataset, kinds: str) -> bool:
    """Whether there are numbers of some kinds, one a pixel of the color."""
    if name not in held or held[name].dtype.kind not in kinds:
        return False
    return held[name].shape in (color.shape[:3], (*color.shape[:3], 1))


def _see_lengths(
    place: Place,
    held: Mapping[str, h5py.Dataset],
    stored: Mapping[str, StoredCamera],
    rows: int,
    following: bool,
) -> None:
    """See that there are images, and as many as there must be. Raises BadInput."""
    if not stored:
        found, expected = "no images", "observations with color: replay the states with cameras"
        raise BadInput(place.path, f"{place.group}/obs", found=found, expected=expected)
    for one in stored.values():
        for name in one.names + [f"next_{name}" for name in one.names if following]:
            like = held[name.removeprefix("next_")].shape[1:]
            shape = held[name].shape if name in held else None
            if shape != (rows, *like):
                where, expected = f"{place.group}/{name}", f"{rows} images"
                raise BadInput(place.path, where, found=f"shape {shape}", expected=expected)


def _tracks(
    place: Place,
    held: Mapping[str, h5py.Dataset],
    stored: Mapping[str, StoredCamera],
    length: int,
    following: bool,
) -> dict[str, Float64[np.ndarray, "t k"]]:
    """Every dataset of numbers with one or two axes and a row an image or an action, by the name all layouts share."""
    shown = {name for one in stored.values() for name in one.names}
    found = {}
    for name, one in held.items():
        if name in shown or name.startswith(f"{NEXT}/") or one.dtype.kind not in "fiub":
            continue
        if one.ndim not in (1, 2) or len(one) not in (length, length - 1) or not one.size:
            continue
        rows = np.asarray(one[()], np.float64).reshape(len(one), -1)
        if len(rows) < length:
            later = held.get(f"next_{name}") if following else None
            last = rows[-1:] if later is None else np.reshape(later[-1:], (1, -1))
            if last.shape != rows[-1:].shape:
                raise BadInput(place.path, f"next_{name}", found="another size", expected=name)
            rows = np.concatenate([rows, last])
        if not np.isfinite(rows).all():
            where = f"{place.group}/{name}"
            raise BadInput(place.path, where, found="NaN or infinity", expected="finite numbers")
        found[_shared(name)] = rows
    return found


def _shared(name: str) -> str:
    if name.startswith("obs/"):
        return f"observation/{name.removeprefix('obs/')}"
    return re.sub(r"^actions\b", "action", name)


def _known_cameras(place: Place, given: Any, stored: Mapping[str, StoredCamera]) -> Beside:
    """The cameras that the file places. Raises BadInput."""
    own = Beside()
    own._where = place.path
    for name in stored if isinstance(given, dict) else ():
        if not isinstance(given.get(name), dict):
            continue
        try:
            K = np.array(given[name]["intrinsics"], float)
            K[:2, 2] -= 0.5  # to integer centres
            poses = None if ON_ROBOT.match(name) else given[name]["extrinsics"]
            own.cameras[name] = Calibration(K=K.tolist(), cam_to_world=poses)
        except (ValidationError, KeyError, TypeError, ValueError, IndexError):
            where = f"{place.group}, camera {name}"
            found, expected = str(given[name])[:60], "intrinsics and extrinsics"
            raise BadInput(place.path, where, found=found, expected=expected) from None
    return own


def _words(given: Any, name: str) -> list[str]:
    """An instruction that JSON states, in a list; LIBERO's may be a list of letters, and in quotes."""
    value = given.get(name) if isinstance(given, dict) else None
    text = "".join(map(str, value)) if isinstance(value, list) else value
    return [text.strip('" ')] if isinstance(text, str) and text.strip('" ') else []


def _rate(env: Any) -> float | None:
    given = env.get("env_kwargs") if isinstance(env, dict) else None
    rate = given.get("control_freq") if isinstance(given, dict) else None
    return float(rate) if isinstance(rate, (int, float)) and 0 < rate < 1e5 else None


def _unread(
    place: Place, held: Mapping[str, h5py.Dataset], stored: Mapping[str, StoredCamera]
) -> tuple[str, ...]:
    shown = {name for one in stored.values() for name in one.names}
    return tuple(
        f"{name} ({one.dtype}, {'x'.join(map(str, one.shape))}) is not understood: it stays as it is"
        for name, one in held.items()
        if name.startswith("obs/") and one.ndim > 3 and name not in shown
    )
