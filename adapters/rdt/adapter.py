"""RDT and ALOHA episodes: one HDF5 file each, images as JPEG, instructions in a JSON file beside them.

`<anywhere>/<name>.hdf5` with `observations/qpos` (T, 14), `action` (T, 14) and `observations/images/<camera>`, and
`expanded_instruction_gpt-4-turbo.json` in its folder. What rpaug writes is `<anywhere>/<name>/<name>.hdf5`, so that
each episode has words and a report of its own; RDT's reader walks folders and finds it. Traps this file knows:

- RDT never turns OpenCV's BGR into RGB, so its JPEGs hold red and blue swapped (they look wrong in a viewer);
- its reader drops episodes of fewer than 128 steps without a word, and fails on one where no joint moves;
- it divides grippers by constants of its own arms; files made from other sources are multiplied by them first;
- it wants all three cameras: one that is not there is black. A single arm is the right one;
- it reads every `*.hdf5` below its folder: rejected copies end in `.h5`, so that it finds none of them.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from rpaug_adapters.rdt.read import RDTSource, read_episode, untouched
from rpaug_adapters.rdt.write import write_episode
from rpaug_adapters.shared.folders import walk, write_files

from rpaug import Adapter, BadInput, Episode, Side, files

ENDING, REJECTED_ENDING = ".hdf5", ".h5"
SHORTEST, MOVED = 128, 0.01  # steps; radians


class RDT(Adapter):
    """Reads and writes RDT's HDF5 files."""

    name: ClassVar[str] = "rdt"
    after: ClassVar[str] = "RDT's reader drops episodes of fewer than 128 steps without a word."

    def episodes(self, root: Path) -> Sequence[str]:
        keys = []
        for folder, _, names in walk(root):
            for name in names:
                path = folder / name
                if path.suffix == _ending(root) and not name.startswith("."):
                    own = path.parent.name == path.stem and path.parent != root
                    at = path.parent if own else path.with_suffix("")
                    keys.append(at.relative_to(root).as_posix())
        return sorted(keys, key=files.natural)

    def read(self, root: Path, key: str) -> Episode:
        return read_episode(root, _path(root, key), key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        if _path(root, key).exists():
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        recorded = episode.source if isinstance(episode.source, RDTSource) else None
        with files.atomic_folder(root / key) as work:
            path = work / (PurePosixPath(key).name + _ending(root))
            extra = write_episode(episode, recorded, path)
            write_files(work, {**extra, **side()})

    def rename(self, root: Path, key: str, new: str) -> None:
        path = _path(root, key)
        os.rename(path, path.with_name(PurePosixPath(new).name + path.suffix))
        super().rename(root, key, new)

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        source: RDTSource = episode.source
        shown = {*source.images.values(), *(place for place, _ in source.depths.values())}
        return untouched(source.path, shown)

    def traps(self, episode: Episode) -> Sequence[str]:
        """RDT's `HDF5VLADataset` (thu-ml/RoboticsDiffusionTransformer)."""
        found = []
        if episode.length < SHORTEST:
            found.append(f"RDT's reader drops episodes of fewer than {SHORTEST} steps")
        joints = episode.robot.joint_positions
        if not (np.abs(joints - joints[:1]) > MOVED).any():
            found.append(f"RDT's reader fails where no joint moves by {MOVED}")
        return found

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / f"episode_{index}").as_posix()


def _path(root: Path, key: str) -> Path:
    """The file of an episode: in a folder of its own, or among others."""
    own = root / key / (PurePosixPath(key).name + _ending(root))
    return own if own.is_file() else root / (key + _ending(root))


def _ending(root: Path) -> str:
    """What files end in, among rejected copies and elsewhere."""
    return REJECTED_ENDING if root.name == files.REJECTED else ENDING
