"""Gathering demonstrations into shared files, filter keys, totals and ManiSkill's JSON among them.

A file grows beside the old one and is read whole before it takes its place; until then the demonstrations' own files
stay, so that a killed run loses nothing.
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
from rpaug_adapters.hdf5_sim import layouts
from rpaug_adapters.hdf5_sim.places import DATA, ENDINGS, STAGED, Place, contents, is_staged
from rpaug_adapters.hdf5_sim.read import frames
from rpaug_adapters.hdf5_sim.write import (
    copy,
    described,
    filter_keys,
    own_keys,
    store_filter_keys,
)
from rpaug_adapters.shared.folders import walk
from rpaug_adapters.shared.hdf5 import opened
from rpaug_adapters.shared.texts import json_bytes, read_json

from rpaug import BadInput, files


def gather(root: Path) -> None:
    """Gather all that lies in files of its own below a folder."""
    groups: dict[Path, dict[str, Place]] = {}
    for folder, _, names in walk(root):
        for path in (folder / name for name in names):
            if path.suffix in ENDINGS and is_staged(path):
                shared = folder.parent.with_name(folder.parent.name + path.suffix)
                groups.setdefault(shared, {})[folder.name] = contents(path)[0]
            elif path.name == f"{STAGED}.json" and not any(
                path.with_suffix(ending).exists() for ending in ENDINGS
            ):
                path.unlink()
    for path, staged in groups.items():
        _gather(path, staged)


def _gather(path: Path, staged: Mapping[str, Place]) -> None:
    before = {place.name: place for place in contents(path)} if path.exists() else {}
    places = sorted({**before, **staged}.items(), key=lambda one: files.natural(one[0]))
    with growing(path) as file:
        for name, place in places:
            file.add(place, name)
    for place in staged.values():
        place.path.unlink()
        place.path.with_suffix(".json").unlink(missing_ok=True)


def scatter(root: Path, spoilt: Collection[Path]) -> None:
    """Demonstrations of shared files below a folder into files of their own; what lies in `spoilt` ones, or cannot be
    read, is left out."""
    for folder, _, names in walk(root):
        for path in (folder / name for name in names if not name.startswith(".")):
            if path.suffix not in ENDINGS or is_staged(path):
                continue
            about = path.with_suffix(".json")
            with suppress(BadInput):
                for place in () if {path, about} & {*spoilt} else contents(path):
                    with suppress(BadInput):
                        _take_out(place)
            path.unlink()
            about.unlink(missing_ok=True)


def _take_out(place: Place) -> None:
    """A demonstration into a file of its own. Raises BadInput."""
    own = place.path.with_suffix("") / place.name / (STAGED + place.path.suffix)
    own.parent.mkdir(parents=True, exist_ok=True)
    work = own.with_name(f".{own.name}{files.PART}")
    about = described(place)
    with opened(place.path, place.within) as source, h5py.File(work, "w") as target:
        copy(source, place, target, place.name)
        store_filter_keys(target, own_keys(source, place))
    if about is not None:
        files.write_atomic(own.with_suffix(".json"), json_bytes(about))
    os.replace(work, own)


class GrowingFile:
    """A file of demonstrations that grows beside the one whose place it takes in the end."""

    def __init__(self, path: Path, target: h5py.File) -> None:
        self.path, self.target = path, target
        self.keys: dict[str, list[str]] = {}
        self.listed: dict[str, Any] = {}

    def add(self, place: Place, name: str) -> h5py.Group:
        """Copy a demonstration under a name, with what belongs to it; returns its group."""
        with opened(place.path, place.within) as source:
            copy(source, place, self.target, name)
            for key, names in filter_keys(source, place).items():
                self.keys.setdefault(key, []).extend([name] if place.name in names else [])
        if (one := described(place)) is not None:
            own = one["episodes"][0] | {"episode_id": int(name.partition("_")[2])}
            self.listed = {
                **one,
                **self.listed,
                "episodes": [*self.listed.get("episodes", ()), own],
            }
        return (self.target[DATA] if place.robomimic else self.target)[name]

    def close(self) -> None:
        """Write what the file says of all."""
        store_filter_keys(self.target, self.keys)
        if DATA in self.target:
            for name, count in _counts(self.target[DATA]).items():
                self.target[DATA].attrs.modify(name, count)


@contextmanager
def growing(path: Path) -> Iterator[GrowingFile]:
    """A file to add demonstrations to: read whole, and in its place, once the block succeeds and has added any."""
    work = path.with_name(f".{path.name}{files.PART}")
    try:
        with h5py.File(work, "w") as target:
            file = GrowingFile(path, target)
            yield file
            file.close()
        if _read(work):
            os.replace(work, path)
    finally:
        work.unlink(missing_ok=True)
    if file.listed:
        files.write_atomic(path.with_suffix(".json"), json_bytes(file.listed))


def _counts(data: h5py.Group) -> dict[str, int]:
    """The counts that a file states of itself, as they must be."""
    counts = {
        "total": sum(int(one.attrs["num_samples"]) for one in data.values()),
        "num_demos": len(data),
    }
    return {name: count for name, count in counts.items() if name in data.attrs}


def _read(path: Path) -> int:
    """Decode everything in a new file; returns how many demonstrations there are. Raises BadInput."""
    places = contents(path)
    for place in places:
        with opened(place.path, place.within) as file:
            demo = layouts.demo(place, file)
        for one in demo.stored.values():
            for name in filter(None, (one.color, one.depth, one.ids)):
                frames(demo, name)(0)
    return len(places)


def faults(root: Path) -> Iterator[str]:
    """Where files say of themselves what is not so."""
    for folder, _, names in walk(root):
        for path in (folder / name for name in names if not name.startswith(".")):
            if path.suffix in ENDINGS and path.stem != STAGED and (places := contents(path)):
                yield from _faults(path, places)


def _faults(path: Path, places: list[Place]) -> Iterator[str]:
    names = {place.name for place in places}
    if places[0].robomimic:
        with opened(path, tuple(place.group for place in places)) as file:
            for name, count in _counts(file[DATA]).items():
                if (found := file[DATA].attrs[name]) != count:
                    yield f"{path}: {DATA}, attribute {name}: found {found}; expected {count}"
            for key, held in filter_keys(file, places[0]).items():
                if gone := sorted({*held} - names):
                    yield f"{path}: mask/{key}: found {gone[0]}; expected demonstrations that are there"
    elif (about := path.with_suffix(".json")).is_file():
        given = read_json(about, "a description by ManiSkill")
        listed = {f"traj_{one['episode_id']}" for one in given["episodes"]}
        if listed != names:
            yield f"{about}: episodes: found {len(listed)}; expected those of the file, {len(names)}"
