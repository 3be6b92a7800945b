"""Demonstrations of simulators in HDF5: robomimic, robosuite and LIBERO, ManiSkill.

`places` says where they lie, `layouts` what they hold and the traps of each project. What rpaug writes has the layout
that it read: a file is gathered at the end of a run, from demonstrations that lay in files of their own until then.
"""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

import h5py
from rpaug_adapters.hdf5_sim import gather, layouts, places
from rpaug_adapters.hdf5_sim.places import DATA, MANISKILL
from rpaug_adapters.hdf5_sim.read import SimSource, read_episode
from rpaug_adapters.hdf5_sim.reobserve import reobserve
from rpaug_adapters.hdf5_sim.write import described, filter_keys, reached, write_episode
from rpaug_adapters.shared.folders import PLACES, write_files
from rpaug_adapters.shared.hdf5 import opened
from rpaug_adapters.shared.texts import json_bytes

from rpaug import Adapter, BadInput, Episode, Side, files

COUNTS = ("total", "num_demos")  # attributes that are made anew
STALE = "LIBERO's trainer takes a task's words from its name, robomimic's from its settings: both pass over `ep_meta`"


class HDF5Sim(Adapter):
    """Reads and writes demonstrations of robomimic, robosuite, LIBERO and ManiSkill."""

    name: ClassVar[str] = "hdf5_sim"
    gathers: ClassVar[bool] = True

    def episodes(self, root: Path) -> Sequence[str]:
        return places.keys(root)

    def read(self, root: Path, key: str) -> Episode:
        return read_episode(root, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        if places.taken(root, key):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        recorded = episode.source if isinstance(episode.source, SimSource) else None
        with files.atomic_folder(root / key) as work:
            extra = write_episode(episode, recorded, work)
            write_files(work, {**extra, **side()})

    def key_at(self, like: str, index: int) -> str:
        path = PurePosixPath(like)
        kind = "traj" if MANISKILL.fullmatch(path.name) else "demo"
        return (path.parent / f"{kind}_{index}").as_posix()

    def key_for(self, like: str, index: int) -> str:
        parts = [part for part in PurePosixPath(like).parts[:-1] if part not in PLACES]
        return PurePosixPath(*parts, f"demo_{index}").as_posix()

    def traps(self, episode: Episode) -> Sequence[str]:
        """What trainers do with words that are no longer those of the file."""
        source = episode.source
        return [STALE] if isinstance(source, SimSource) and source.demo.reworded else []

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        source: SimSource = episode.source
        place, edited, found = source.demo.place, reached(source), {}
        # Dimmed images are left out where the color changed.
        dimmed = {one.dimmed for one in source.demo.stored.values()}
        with opened(place.path, place.within) as file:
            group = file[place.group]
            for name, held in layouts.datasets(place, group):
                if name in dimmed:
                    continue
                kind = repr((held.dtype.str, held.shape, held.chunks, held.compression))
                values = held[()] if name not in edited else b""
                plain = isinstance(values, bytes) or values.dtype.kind != "O"
                found[name] = kind.encode() + (bytes(values) if plain else repr(values).encode())
                found |= _attributes(name, held)
            found |= _attributes("demonstration", group)
            if place.robomimic:
                found |= _attributes(DATA, file[DATA])
                keys = filter_keys(file, place)
                found |= {f"mask/{key}": b"%d" % (place.name in keys[key]) for key in keys}
        if (about := described(place)) is not None:
            found["json"] = json_bytes({**about["episodes"][0], "episode_id": None})
        return found

    def faults(self, root: Path) -> Sequence[str]:
        """Counts, filter keys and lists of episodes that are not those of the files."""
        return [*gather.faults(root)]

    def reobserve(
        self,
        root: Path,
        target: Path,
        simulator: Path,
        progress: Callable[[int, int], None],
        color: bool = False,
    ) -> tuple[int, Mapping[str, str]]:
        return reobserve(root, target, simulator, progress, color)

    def finish(self, source: Path, target: Path) -> None:
        """Demonstrations into shared files."""
        gather.gather(target)

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:
        """Demonstrations out of shared files."""
        gather.scatter(root, spoilt)


def _attributes(name: str, held: h5py.HLObject) -> dict[str, bytes]:
    """The attributes of a group or dataset, but for those that edits reach and that are counted anew."""
    given = dict(held.attrs)
    words = given.pop(layouts.WORDS, None)
    own = None if words is None else json.loads(words)
    if isinstance(own, dict):
        own.pop("lang", None)
    given |= {layouts.WORDS: own} if own else {}
    left = {layouts.CAMERAS, *COUNTS}
    return {
        f"{name}, attribute {key}": repr(one).encode()
        for key, one in given.items()
        if key not in left
    }
