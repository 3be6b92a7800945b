"""Fitted scenes on disk: one zarr 3 group each, whole or absent, named by what it was made from.

A group holds the Gaussians' arrays, each body's instance ids and track, and attributes: format, version, key,
settings, report, and a SHA-256 of every array and of the attributes themselves. Arrays are compressed (zstd).
The key is a hash of the recorded content, the bodies found in it and the settings, so that a fit is found again for
the same episode wherever it lies, and never for another. A scene that borrows another's static Gaussians
(`rpaug.gaussians.sharing`) keeps their row numbers and instance ids alone, and the other's key.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from jaxtyping import Int32
from zarr.codecs import ZstdCodec

from rpaug.core import memo
from rpaug.core.ahead import in_order
from rpaug.core.errors import BadInput
from rpaug.core.files import PART, atomic_folder
from rpaug.core.types import Body, Episode, Gaussians, Gaussians4, Scene
from rpaug.gaussians import frame_residuals

FORMAT, VERSION = "rpaug scene", 3
ENDING = ".zarr"
FLOWING = ("means", "left", "right", "scales", "opacities", "sh", "ids", "origin")


@dataclass(frozen=True)
class Borrowed:
    """Static Gaussians of the scene stored under `lender`: its `rows`, which are `gaussians` with instance ids of
    here.
    """

    donor_key: str
    rows: Int32[np.ndarray, "m"]
    gaussians: Gaussians

    def __len__(self) -> int:
        return len(self.rows)

    def without(self, instance_ids: Collection[int]) -> "Borrowed":
        """The same but for some instances."""
        keep = ~np.isin(self.gaussians.ids, list(instance_ids))
        arrays = {name: getattr(self.gaussians, name)[keep] for name in Gaussians.ARRAYS}
        return Borrowed(self.donor_key, self.rows[keep], Gaussians(**arrays))


@dataclass(frozen=True)
class Stored:
    """What a store gives back: parts of a scene; `settings` and `report` are plain values."""

    gaussians: Gaussians
    bodies: tuple[Body, ...]
    pose_correction: Mapping[str, np.ndarray]
    irradiance: np.ndarray | None
    settings: Mapping[str, Any]
    report: Mapping[str, Any]
    flowing: Gaussians4 | None = None
    borrowed: Borrowed | None = None


@memo.once
def key(scene: Scene, settings: Any, seed: int, donor_key: str = "") -> str:
    """Hash of all that a fit depends on: every recorded image, cameras, gripper, bodies, settings, seed, and the key
    of the scene that lends it Gaussians."""
    digest = hashlib.sha256(f"{FORMAT} {VERSION} {seed} {donor_key}".encode())
    digest.update(json.dumps(counting(_plain(settings)), sort_keys=True).encode())
    for body in scene.bodies:
        digest.update(f"{sorted(body.instance_ids)} {body.motion} {body.reference}".encode())
        _add(digest, body.to_world)
    episode: Episode = scene.episode
    robot = episode.robot
    for array in (robot.joint_positions, robot.gripper_to_world, robot.gripper_open):
        if array is not None:
            _add(digest, array)
    for name in sorted(episode.views):
        view = episode.views[name]
        digest.update(name.encode() + b"\0")
        _add(digest, view.camera.K)
        _add(digest, view.camera.cam_to_world)
        reads = [read for read in (view.rgb, view.depth, view.ids) if read is not None]
        images = (partial(read, t) for t in range(episode.length) for read in reads)
        for image in in_order(images):
            _add(digest, image)
    return digest.hexdigest()[:32]


def path_of(folder: Path, name: str) -> Path:
    """Where a store keeps the scene called by its key."""
    return folder / f"{name}{ENDING}"


def save(
    folder: Path,
    name: str,
    scene: Scene,
    *,
    settings: Any,
    report: Any,
    borrowed: Borrowed | None = None,
) -> Path:
    """Write the scene's Gaussians and bodies under its key; one rename at the end.

    `borrowed` are its first Gaussians, of which no second copy is kept. Raises BadInput if it is there already or the
    scene has no Gaussians.
    """
    if scene.gaussians is None:
        raise BadInput(folder, "scene", found="no Gaussians", expected="a fitted scene")
    facts: dict[str, Any] = {"format": FORMAT, "version": VERSION, "key": name}
    count = len(borrowed) if borrowed else 0
    arrays = {
        f"gaussians/{n}": np.asarray(getattr(scene.gaussians, n))[count:] for n in Gaussians.ARRAYS
    }
    if borrowed:
        for n in Gaussians.ARRAYS:
            same = np.array_equal(
                getattr(scene.gaussians, n)[:count], getattr(borrowed.gaussians, n)
            )
            assert same, f"borrowed {n} were changed"
        facts["borrowed"] = {"lender": borrowed.donor_key, "gaussians": count}
        arrays |= {"borrowed/rows": borrowed.rows, "borrowed/ids": borrowed.gaussians.ids}
    residuals = frame_residuals.packed(scene.gaussians.frame_residuals)
    arrays |= {f"moments/{n}": array for n, array in residuals.items()}
    bodies = []
    for number, body in enumerate(scene.bodies):
        arrays[f"bodies/{number}"] = np.asarray(body.to_world)
        bodies.append(
            {
                "handles": sorted(map(int, body.instance_ids)),
                "motion": body.motion,
                "reference": body.reference,
                "residual": body.residual,
                "ambiguous": body.ambiguous,
            }
        )
    if scene.flowing is not None:
        arrays |= {f"flowing/{n}": np.asarray(getattr(scene.flowing, n)) for n in FLOWING}
        facts["pace"] = scene.flowing.pace
    if scene.irradiance is not None:
        arrays["irradiance"] = np.asarray(scene.irradiance)
    for camera, pose_correction in scene.pose_correction.items():
        arrays[f"drift/{camera}"] = np.asarray(pose_correction)
    target = path_of(folder, name)
    with atomic_folder(target) as work:
        group = zarr.open_group(work, mode="w", zarr_format=3)
        for where, array in arrays.items():
            group.create_array(where, data=np.ascontiguousarray(array), compressors=ZstdCodec())
        facts |= {"settings": _plain(settings), "report": _plain(report), "bodies": bodies}
        facts |= {"cameras": sorted(scene.pose_correction)}
        facts |= {"sha256": {where: _checksum(array) for where, array in arrays.items()}}
        group.attrs.update(facts | {"sha256_of_facts": _fingerprint(facts)})
    return target


def names(folder: Path) -> list[str]:
    """Keys of all scenes in a store, sorted; damaged ones among them. Raises BadInput if there is no such folder."""
    if not folder.is_dir():
        raise BadInput(folder, "store", found="no folder", expected="a folder of stored scenes")
    return sorted(p.name.removesuffix(ENDING) for p in folder.glob(f"[!.]*{ENDING}") if p.is_dir())


def named(folder: Path, start: str) -> str:
    """The one key in a store that begins with `start`. Raises BadInput if there is none or several."""
    found = [name for name in names(folder) if name.startswith(start)]
    if start in found or len(found) == 1:
        return start if start in found else found[0]
    few = ", ".join((found or names(folder))[:8]) or "none: the store is empty"
    given = f"{len(found)} scenes that begin with it" if found else "no such scene"
    raise BadInput(folder, f"scene {start!r}", found=given, expected=f"one of: {few}")


def remove(folder: Path, name: str) -> None:
    """Take a scene out of a store: gone at once, by one rename, before its files are deleted."""
    where = path_of(folder, name)
    doomed = folder / f".{name}-{os.getpid()}{PART}"
    os.replace(where, doomed)
    shutil.rmtree(doomed, ignore_errors=True)


def described(folder: Path, name: str) -> dict[str, Any]:
    """What is known of a stored scene without reading its arrays: facts, and bytes on disk.

    Raises BadInput for one whose facts are damaged or foreign.
    """
    where = path_of(folder, name)
    group, facts = _open(where)
    size = sum(path.stat().st_size for path in where.rglob("*") if path.is_file())
    count: Any = group["gaussians/means"]
    borrowed = facts.get("borrowed", {}).get("gaussians", 0)
    return {**facts, "gaussians": int(count.shape[0]) + borrowed, "bytes": size}


def borrowers(folder: Path, name: str) -> list[str]:
    """The scenes that borrow from this one and cannot be read without it; damaged ones tell nothing."""
    found = []
    for other in names(folder):
        with suppress(BadInput):
            facts = described(folder, other)
            if facts.get("borrowed", {}).get("lender") == name:
                found.append(other)
    return found


def load(folder: Path, name: str) -> Stored | None:
    """The scene stored under a key, None if there is none. Raises BadInput for a damaged or foreign one."""
    where = path_of(folder, name)
    if not where.is_dir():
        return None
    group, facts = _open(where)
    sums: Any = facts["sha256"]
    loaded = {n: _read(where, group, f"gaussians/{n}", sums) for n in Gaussians.ARRAYS}
    donated = _borrowed(folder, where, group, facts) if "borrowed" in facts else None
    if donated:
        loaded = {
            n: np.concatenate([getattr(donated.gaussians, n), loaded[n]]) for n in Gaussians.ARRAYS
        }
    described: Any = facts["bodies"]
    bodies = tuple(
        Body(
            frozenset(facts_of["handles"]),
            _read(where, group, f"bodies/{number}", sums),
            facts_of["motion"],
            facts_of["reference"],
            facts_of["residual"],
            facts_of["ambiguous"],
        )
        for number, facts_of in enumerate(described)
    )
    cameras: Any = facts["cameras"]
    pose_correction = {camera: _read(where, group, f"drift/{camera}", sums) for camera in cameras}
    plain: Any = facts
    light = _read(where, group, "irradiance", sums) if "irradiance" in sums else None
    held = [name[len("moments/") :] for name in sums if name.startswith("moments/")]
    residuals = frame_residuals.unpacked(
        {n: _read(where, group, f"moments/{n}", sums) for n in held}
    )
    gaussians = Gaussians(**loaded, frame_residuals=residuals)
    flowing = None
    if "pace" in facts:
        more = {n: _read(where, group, f"flowing/{n}", sums) for n in FLOWING}
        flowing = Gaussians4(**more, pace=plain["pace"])
    return Stored(
        gaussians,
        bodies,
        pose_correction,
        light,
        plain["settings"],
        plain["report"],
        flowing,
        donated,
    )


def _borrowed(folder: Path, where: Path, group: zarr.Group, facts: Mapping[str, Any]) -> Borrowed:
    """What another scene of the store lends this one. Raises BadInput if that is gone, or damaged."""
    donor_key = facts["borrowed"]["lender"]
    found = load(folder, donor_key)
    if found is None:
        raise BadInput(where, "borrowed", found=f"no scene {donor_key} in the store", expected="it")
    rows = _read(where, group, "borrowed/rows", facts["sha256"])
    donated = {n: getattr(found.gaussians, n)[rows] for n in Gaussians.ARRAYS}
    donated["ids"] = _read(where, group, "borrowed/ids", facts["sha256"])
    return Borrowed(donor_key, rows, Gaussians(**donated))


def _open(where: Path) -> tuple[zarr.Group, dict[str, Any]]:
    """The group and its attributes, checked. Raises BadInput."""
    try:
        group = zarr.open_group(where, mode="r", zarr_format=3)
        facts: dict[str, Any] = dict(group.attrs)
    except (OSError, ValueError, KeyError) as error:
        raise BadInput(where, "scene", found=str(error), expected="a stored scene") from None
    if facts.get("format") != FORMAT or facts.get("version") != VERSION:
        found = f"{facts.get('format')} {facts.get('version')}"
        raise BadInput(where, "format", found=found, expected=f"{FORMAT} {VERSION}")
    if facts.pop("sha256_of_facts", None) != _fingerprint(facts):
        raise BadInput(
            where, "attributes", found="a wrong checksum", expected="undamaged attributes"
        )
    return group, facts


def _fingerprint(facts: Mapping[str, Any]) -> str:
    """Of the attributes as JSON brings them back."""
    plain = json.loads(json.dumps(facts))  # keys become text before they are sorted
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def _read(where: Path, group: zarr.Group, name: str, sums: Mapping[str, str]) -> np.ndarray:
    try:
        array = np.asarray(group[name][...])  # type: ignore[index]
    except Exception as error:  # whatever a damaged chunk makes the codecs raise
        raise BadInput(where, name, found=str(error), expected="an undamaged array") from None
    if _checksum(array) != sums.get(name):
        raise BadInput(where, name, found="a wrong checksum", expected="an undamaged array")
    return array


def _checksum(array: np.ndarray) -> str:
    digest = hashlib.sha256()
    _add(digest, array)
    return digest.hexdigest()


def _add(digest: Any, array: np.ndarray) -> None:
    digest.update(f"{array.dtype.str}{array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())


def counting(facts: Any) -> Any:
    """Settings less what a result does not depend on: the number of threads, and the CPU where it is what fitted.

    What a GPU fitted has a key of its own: its sums round otherwise, and the CPU's results are the same bit for bit.
    """
    if not isinstance(facts, dict):
        return facts
    kept = {name: counting(value) for name, value in facts.items() if name != "threads"}
    if kept.get("backend") in ("auto", "numba"):
        del kept["backend"]
    return kept | ({"threads": 2} if "threads" in facts else {})  # as ever: stores outlive versions


def _plain(value: Any) -> Any:
    """A dataclass as JSON values; its arrays, kept by the store as such, left out."""
    if not is_dataclass(value) or isinstance(value, type):
        return value
    return {
        f.name: _plain(getattr(value, f.name))
        for f in fields(value)
        if f.name not in ("bodies", "pose_correction", "irradiance")
    }
