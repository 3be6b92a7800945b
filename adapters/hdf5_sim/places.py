"""Where demonstrations lie: many in one file, or, while a dataset grows, one in a folder of its own.

`<anywhere>/<name>.hdf5` holds `data/demo_<i>` (robomimic, robosuite, LIBERO), `<anywhere>/<name>.h5` `traj_<i>`
(ManiSkill); either ending will do for either. Their keys are `<anywhere>/<name>/demo_<i>`. One that is not gathered yet
is `<anywhere>/<name>/demo_<i>/episode.hdf5`, a whole file of that layout with one demonstration in it.
"""

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import h5py
from rpaug_adapters.shared.folders import walk
from rpaug_adapters.shared.hdf5 import opened

from rpaug import BadInput, files

ENDINGS = (".hdf5", ".h5")
STAGED = "episode"  # the name of a file with one
ROBOMIMIC, MANISKILL = re.compile(r"demo_\d+"), re.compile(r"traj_\d+")
DATA, MASK = "data", "mask"  # robomimic's groups: of demonstrations, of filter keys


@dataclass(frozen=True)
class Place:
    """A demonstration's file, and its group there."""

    path: Path
    group: str

    @property
    def name(self) -> str:
        """As the file calls it: `demo_3`, `traj_3`."""
        return self.group.rpartition("/")[2]

    @property
    def robomimic(self) -> bool:
        """Whether it lies as robomimic has it, or else as ManiSkill."""
        return self.group.startswith(DATA)

    @property
    def within(self) -> tuple[str, ...]:
        """The groups of the file that belong to it."""
        return (self.group, MASK) if self.robomimic else (self.group,)


def contents(path: Path) -> list[Place]:
    """The demonstrations of a file, none in another project's. Raises BadInput."""
    with opened(path, ()) as file:
        found = [Place(path, name) for name in file if MANISKILL.fullmatch(name)]
        if isinstance(file.get(DATA, getlink=True), h5py.HardLink) and isinstance(
            file[DATA], h5py.Group
        ):
            held = [name for name in file[DATA] if ROBOMIMIC.fullmatch(name)]
            found += [Place(path, f"{DATA}/{name}") for name in held]
    return sorted(found, key=lambda place: files.natural(place.group))


def is_staged(path: Path) -> bool:
    """Whether a file is one with a single demonstration, in the folder of its key."""
    held = ROBOMIMIC.fullmatch(path.parent.name) or MANISKILL.fullmatch(path.parent.name)
    return path.stem == STAGED and bool(held)


def keys(root: Path) -> list[str]:
    """The keys of all demonstrations under a folder. A file that cannot be read is one, if it can be no other layout's
    or there are others. Raises BadInput for two files of one name."""
    found: dict[str, Path] = {}
    staged, spoilt, ours = set(), set(), False
    for folder, _, names in walk(root):
        for path in (folder / name for name in names if not name.startswith(".")):
            if path.suffix not in ENDINGS:
                continue
            if is_staged(path):
                staged.add(folder.relative_to(root).as_posix())
                continue
            stem = path.relative_to(root).as_posix().removesuffix(path.suffix)
            try:
                files.see_inside(root, path)
                held = {f"{stem}/{place.name}": path for place in contents(path)}
            except BadInput:
                spoilt.add(stem)
                ours |= path.suffix == ENDINGS[1]
                continue
            if twice := found.keys() & held:
                expected = f"one file, and there is {found[min(twice)].name}"
                raise BadInput(path, "name", found=min(twice), expected=expected)
            found |= held
    known = found.keys() | staged
    return sorted(known | spoilt if known or ours else (), key=files.natural)


def find(root: Path, key: str) -> Place:
    """Where a demonstration lies. Raises BadInput for one that is not there or lies in a file that cannot be read."""
    folder, name = (root / key).parent, PurePosixPath(key).name
    for ending in ENDINGS:
        if (path := root / key / (STAGED + ending)).is_file():
            _see_inside(root, path)
            (place,) = contents(path)[:1] or [Place(path, name)]
            return place
        for path in (folder.with_name(folder.name + ending), root / (key + ending)):
            if path.is_file():
                _see_inside(root, path)
                held = [place for place in contents(path) if place.name == name]
                if held:
                    return held[0]
    raise BadInput(root / key, "file", found="no such demonstration", expected="one in a file")


def _see_inside(root: Path, path: Path) -> None:
    """Of a file and of ManiSkill's JSON beside it. Raises BadInput."""
    files.see_inside(root, path, path.with_suffix(".json"))


def taken(root: Path, key: str) -> bool:
    """Whether there is a demonstration of that key."""
    try:
        find(root, key)
    except BadInput:
        return False
    return True
