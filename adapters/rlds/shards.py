"""Where the records of an RLDS dataset lie: packed in shards as TFDS lays them out, or one file each while it grows.

A finished dataset has `dataset_info.json` and `<name>-<split>.tfrecord-<i>-of-<n>`. Until then each episode is a folder
`<split>/<number>/` with one record in `episode.tfrecord`, so that it can appear by one rename. `pack` gathers them
shard by shard, so that no more than one shard lies there twice. What is packed so far stands in `packing.json`: TFDS
takes a dataset for whole as soon as it has `dataset_info.json`.
"""

import json
import math
import os
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.shared.folders import drop_staged, staged, ungathered
from rpaug_adapters.shared.texts import read_json, stamp

from rpaug import BadInput, files

INFO = "dataset_info.json"
PACKING = "packing.json"
STAGED = "episode.tfrecord"
LONGEST = 200  # bytes of a file's name
MOST = 2**20  # episodes of a split: more is taken for damage, before any is listed
USUAL = 256  # records of a shard where no source says
TEMPLATE = "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}"


@dataclass(frozen=True)
class Split:
    """One split of a finished dataset: how many records each of its files holds."""

    name: str
    paths: tuple[Path, ...]
    lengths: tuple[int, ...]

    @cached_property
    def count(self) -> int:
        """How many records all its files hold."""
        return sum(self.lengths)

    def find(self, number: int) -> tuple[Path, int]:
        """The file of a record and its place there. Raises BadInput where file and `dataset_info.json` differ."""
        for path, length in zip(self.paths, self.lengths, strict=True):
            if number < length:
                files.see_inside(path.parent, path)
                held = len(tfrecord.places(path))
                if held != length:
                    raise BadInput(
                        path, "records", found=str(held), expected=f"{length}, as {INFO} says"
                    )
                return path, number
            number -= length
        raise IndexError(number)


def info(folder: Path, name: str = INFO) -> dict[str, Any]:
    """What `dataset_info.json` says, or a file like it. Raises BadInput."""
    path = folder / name
    described = read_json(path, "a description by TFDS")
    if not isinstance(described, dict) or not isinstance(described.get("splits"), list):
        raise BadInput(path, "splits", found="none", expected="a list of splits")
    kind = described.get("fileFormat", "tfrecord")
    if kind != "tfrecord":
        raise BadInput(path, "fileFormat", found=str(kind), expected="tfrecord")
    return described


def called(folder: Path) -> str:
    """The dataset's name: what its description says, else its folder's, `<name>/<version>`. Raises BadInput."""
    for name in (INFO, PACKING):
        if (folder / name).is_file():
            return str(info(folder, name).get("name") or folder.parent.name)
    return folder.parent.name


def splits(folder: Path) -> Mapping[str, Split]:
    """The packed splits of a dataset, or what is packed so far. Raises BadInput."""
    for name in (INFO, PACKING):
        if any(at := stamp(folder / name)):
            return _splits(folder, name, *at)
    return {}


@lru_cache(16)
def _splits(folder: Path, name: str, _modified: int, _size: int) -> Mapping[str, Split]:
    described, found = info(folder, name), {}
    for entry in described["splits"]:
        name, lengths = _named(folder, entry)
        if name in found:
            raise BadInput(folder / INFO, "splits", found=f"{name!r} twice", expected="each once")
        template = str(entry.get("filepathTemplate") or TEMPLATE)
        paths = tuple(
            folder / _file(template, str(described.get("name")), name, i, len(lengths))
            for i in range(len(lengths))
        )
        found[name] = Split(name, paths, lengths)
    return found


def _named(folder: Path, entry: Any) -> tuple[str, tuple[int, ...]]:
    name = entry.get("name") if isinstance(entry, dict) else None
    try:
        lengths = tuple(int(length) for length in entry["shardLengths"])
    except (KeyError, TypeError, ValueError, OverflowError):
        lengths = (-1,)
    wrong = (
        not isinstance(name, str)
        or not name
        or set("/\\\0") & set(name)
        or name[0] == "."
        or len(name) > LONGEST // 4
    )
    if wrong or any(length < 0 for length in lengths) or sum(lengths) > MOST:
        expected = "a name and shardLengths"
        raise BadInput(folder / INFO, "splits", found=str(entry)[:80], expected=expected)
    assert isinstance(name, str)
    return name, lengths


def _file(template: str, dataset: str, split: str, i: int, count: int) -> str:
    fields = {
        "DATASET": dataset,
        "SPLIT": split,
        "FILEFORMAT": "tfrecord",
        "SHARD_INDEX": f"{i:05d}",
        "NUM_SHARDS": f"{count:05d}",
        "SHARD_X_OF_Y": f"{i:05d}-of-{count:05d}",
    }
    name = template
    for field, value in fields.items():
        name = name.replace("{" + field + "}", value)
    plain = Path(name.replace("\0", "")).name.encode(errors="replace")[:LONGEST]
    return plain.decode(errors="ignore") or "-"  # never outside the dataset's folder


def faults(folder: Path) -> Iterator[str]:
    """Where the shards of a packed dataset hold other records, or bytes of records, than its description says."""
    if not (folder / INFO).is_file():
        return
    given = {entry["name"]: entry.get("numBytes") for entry in info(folder)["splits"]}
    for name, split in splits(folder).items():
        held = [[length for _, length in tfrecord.places(path)] for path in split.paths]
        if tuple(map(len, held)) != split.lengths:
            lengths = (
                f"found {list(split.lengths)}; expected {[*map(len, held)]}, as the shards hold"
            )
            yield f"{folder / INFO}: {name}: shardLengths: {lengths}"
        total = sum(map(sum, held))
        if given[name] is not None and str(given[name]) != str(total):
            counts = f"found {given[name]}; expected {total}, as the records have"
            yield f"{folder / INFO}: {name}: numBytes: {counts}"


def record(folder: Path, split: str, number: int) -> tuple[str, bytes]:
    """What to call an episode's record, and its bytes. Raises BadInput."""
    packed = splits(folder).get(split)
    if packed is not None and number < packed.count:
        path, place = packed.find(number)
    else:
        path, place = folder.joinpath(split, str(number), STAGED), 0
    return f"{path}: record {place}", tfrecord.read(path, place)


def pack(source: Path, folder: Path) -> None:
    """Gather an output's episodes into shards like its source's and describe them.

    With as many episodes as the source's the shards are divided alike. Killed at any point, every record is still
    there, packed or not, and the next `pack` comes to the same bytes.
    """
    held = {name: split.count for name, split in splits(folder).items()}
    if not (folder / INFO).is_file() or ungathered(folder, STAGED, held):
        unpack(folder)
        if numbers := staged(folder, STAGED):
            _pack(source, folder, numbers)
    _sweep(folder)


def _pack(source: Path, folder: Path, numbers: dict[str, list[int]]) -> None:
    like_source = (source / INFO).is_file()
    described = info(source) if like_source else _described(folder, numbers)
    like = splits(source) if like_source else {name: Split(name, (), ()) for name in numbers}
    given = [entry for entry in described["splits"] if entry["name"] in numbers]
    entries = [entry | {"numBytes": "0", "shardLengths": []} for entry in given]
    for i, entry in enumerate(given):
        for own in _shards(described, entry, like[entry["name"]], folder, numbers[entry["name"]]):
            entries[i] = entry | own
            _note(folder, described | {"splits": entries})
            _drop(folder / entry["name"], numbers[entry["name"]], own["shardLengths"])
    same = like_source and entries == described["splits"]
    data = json.dumps(described | {"splits": entries}, indent=2).encode()
    data = files.read_bytes(source / INFO) if same else data
    files.write_atomic(folder / INFO, data, durable=True)


def _note(folder: Path, described: dict[str, Any]) -> None:
    """Say what is packed so far."""
    files.write_atomic(folder / PACKING, json.dumps(described, indent=2).encode(), durable=True)


def _described(folder: Path, numbers: dict[str, list[int]]) -> dict[str, Any]:
    """A dataset that was none of TFDS's before: called after its folder, `<name>/<version>`."""
    return {
        "fileFormat": "tfrecord",
        "name": folder.parent.name,
        "splits": [{"filepathTemplate": TEMPLATE, "name": name} for name in numbers],
        "version": folder.name,
    }


def _shards(
    described: dict[str, Any], entry: dict[str, Any], like: Split, folder: Path, numbers: list[int]
) -> Iterator[dict[str, Any]]:
    """Write the shards of a split; after each, what its description says of those written so far."""
    lengths = _divided(len(numbers), like.lengths)
    total, rest = 0, iter(numbers)
    staged_in = os.fspath(folder / like.name)
    template = str(entry.get("filepathTemplate") or TEMPLATE)
    for i, length in enumerate(lengths):
        name = _file(template, str(described.get("name")), like.name, i, len(lengths))
        work = folder / f".{name}{files.PART}"
        with work.open("wb") as shard:
            for _ in range(length):
                with open(f"{staged_in}/{next(rest)}/{STAGED}", "rb") as stream:
                    shutil.copyfileobj(stream, shard, 2**20)
                    total += stream.tell() - tfrecord.FRAME
        files.flush(work)
        os.replace(work, folder / name)
        written = [*lengths[: i + 1], *[0] * (len(lengths) - i - 1)]
        yield {"numBytes": str(total), "shardLengths": [str(length) for length in written]}


def _divided(count: int, like: Sequence[int]) -> list[int]:
    """How many records each shard gets: as in the source, or even shards of about its size."""
    if count == sum(like):
        return list(like)
    usual = math.ceil(sum(like) / len(like)) if sum(like) else USUAL
    shards = max(1, math.ceil(count / usual))
    return [count // shards + (i < count % shards) for i in range(shards)]


def unpack(folder: Path, spoilt: Collection[Path] | None = None) -> None:
    """Back to one file an episode, the last shard first: a finished output is to grow, or packing ended on its way.

    Records of `spoilt` files, and those that cannot be read, are left out if such files are named; else the first
    raises BadInput.
    """
    packed = splits(folder)
    if not packed:
        return
    if (folder / INFO).is_file():
        os.replace(folder / INFO, folder / PACKING)
    described = info(folder, PACKING)
    for split, entry in zip(packed.values(), described["splits"], strict=True):
        lengths = list(split.lengths)
        while any(lengths):
            last = max(i for i, length in enumerate(lengths) if length)
            for number in range(sum(lengths[:last]), sum(lengths)):
                path = folder / split.name / str(number) / STAGED
                if not path.exists() and split.paths[last] not in (spoilt or ()):
                    with suppress(*() if spoilt is None else (BadInput,)):
                        data = tfrecord.read(*split.find(number))
                        files.write_atomic(path, tfrecord.frame(data))
            lengths[last] = 0
            entry["shardLengths"] = [str(length) for length in lengths]
            _note(folder, described)
            split.paths[last].unlink(missing_ok=True)


def _drop(within: Path, numbers: Sequence[int], lengths: Sequence[str]) -> None:
    """Remove the single files of the shard that was written last, and their folders where nothing lies beside them."""
    counts = [int(length) for length in lengths if int(length)]
    for number in numbers[sum(counts[:-1]) : sum(counts)]:
        own = f"{within}/{number}"
        os.unlink(f"{own}/{STAGED}")
        if not os.listdir(own):
            os.rmdir(own)


def _sweep(folder: Path) -> None:
    """Remove what stands in the description, or is of another, and empty folders of episodes."""
    packed = splits(folder)
    known = {path for split in packed.values() for path in split.paths}
    for path in folder.glob("*.tfrecord-*-of-*"):
        if path not in known:
            path.unlink()
    drop_staged(folder, packed, (STAGED,))
    (folder / PACKING).unlink(missing_ok=True)
