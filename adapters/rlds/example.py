"""A `tf.train.Example` as it lies in its bytes: parsed without copying, and edited without touching the rest.

The wire format is protocol buffers' (protobuf.dev, "Encoding"): `Example { Features features = 1 }`,
`Features { map<string, Feature> feature = 1 }`, and a Feature is one of `BytesList = 1`, `FloatList = 2`,
`Int64List = 3`, each with `value = 1`, numbers packed or one by one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from jaxtyping import Float32, Int64

from rpaug import BadInput

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5
LONGEST = 10  # bytes of a varint
KINDS = {1: "bytes", 2: "float", 3: "int"}
Span = tuple[int, int]


@dataclass(frozen=True)
class Feature:
    """Where one entry of the map lies: the whole of it, and its values in order (packed runs in one span)."""

    kind: str | None  # "bytes" | "float" | "int", None for an empty Feature
    entry: Span
    values: tuple[tuple[int, Span], ...]  # wire type and place


class Example:
    """One record, taken apart. Raises BadInput, naming the byte, for anything that is not an Example."""

    def __init__(self, where: str, data: bytes) -> None:
        self.where, self.data = where, data
        self.features: dict[str, Feature] = {}
        self._blobs: dict[str, list[bytes]] = {}
        self._map: tuple[int, Span] | None = None  # where its tag starts, and its entries
        at = 0
        for field, wire, span in self._fields((0, len(data))):
            if field == 1 and wire == LENGTH:
                if self._map is not None:
                    self._wrong(span[0], "a second map of features")
                self._map = at, span
                self._read_map(span)
            at = span[1]
        if self._map is None:
            self._wrong(0, "no map of features")

    def _read_map(self, span: Span) -> None:
        at = span[0]
        for field, wire, inner in self._fields(span):
            if field == 1 and wire == LENGTH:
                name, feature = self._entry((at, inner[1]), inner)
                if name in self.features:
                    self._wrong(inner[0], f"feature {name!r} twice")
                self.features[name] = feature
            at = inner[1]

    def _entry(self, entry: Span, span: Span) -> tuple[str, Feature]:
        name, kind, values = None, None, []
        for field, wire, inner in self._fields(span):
            if field == 1 and wire == LENGTH:
                try:
                    name = self.data[slice(*inner)].decode()
                except UnicodeDecodeError:
                    self._wrong(inner[0], "a feature's name that is no UTF-8")
            elif field == 2 and wire == LENGTH:
                for which, _, list_span in self._fields(inner):
                    kind = KINDS.get(which)
                    if kind is None:
                        self._wrong(list_span[0], f"a list of unknown kind {which}")
                    values = [(w, s) for f, w, s in self._fields(list_span) if f == 1]
        if name is None:
            self._wrong(span[0], "a feature without a name")
        return name, Feature(kind, entry, tuple(values))

    def _fields(self, span: Span) -> Iterator[tuple[int, int, Span]]:
        """Field number, wire type and place of the payload of each field of a message."""
        at, end = span
        data = self.data
        while at < end:
            tag = data[at]
            if tag < 0x80:  # nearly always
                at += 1
            else:
                tag, at = self._varint(at, end)
            field, wire = tag >> 3, tag & 7
            if wire == LENGTH:
                size, at = self._varint(at, end)
            elif wire == VARINT:
                _, stop = self._varint(at, end)
                size = stop - at
            elif wire in (FIXED64, FIXED32):
                size = 8 if wire == FIXED64 else 4
            else:
                self._wrong(at, f"wire type {wire}")
            if size > end - at:
                self._wrong(at, f"a field of {size} bytes where {end - at} are left")
            yield field, wire, (at, at + size)
            at += size

    def _varint(self, at: int, end: int) -> tuple[int, int]:
        value = 0
        for shift in range(0, 70, 7):
            if at >= end:
                self._wrong(at, "a cut-off number")
            byte = self.data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value, at
        return self._wrong(at, "a number of more than ten bytes")

    def _wrong(self, at: int, found: str) -> NoReturn:
        raise BadInput(self.where, f"byte {at}", found=found, expected="a tf.train.Example")

    def _of(self, name: str, kind: str) -> Feature:
        feature = self.features.get(name)
        if feature is None or feature.kind not in (kind, None):
            found = "nothing" if feature is None else f"values of kind {feature.kind}"
            raise BadInput(self.where, name, found=found, expected=f"values of kind {kind}")
        return feature

    def blobs(self, name: str) -> list[bytes]:
        """The byte strings of a feature, cut out of the record once. Raises BadInput."""
        if name not in self._blobs:
            values = self._of(name, "bytes").values
            self._blobs[name] = [self.data[a:b] for wire, (a, b) in values if wire == LENGTH]
        return self._blobs[name]

    def floats(self, name: str) -> Float32[np.ndarray, "n"]:
        """The floats of a feature. Raises BadInput."""
        feature = self._of(name, "float")
        for wire, (start, end) in feature.values:
            if wire not in (LENGTH, FIXED32) or (end - start) % 4:
                self._wrong(start, "floats that are not of four bytes")
        packed = b"".join(self.data[slice(*span)] for _, span in feature.values)
        return np.frombuffer(packed, "<f4")

    def integers(self, name: str) -> Int64[np.ndarray, "n"]:
        """The integers of a feature. Raises BadInput."""
        feature = self._of(name, "int")
        for wire, (start, _) in feature.values:
            if wire not in (LENGTH, VARINT):
                self._wrong(start, "integers that are not varints")
        packed = b"".join(self.data[slice(*span)] for _, span in feature.values)
        raw = np.frombuffer(packed, np.uint8)
        ends = np.flatnonzero(raw < 0x80)
        if not len(raw):
            return np.zeros(0, np.int64)
        starts = np.concatenate([[0], ends[:-1] + 1])
        if not len(ends) or ends[-1] != len(raw) - 1 or (ends - starts).max() >= LONGEST:
            self._wrong(feature.entry[0], "a cut-off or endless integer")
        shift = 7 * (np.arange(len(raw)) - np.repeat(starts, ends - starts + 1))
        parts = (raw & 0x7F).astype(np.uint64) << shift.astype(np.uint64)
        return np.add.reduceat(parts, starts).astype(np.int64)

    def numbers(self, name: str) -> Float32[np.ndarray, "n"] | Int64[np.ndarray, "n"]:
        """Floats or integers, as the feature holds them. Raises BadInput."""
        feature = self.features.get(name)
        return self.integers(name) if feature and feature.kind == "int" else self.floats(name)

    def replaced(self, changes: Mapping[str, Sequence[bytes] | np.ndarray | None]) -> bytes:
        """The record with other values in some features, None for one left out; every other byte of it as it was."""
        if not changes:
            return self.data
        assert self._map is not None
        tag, (start, end) = self._map
        parts, at = [], start
        for name, feature in self.features.items():
            if name in changes:
                first, last = feature.entry
                values = changes[name]
                parts += [self.data[at:first], b"" if values is None else _entry(name, values)]
                at = last
        parts.append(self.data[at:end])
        return b"".join([self.data[:tag], _field(1, b"".join(parts)), self.data[end:]])


def example(features: Mapping[str, Sequence[bytes] | np.ndarray]) -> bytes:
    """A record from byte strings, float32 arrays and integer arrays, in the order given."""
    return _field(1, b"".join(_entry(name, values) for name, values in features.items()))


def _entry(name: str, values: Sequence[bytes] | np.ndarray) -> bytes:
    if not isinstance(values, np.ndarray):
        feature = _field(1, b"".join(_field(1, value) for value in values))
    elif values.dtype.kind == "f":
        feature = _field(2, _field(1, values.astype("<f4").tobytes()))
    else:
        feature = _field(3, _field(1, _varints(values)))
    return _field(1, _field(1, name.encode()) + _field(2, feature))


def _field(number: int, payload: bytes) -> bytes:
    return _number(number << 3 | LENGTH) + _number(len(payload)) + payload


def _varints(values: Int64[np.ndarray, "n"]) -> bytes:
    """Whole numbers packed: seven bits a byte, the lowest first, the highest bit set in all but the last."""
    whole = values.astype(np.int64).view(np.uint64)
    most = int(whole.max(initial=0)).bit_length()
    shifts = 7 * np.arange(max(1, -(-most // 7)), dtype=np.uint64)
    rest = whole[:, None] >> shifts
    there = (rest > 0) | (shifts == 0)
    more = np.pad(there[:, 1:], ((0, 0), (0, 1)))
    return ((rest & 0x7F).astype(np.uint8) | more.astype(np.uint8) << 7)[there].tobytes()


def _number(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
