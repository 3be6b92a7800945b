"""Writing a demonstration into a file of its own: the recorded group, copied whole, with what changed laid into it.

HDF5 copies a group with its chunks, compression, attributes and order; what changed is written into the copied
datasets, so that all of that stays.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from rpaug_adapters.hdf5_sim import layouts
from rpaug_adapters.hdf5_sim.layouts import CAMERAS, PARAMETERS, WORDS, Demonstration
from rpaug_adapters.hdf5_sim.places import DATA, MANISKILL, MASK, STAGED, Place
from rpaug_adapters.hdf5_sim.read import SimSource, frames
from rpaug_adapters.shared import cameras, fresh
from rpaug_adapters.shared.hdf5 import dataset, member, opened
from rpaug_adapters.shared.texts import json_bytes, read_json

from rpaug import BadInput, Camera, CameraView, Episode, Unsupported, geometry

OPENGL = np.diag([1.0, -1, -1, 1])  # its camera's axes in OpenCV's
Frame = Callable[[int], np.ndarray]


def write_episode(episode: Episode, recorded: SimSource | None, work: Path) -> dict[str, bytes]:
    """Fill a folder with the demonstration's own file; returns the files to lay beside it. Raises Unsupported."""
    if recorded is None:
        _fresh(episode, work)
        return {cameras.NAME: _beside(episode)}
    place = recorded.demo.place
    with (
        opened(place.path, place.within) as source,
        h5py.File(work / (STAGED + place.path.suffix), "w") as target,
    ):
        copy(source, place, target, place.name)
        store_filter_keys(target, own_keys(source, place))
        group = target[place.group]
        for name, view in episode.views.items():
            _lay(group, recorded, name, view)
        _reword(group, episode, recorded.demo)
        placed = _place_cameras(group, episode, recorded)
    extra = {}
    if (about := described(place)) is not None:
        extra[f"{STAGED}.json"] = json_bytes(about)
    extra |= cameras.brought(recorded.beside)
    rest = {**episode.views, **{name: recorded.views[name] for name in placed}}
    return extra | cameras.moved(replace(episode, views=rest), recorded.views, recorded.beside)


def copy(source: h5py.File, place: Place, target: h5py.File, name: str) -> None:
    """Copy a demonstration to a file that may hold others, under a name; the first brings what belongs to the file."""
    if not len(target):
        _copy_common(source, place, target)
    source.copy(source[place.group], target[DATA] if place.robomimic else target, name)


def _copy_common(source: h5py.File, place: Place, target: h5py.File) -> None:
    """Copy all but the demonstrations and filter keys: attributes, and whatever else lies in the file."""
    groups = [(source, target)]
    if place.robomimic:
        groups.append((source[DATA], target.create_group(DATA)))
    for old, new in groups:
        for key, value in old.attrs.items():
            new.attrs[key] = value
    for other in source:
        if other not in (DATA, MASK) and not MANISKILL.fullmatch(other):
            member(place.path, source, other)
            with opened(place.path, (other,)):
                source.copy(other, target)


def filter_keys(source: h5py.File, place: Place) -> dict[str, list[str]]:
    """The names of the demonstrations of each of robomimic's filter keys. Raises BadInput."""
    link = source.get(MASK, getlink=True)
    if not place.robomimic or not isinstance(link, h5py.HardLink):
        return {}
    found = {}
    for key in source[MASK]:
        held = dataset(place.path, source, f"{MASK}/{key}")
        if held.ndim != 1 or held.dtype.kind not in "SO":
            where, expected = f"{MASK}/{key}", "names of demonstrations"
            raise BadInput(place.path, where, found=str(held.dtype), expected=expected)
        found[key] = [str(one, "utf-8", "replace") for one in held[()]]
    return found


def own_keys(source: h5py.File, place: Place) -> dict[str, list[str]]:
    """The filter keys that name a demonstration, or do not, as a file of its own has them."""
    given = filter_keys(source, place)
    return {key: [place.name] * (place.name in names) for key, names in given.items()}


def store_filter_keys(target: h5py.File, given: dict[str, list[str]]) -> None:
    """Write filter keys as robomimic does."""
    for key, names in given.items():
        target[f"{MASK}/{key}"] = np.array(names, "S" if names else "S1")


def described(place: Place) -> dict[str, Any] | None:
    """What ManiSkill's JSON beside a file says, of its episodes this one alone. Raises BadInput."""
    path = place.path.with_suffix(".json")
    if place.robomimic or not path.is_file():
        return None
    given, number = read_json(path, "a description by ManiSkill"), int(place.name.partition("_")[2])
    listed = given.get("episodes") if isinstance(given, dict) else None
    for one in listed if isinstance(listed, list) else ():
        if isinstance(one, dict) and one.get("episode_id") == number:
            return {**given, "episodes": [one]}
    raise BadInput(path, "episodes", found=f"none for {place.name}", expected="one a trajectory")


def _lay(group: h5py.Group, recorded: SimSource, name: str, view: CameraView) -> None:
    """Write what changed of a camera's images into the copied datasets."""
    demo, stored, before = recorded.demo, recorded.stored[name], recorded.views[name]
    if view.rgb is not before.rgb:
        _store(group, demo, stored.color, view.rgb)
        if stored.dimmed is not None:
            del group[stored.dimmed]  # it shows what was recorded
    if stored.depth is not None and view.depth is not before.depth:
        assert view.depth is not None
        assert before.depth is not None
        codes = _codes(demo, stored.depth, view.depth, before.depth, stored.metres)
        _store(group, demo, stored.depth, codes)
    if stored.ids is not None and view.ids is not before.ids:
        assert view.ids is not None
        assert before.ids is not None
        _store(group, demo, stored.ids, _codes(demo, stored.ids, view.ids, before.ids, 1))


def _codes(demo: Demonstration, name: str, new: Frame, old: Frame, unit: float) -> Frame:
    """Images in the numbers of a dataset: what no edit touched keeps its own."""
    recorded = frames(demo, name)

    def at(t: int) -> np.ndarray:
        codes, values = recorded(t), new(t)
        scaled = values if unit == 1 else values / np.float32(unit)
        if codes.dtype.kind in "iu":
            scaled = np.clip(np.rint(scaled), 0, np.iinfo(codes.dtype).max)
        return np.where(values == old(t), codes, scaled.astype(codes.dtype))

    return at


def _store(group: h5py.Group, demo: Demonstration, name: str, image: Frame) -> None:
    """Write images where the recorded ones were; `next_obs` follow. Raises Unsupported where they never did."""
    held = group[name]
    new = np.stack([image(t) for t in range(demo.length)])
    new = (new[:, ::-1] if demo.flipped else new).reshape(demo.length, *held.shape[1:])
    if demo.following:
        later = group[f"next_{name}"]
        if not np.array_equal(later[:-1], held[1:]):
            where = f"{demo.place.path}: {demo.place.group}/next_{name}"
            raise Unsupported(f"{where} is not {name} one step later: no edit can follow it")
        later[...] = new[1:]
    held[...] = new[: len(held)]


def _reword(group: h5py.Group, episode: Episode, demo: Demonstration) -> None:
    """The demonstration's own words, where they are no longer those of its file."""
    if episode.descriptions != demo.words:
        given = layouts.attribute(demo.place, group, WORDS)
        given = given if isinstance(given, dict) else {}
        group.attrs[WORDS] = json.dumps(given | {"lang": episode.instruction}, indent=4)


def _place_cameras(group: h5py.Group, episode: Episode, recorded: SimSource) -> set[str]:
    """Write moved cameras where the file itself places them; returns their views."""
    done = set()
    for name, view in episode.views.items():
        camera, stored = view.camera, recorded.stored[name]
        own = stored.camera in recorded.demo.own.cameras and name not in recorded.beside.cameras
        if camera is recorded.views[name].camera or not own:
            continue
        if not recorded.demo.place.robomimic:
            _place_in_maniskill(group[f"{PARAMETERS}/{stored.camera}"], camera)
        elif camera.fixed:
            given = layouts.attribute(recorded.demo.place, group, CAMERAS)
            given[stored.camera]["extrinsics"] = camera.cam_to_world[0].tolist()
            group.attrs[CAMERAS] = json.dumps(given, indent=4)
        else:
            continue
        done.add(name)
    return done


def _place_in_maniskill(group: h5py.Group, camera: Camera) -> None:
    held = group["extrinsic_cv"]
    held[...] = geometry.inverse(camera.cam_to_world)[:, : held.shape[1]]
    if "cam2world_gl" in group:
        group["cam2world_gl"][...] = camera.cam_to_world @ OPENGL


def _fresh(episode: Episode, work: Path) -> None:
    """Robomimic's layout from another source."""
    tracks = fresh.tracks(episode)
    if fresh.ACTION not in tracks:
        raise Unsupported(f"{episode.key}: robomimic needs actions; the source names none")
    with h5py.File(work / f"{STAGED}.hdf5", "w") as file:
        data, group = file.create_group(DATA), file.create_group(f"{DATA}/demo_0")
        control = {} if episode.rate is None else {"control_freq": episode.rate}
        given = {"env_name": "recorded", "type": 2, "env_kwargs": control}
        data.attrs["env_args"], data.attrs["total"] = json.dumps(given), episode.length
        group.attrs["num_samples"] = episode.length
        if episode.instruction:
            group.attrs[WORDS] = json.dumps({"lang": episode.instruction})
        for name, rows in tracks.items():
            at = "actions" if name == fresh.ACTION else name.replace("observation/", "obs/", 1)
            group[at] = rows
        for name, view in episode.views.items():
            images = {f"{name}_image": view.rgb, f"{name}_depth": view.depth}
            if not view.inferred:
                images[f"{name}_segmentation_instance"] = view.ids
            for which, image in images.items():
                if image is not None:
                    whole = np.stack([image(t) for t in range(episode.length)])
                    whole = whole if whole.ndim == 4 else whole[..., None]
                    chunks = (1, *whole.shape[1:])
                    group.create_dataset(
                        f"obs/{which}", None, None, whole, chunks=chunks, compression="gzip"
                    )


def _beside(episode: Episode) -> bytes:
    """What `cameras.yaml` says, so that the file can be read with all it had."""

    def images(name: str) -> str:
        view, _, kind = name.rpartition("_")
        return f"obs/{view}_{'depth' if kind == 'depth' else 'segmentation_instance'}"

    return fresh.beside(episode, lambda name: name, images)


def reached(source: SimSource) -> set[str]:
    """The datasets that edits reach, by their places below the demonstration."""
    names: set[str] = set()
    for one in source.stored.values():
        names |= {*one.names, *(f"next_{name}" for name in one.names)}
        names |= {f"{PARAMETERS}/{one.camera}/{kind}" for kind in ("extrinsic_cv", "cam2world_gl")}
    return names
