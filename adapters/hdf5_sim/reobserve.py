"""Depth, instance ids and cameras of states that a simulator recorded, seen again by the simulator itself.

It renders each stored state in its own environment (`simulator.py`); no action is played. What it sees is believed only
where its color is the stored one, or where its color is asked for too. The file that is written has what the source
has, and in `obs`, as robosuite names it, `<camera>_depth`, `<camera>_segmentation_instance`, and `<camera>_pose`, which
`cameras.yaml` tells of, and `<camera>_dimmed`: the color with a quarter of the light, so that what is lit beyond white
is known too. `next_obs` are left out: the last of them shows a state that no file holds.
"""

import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import yaml
from rpaug_adapters.hdf5_sim import layouts, places
from rpaug_adapters.hdf5_sim.gather import growing
from rpaug_adapters.hdf5_sim.layouts import NEXT, Demonstration
from rpaug_adapters.hdf5_sim.places import DATA, Place
from rpaug_adapters.hdf5_sim.read import frames
from rpaug_adapters.hdf5_sim.simulator import LIGHT
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.folders import walk
from rpaug_adapters.shared.hdf5 import opened

from rpaug import BadInput, Unsupported, files

SCRIPT = Path(__file__).with_name("simulator.py")
LEVELS, SHARE = 8, 0.01  # of 255, and of an image's pixels: drivers draw edges otherwise
DEPTH, IDS, POSE, DIMMED = "depth", "segmentation_instance", "pose", "dimmed"
ROLES = "roles.yaml"
OTHERWISE = (
    "its model or version is another, or the images were made by playing the actions again, as LIBERO does: "
    "`--color` takes the simulator's color too"
)
MANISKILL = (
    "rpaug looks at states of robosuite and LIBERO; ManiSkill looks at its own: `python -m mani_skill.trajectory."
    "replay_trajectory --use-env-states -o rgb+depth+segmentation --traj-path FILE`"
)


class Simulator:
    """The other process. Raises Unsupported for what it cannot show."""

    def __init__(self, python: Path) -> None:
        pipe = subprocess.PIPE
        self.child = subprocess.Popen(
            [python, SCRIPT], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )

    def look(self, demo: Demonstration, out: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What it says of a demonstration, and the arrays that it saw."""
        sizes = {}
        for one in demo.stored.values():
            height, width, _ = frames(demo, one.color)(0).shape
            sizes[one.camera] = [width, height]
        place = demo.place
        asked = {"path": str(place.path.resolve()), "group": place.group, "cameras": sizes}
        assert self.child.stdin is not None
        assert self.child.stdout is not None
        with suppress(OSError):
            self.child.stdin.write(json.dumps(asked | {"out": str(out)}) + "\n")
            self.child.stdin.flush()
        try:
            answer = json.loads(self.child.stdout.readline())
        except ValueError:
            answer = {"error": "it ended"}
        if "error" in answer:
            raise Unsupported(
                f"{place.path}: {place.group}: the simulator: {answer['error'][:300]}"
            )
        with np.load(out) as seen:
            return answer, dict(seen)

    def close(self) -> None:
        """Let it end."""
        assert self.child.stdin is not None
        with suppress(OSError):
            self.child.stdin.close()
        self.child.wait()


def reobserve(
    root: Path,
    target: Path,
    python: Path,
    progress: Callable[[int, int], None],
    color: bool = False,
) -> tuple[int, dict[str, str]]:
    """Write each file below `root` again, with what its simulator sees in its states, to the new folder `target`.

    `color`: the simulator's color takes the place of the stored one, and need not be like it. Returns how many
    demonstrations were written, and which were not and why. Raises BadInput.
    """
    paths = [
        path
        for folder, _, names in walk(root)
        for path in (folder / name for name in names)
        if path.suffix in places.ENDINGS
    ]
    files.see_inside(root, *paths)
    paths = [path for path in paths if places.contents(path)]
    every = [place for path in paths for place in places.contents(path)]
    failures: dict[str, str] = {}
    settled = Settled()
    simulator = Simulator(python)
    try:
        for path in paths:
            out = target / path.relative_to(root)
            out.parent.mkdir(parents=True, exist_ok=True)
            with growing(out) as file, tempfile.TemporaryDirectory() as folder:
                for place in (place for place in every if place.path == path):
                    progress(every.index(place), len(every))
                    try:
                        answer, seen, demo = _seen(simulator, place, Path(folder) / "seen.npz")
                        if not color:
                            _compare(demo, seen)
                    except (Unsupported, BadInput) as error:
                        failures[f"{path.relative_to(root).with_suffix('')}/{place.name}"] = str(
                            error
                        )
                        continue
                    _lay(file.add(place, place.name), demo, seen, color)
                    settled.add(demo, seen, answer)
    finally:
        simulator.close()
    if len(failures) == len(every):
        shutil.rmtree(target, ignore_errors=True)
    settled.write(target)
    return len(every) - len(failures), failures


def _seen(
    simulator: Simulator, place: Place, out: Path
) -> tuple[dict[str, Any], dict[str, np.ndarray], Demonstration]:
    """What the simulator sees. Raises Unsupported."""
    with opened(place.path, place.within) as file:
        demo = layouts.demo(place, file)
        group = file[place.group]
        if not place.robomimic:
            raise Unsupported(f"{place.path}: {place.group}: {MANISKILL}")
        told = "model_file" in group.attrs and "env_args" in file[DATA].attrs
        if not told or "states" not in group or len(group["states"]) != demo.steps:
            where, lacks = f"{place.path}: {place.group}", "model_file, env_args and a state a step"
            raise Unsupported(f"{where}: found no states to look at; expected {lacks}")
    return *simulator.look(demo, out), demo


def _compare(demo: Demonstration, seen: dict[str, np.ndarray]) -> None:
    """See that the color is the stored one. Raises Unsupported."""
    for one in demo.stored.values():
        color, stored = seen[f"{one.camera}/rgb"], frames(demo, one.color)
        for t, image in enumerate(color):
            off = np.abs(image.astype(np.int16) - stored(t)).max(2) > LEVELS
            if off.mean() > SHARE:
                share = f"{100 * off.mean():.1f} % of the simulator's pixels are others"
                place = f"{demo.place.path}: {demo.place.group}/{one.color}, frame {t}"
                raise Unsupported(f"{place}: {share}: {OTHERWISE}")


def _lay(group: h5py.Group, demo: Demonstration, seen: dict[str, np.ndarray], color: bool) -> None:
    """Write what was seen as robosuite and robomimic name it."""
    if NEXT in group:
        del group[NEXT]
    for one in demo.stored.values():
        new = {
            f"{one.camera}_{DEPTH}": seen[f"{one.camera}/depth"][..., None],
            f"{one.camera}_{IDS}": seen[f"{one.camera}/ids"][..., None],
            f"{one.camera}_{POSE}": seen[f"{one.camera}/pose"].reshape(demo.steps, 16),
        }
        if color:
            new[one.color.removeprefix("obs/")] = seen[f"{one.camera}/rgb"]
        dimmed = f"{one.camera}_{DIMMED}"
        new[dimmed] = seen[f"{one.camera}/dimmed"]
        for name, rows in new.items():
            rows = rows[:, ::-1] if demo.flipped and rows.ndim == 4 else rows
            if f"obs/{name}" in group:
                del group[f"obs/{name}"]
            group.create_dataset(f"obs/{name}", data=rows, compression="gzip")
        group[f"obs/{dimmed}"].attrs[layouts.LIGHT] = LIGHT


class Settled:
    """What lies beside the files: cameras by the poses in them, and roles that hold in every demonstration."""

    def __init__(self) -> None:
        self.cameras: dict[str, dict[str, Any]] = {}
        self.roles: dict[str, set[tuple[int, ...]]] = {}

    def add(self, demo: Demonstration, seen: dict[str, np.ndarray], answer: dict[str, Any]) -> None:
        """Take in a demonstration. Raises Unsupported where one camera sees with two focal lengths."""
        for name, one in demo.stored.items():
            given = {
                "K": seen[f"{one.camera}/K"].tolist(),
                "pose_key": f"observation/{one.camera}_{POSE}",
            }
            given |= {"depth": f"obs/{one.camera}_{DEPTH}", "ids": f"obs/{one.camera}_{IDS}"}
            if self.cameras.setdefault(name, given) != given:
                raise Unsupported(
                    f"{demo.place.path}: {name} differs from that of other files: put them apart"
                )
        table = [answer["instances"][name] for name in ("table",) if name in answer["instances"]]
        ids = {"robot": answer["robot"], "table": table, "manipulated": answer["moved"]}
        for role, found in ids.items():
            self.roles.setdefault(role, set()).add(tuple(found))

    def write(self, folder: Path) -> None:
        """Write `cameras.yaml`, and `roles.yaml` if any role has the same ids everywhere."""
        if not self.cameras:
            return
        given = {"version": 1, "cameras": self.cameras}
        files.write_atomic(folder / cameras.NAME, yaml.safe_dump(given, sort_keys=False).encode())
        same = {role: [*one] for role, (one, *more) in self.roles.items() if one and not more}
        roles = {"version": 1, "roles": {role: {"handle": ids} for role, ids in same.items()}}
        if same:
            files.write_atomic(folder / ROLES, yaml.safe_dump(roles, sort_keys=False).encode())
