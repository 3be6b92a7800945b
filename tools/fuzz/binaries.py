"""Spoilt records, pickles, HDF5, parquet and video: their own structure changed, with right checksums around it."""

import io
import pickle
import pickletools
import struct
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import sealed
from images import spoilt_image
from rpaug_adapters.rlbench import pickles
from rpaug_adapters.rlds import tfrecord
from rpaug_adapters.rlds.example import Example, example
from trees import WEIRD, bytes_bent

NUMBERS = (0, 1, 127, 128, 2**31, 2**35, 2**63, 2**64 - 1, 2**70)
HOSTILE = (
    b"cos\nsystem\n(S'true'\ntR.", b"cbuiltins\nexec\n(S'1'\ntR.", b"csubprocess\nrun\n(S'true'\ntR.",
    b"cnumpy\nndarray\n(M\xff\xffM\xff\xff\x86tR.", b"c_codecs\nencode\n(X\x01\x00\x00\x00aX\x03\x00\x00\x00rottR.",
    b"crlbench.demo\nDemo\n)\x81}(X\x09\x00\x00\x00__class__K\x01ub.",
    b"cnumpy\ndtype\n(X\x10\x00\x00\x00V9999999999999999tR.",
)  # fmt: skip


def _varint(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def spoilt_records(data: bytes, rng: np.random.Generator) -> bytes:
    """A TFRecord file of one Example, changed within: checksums are right but in one of twelve."""
    record = data[tfrecord.HEAD.size : -tfrecord.FOOT.size]
    match rng.integers(12):
        case 0:
            return bytes_bent(data, rng)
        case 1:
            length = struct.pack("<Q", [0, 1, 2**31, 2**40, 2**63, 2**64 - 1][int(rng.integers(6))])
            return length + tfrecord.FOOT.pack(tfrecord._masked(length)) + data[12:]
        case 2 | 3 | 4:
            return tfrecord.frame(bytes_bent(record, rng))
        case 5:
            at = int(rng.integers(len(record)))
            number = _varint(NUMBERS[int(rng.integers(len(NUMBERS)))])
            return tfrecord.frame(record[:at] + number + record[at + len(number) :])
        case _:
            return tfrecord.frame(_features_bent(record, rng))


def _features_bent(record: bytes, rng: np.random.Generator) -> bytes:
    parsed = Example("seed", record)
    held: dict[str, Any] = {}
    for name, feature in parsed.features.items():
        held[name] = parsed.blobs(name) if feature.kind in ("bytes", None) else parsed.numbers(name)
    names = list(held)
    name = names[int(rng.integers(len(names)))]
    values = held[name]
    match rng.integers(7):
        case 0:
            del held[name]
        case 1:
            held[name] = values[: int(rng.integers(len(values) + 1))]
        case 2:
            held[name] = [rng.bytes(int(rng.integers(9))) for _ in range(len(values))]
        case 3:
            odd = [np.nan, np.inf, -np.inf, 1e38]
            held[name] = np.full(len(values), odd[int(rng.integers(4))], np.float32)
        case 4:
            held[name] = np.full(len(values), [0, -1, 2**62, 7][int(rng.integers(4))], np.int64)
        case 5:
            held[names[int(rng.integers(len(names)))]] = values
        case _:
            if isinstance(values, list) and values:
                at = int(rng.integers(len(values)))
                held[name] = [*values[:at], spoilt_image(values[at], rng), *values[at + 1 :]]
    return example(held)


def spoilt_pickle(data: bytes, rng: np.random.Generator) -> bytes:
    """A pickle with opcodes or values changed, hostile ones among them."""
    match rng.integers(6):
        case 0:
            return bytes_bent(data, rng)
        case 1:
            return _value_bent(data, rng)
        case 2:
            hostile = HOSTILE[int(rng.integers(len(HOSTILE)))]
            ops = [at for _, _, at in pickletools.genops(data)]
            at = ops[int(rng.integers(len(ops)))]
            return data[:at] + hostile + data[at:]
        case _:
            return _opcodes_bent(data, rng)


def _opcodes_bent(data: bytes, rng: np.random.Generator) -> bytes:
    ops = list(pickletools.genops(data))
    starts = [at for _, _, at in ops] + [len(data)]
    parts = [data[a:b] for a, b in pairwise(starts)]
    at = int(rng.integers(1, len(parts)))
    other = parts[int(rng.integers(1, len(parts)))]
    match rng.integers(6):
        case 0:
            del parts[at]
        case 1:
            parts[at] = other
        case 2:
            parts.insert(at, other)
        case 3:
            parts[at:at] = [b"]\x94(", *[b"h\x01" for _ in range(20)], b"e"]
        case 4:
            huge = [b"\x8e" + struct.pack("<Q", 2**40), b"\x8d" + struct.pack("<Q", 2**60), b"r\xff\xff\xff\x7f",
                    b"B\xff\xff\xff\x7f", b"\x8b\xff\xff\xff\x7f", b"I" + b"9" * 5000 + b"\n"]  # fmt: skip
            parts.insert(at, huge[int(rng.integers(len(huge)))])
        case _:
            parts[at] = parts[at][:1] + bytes_bent(parts[at][1:], rng)
    return b"".join(parts)


def _value_bent(data: bytes, rng: np.random.Generator) -> bytes:
    demo = pickles._Reader(io.BytesIO(data)).load()
    odd = (*WEIRD, np.zeros(0), np.full(7, np.nan), np.array("x"), np.zeros((2, 3)), np.array([None]), 1j, b"x",
           np.zeros(7, "V3"), np.eye(4) * 2, np.zeros((4, 4)), np.full((3, 3), 1e308))  # fmt: skip
    value = odd[int(rng.integers(len(odd)))]
    if isinstance(demo, list):
        return pickle.dumps([value, *demo][: int(rng.integers(3))])
    if not isinstance(demo, pickles.Demo):
        return pickle.dumps(value)
    observations = demo._observations
    match rng.integers(4):
        case 0:
            demo._observations = value
        case 1:
            del observations[int(rng.integers(len(observations)))]
        case _:
            state = observations[int(rng.integers(len(observations)))].__dict__
            if rng.random() < 0.5 and isinstance(state.get("misc"), dict):
                state = state["misc"]
            names = list(state)
            state[names[int(rng.integers(len(names)))]] = value
    return pickles.dump(demo)


def spoilt_hdf5(data: bytes, rng: np.random.Generator) -> bytes:
    """An HDF5 file with an object changed; or bytes of its headers, heaps and trees, sealed again if they were."""
    blind = rng.random()
    if blind < 0.5 and data[8] >= 2:  # the superblock's version: 2 and 3 seal all parts
        return sealed.spoilt(data, rng)
    if blind < 0.6:
        signatures = [b"TREE", b"SNOD", b"HEAP", b"GCOL", b"\x89HDF"]
        marks = [at for s in signatures for at in _all(data, s)] + [int(rng.integers(len(data)))]
        at = marks[int(rng.integers(len(marks)))]
        span = slice(at, at + int(rng.choice([16, 64, 512])))
        return data[: span.start] + bytes_bent(data[span], rng) + data[span.stop :]
    stream = io.BytesIO(data)
    with h5py.File(stream, "r+", libver="latest" if data[8] >= 2 else None) as file:
        names: list[str] = []
        file.visit(names.append)
        name = names[int(rng.integers(len(names)))]
        if rng.random() < 0.9:
            _object_bent(file, name, rng)
        else:
            file.attrs["x"] = np.void(rng.bytes(30))
    return stream.getvalue()


def _all(data: bytes, mark: bytes) -> list[int]:
    found, at = [], data.find(mark)
    while at >= 0:
        found.append(at)
        at = data.find(mark, at + 1)
    return found


def _object_bent(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    old = file[name][()] if isinstance(file[name], h5py.Dataset) else None
    del file[name]
    makers: list[Callable[[], Any]] = [
        lambda: None,
        lambda: file.create_dataset(name, (2**40,), "f8", chunks=(2**16,)),
        lambda: file.create_dataset(name, (3, 2**30, 2**20, 3), "u1", chunks=(1, 64, 64, 3)),
        lambda: file.create_dataset(name, data=h5py.Empty("f4")),
        lambda: file.create_dataset(name, data=np.float64(3)),
        lambda: file.create_dataset(name, data=np.full((3, 14), np.nan)),
        lambda: file.create_dataset(name, data=np.zeros((0, 14))),
        lambda: file.create_dataset(name, data=np.array([(1, 2.0)] * 3, [("a", "i4"), ("b", "f8")])),
        lambda: file.create_dataset(name, data=["ä", "b", "c"], dtype=h5py.string_dtype()),
        lambda: file.create_dataset(name, (3,), h5py.ref_dtype),
        lambda: file.create_dataset(name, (3, 14), h5py.vlen_dtype(np.float32)),
        lambda: file.create_dataset(name, (3, 14), "f4", external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)]),
        lambda: file.create_group(name),
        lambda: file.__setitem__(name, h5py.SoftLink("/action")),
        lambda: file.__setitem__(name, h5py.ExternalLink("/etc/passwd", "/x")),
        lambda: file.__setitem__(name, file["/"]),
        lambda: file.create_dataset(name, data=np.zeros((3, 14), np.complex64)),
        lambda: file.create_dataset(name, data=np.array([spoilt_image(bytes(x), rng) for x in old], "S")),
        lambda: file.create_dataset(name, data=old[:2]),
    ]  # fmt: skip
    try:
        makers[int(rng.integers(len(makers)))]()
    except (TypeError, IndexError, ValueError):
        file.attrs["y"] = 1


def spoilt_parquet(data: bytes, rng: np.random.Generator) -> bytes:
    """A table with columns or values changed; or bytes of its pages or its footer."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if rng.random() < 0.6:
        (length,) = struct.unpack("<I", data[-8:-4])
        at = len(data) - 8 - length if rng.random() < 0.6 else 0
        part = bytes_bent(data[at:-8], rng)
        size = struct.pack("<I", len(part)) if at else data[-8:-4]
        return data[:at] + part + size + data[-4:]
    table = pq.read_table(io.BytesIO(data))
    at = int(rng.integers(table.num_columns))
    name, length = table.column_names[at], table.num_rows
    columns = [
        pa.nulls(length), pa.array(["x"] * length), pa.array([-1] * length), pa.array([2**62] * length),
        pa.array([float("nan")] * length), pa.array([[1.0]] * length), pa.array([[]] * length),
        pa.array([{"bytes": rng.bytes(9), "path": "/etc/passwd"}] * length), pa.array([[None]] * length),
    ]  # fmt: skip
    match rng.integers(4):
        case 0:
            table = table.drop_columns([name])
        case 1:
            table = table.slice(0, int(rng.integers(length + 1)))
        case 2 if isinstance(table[name][0].as_py(), dict):
            images = [
                {"bytes": spoilt_image(value["bytes"], rng), "path": None}
                for value in table[name].to_pylist()
            ]
            table = table.set_column(at, name, pa.array(images))
        case _:
            table = table.set_column(at, name, columns[int(rng.integers(len(columns)))])
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def spoilt_video(data: bytes, rng: np.random.Generator) -> bytes:
    """An MP4 with a box's size, type or content changed; or bytes of its frames."""
    boxes = [at - 4 for name in (b"moov", b"trak", b"mdhd", b"stsd", b"avc1", b"avcC", b"stts", b"stsz", b"stco",
                                 b"stsc", b"stss", b"ctts", b"elst", b"mdat", b"tkhd", b"mvhd")
             for at in _all(data, name)]  # fmt: skip
    at = boxes[int(rng.integers(len(boxes)))]
    (size,) = struct.unpack_from(">I", data, at)
    raw = bytearray(data)
    match rng.integers(4):
        case 0:
            struct.pack_into(
                ">I", raw, at, [0, 1, 8, 2**31, 2**32 - 1, size + 8][int(rng.integers(6))]
            )
        case 1:
            raw[at + 4 : at + 8] = rng.bytes(4)
        case 2:
            place = at + 8 + 4 * int(rng.integers(max(1, (size - 8) // 4)))
            if place + 4 <= len(raw):
                struct.pack_into(
                    ">I", raw, place, [0, 1, 2, 2**16, 2**31, 2**32 - 1][int(rng.integers(6))]
                )
        case _:
            raw[at + 8 : at + size] = bytes_bent(bytes(raw[at + 8 : at + size]), rng)
    return bytes(raw)


def spoilt(path: Path) -> Callable[[bytes, np.random.Generator], bytes]:
    """What spoils a file of its kind."""
    from trees import spoilt_json, spoilt_lines, spoilt_yaml

    by = {
        ".json": spoilt_json, ".jsonl": spoilt_lines, ".yaml": spoilt_yaml, ".pkl": spoilt_pickle,
        ".hdf5": spoilt_hdf5, ".h5": spoilt_hdf5, ".parquet": spoilt_parquet, ".mp4": spoilt_video,
        ".png": spoilt_image,
    }  # fmt: skip
    return spoilt_records if ".tfrecord" in path.name else by[path.suffix]
