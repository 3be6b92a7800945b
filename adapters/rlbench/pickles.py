"""Pickles without running them: a whitelist reader, and a writer that old readers understand.

A pickle is a program. Before one is opened its opcodes are walked without executing them (their codes and arguments
are those of `pickletools.opcodes`) and held against bounds that no honest file exceeds; then it is loaded with every
global looked up in a table of stand-ins. Whatever is not in the table is refused by name.
"""

import io
import pickle
import pickletools
from pathlib import Path
from typing import Any

import numpy as np

from rpaug import BadInput, files, kernel

MAX_BYTES = 256 * 2**20


class Demo:
    """Stand-in for `rlbench.demo.Demo`; its state is whatever the file held."""


class Observation:
    """Stand-in for `rlbench.backend.observation.Observation`."""


class _ArrayClass:
    """Stands where a pickle names `numpy.ndarray`: good for nothing but `_reconstruct`."""


def _reconstruct(kind: object, shape: object, code: object) -> np.ndarray:
    """An empty array for `__setstate__` to fill; numpy checks shape against bytes there."""
    if kind is not _ArrayClass or shape != (0,):
        raise pickle.UnpicklingError("an array of an unusual kind")
    return np.empty(0, np.int8)


def _dtype(code: object, align: object = False, copy: object = True) -> np.dtype:
    if not isinstance(code, str) or len(code) > 16:
        raise pickle.UnpicklingError(f"data type {code!r:.40}")
    return np.dtype(code)


def _scalar(kind: np.dtype, data: bytes) -> Any:
    if kind.hasobject or len(data) != kind.itemsize:
        raise pickle.UnpicklingError("a scalar of an unusual kind")
    return np.frombuffer(data, kind)[0]


def _frombuffer(data: Any, kind: np.dtype, shape: tuple[int, ...], order: str) -> np.ndarray:
    return np.frombuffer(bytearray(data), kind).reshape(shape, order=order)


def _encode(text: str, codec: str) -> bytes:
    """How protocols up to 2 spell bytes."""
    if codec != "latin1":
        raise pickle.UnpicklingError(f"the codec {codec!r:.40}")
    return text.encode("latin1")


_NAMES: dict[tuple[str, str], Any] = {
    ("rlbench.demo", "Demo"): Demo,
    ("rlbench.backend.observation", "Observation"): Observation,
    ("numpy", "ndarray"): _ArrayClass,
    ("numpy", "dtype"): _dtype,
    ("_codecs", "encode"): _encode,
}
for _core in ("numpy.core", "numpy._core"):
    _NAMES[f"{_core}.multiarray", "_reconstruct"] = _reconstruct
    _NAMES[f"{_core}.multiarray", "scalar"] = _scalar
    _NAMES[f"{_core}.numeric", "_frombuffer"] = _frombuffer

_FORBIDDEN = [
    "PERSID",
    "BINPERSID",
    "EXT1",
    "EXT2",
    "EXT4",
    "INST",
    "OBJ",
    "NEXT_BUFFER",
    "READONLY_BUFFER",
]
_MEMO = ["PUT", "BINPUT", "LONG_BINPUT"]  # they name where in a list of that length a value is kept
_CODES = {op.name: ord(op.code) for op in pickletools.opcodes}
# By opcode: bytes of its argument, minus the bytes of its own count of bytes, or minus ten times a number of lines.
_UNKNOWN, _LINE = -100, -10
_COUNTS = {pickletools.TAKEN_FROM_ARGUMENT1: -1, pickletools.TAKEN_FROM_ARGUMENT4: -4,
           pickletools.TAKEN_FROM_ARGUMENT4U: -4, pickletools.TAKEN_FROM_ARGUMENT8U: -8,
           pickletools.UP_TO_NEWLINE: _LINE}  # fmt: skip
_SIZES = np.full(256, _UNKNOWN)
for _op in pickletools.opcodes:
    _SIZES[ord(_op.code)] = _COUNTS.get(_op.arg.n, _op.arg.n) if _op.arg else 0
_SIZES[_CODES["GLOBAL"]] = 2 * _LINE
_SIZES[[_CODES[name] for name in _FORBIDDEN]] = _UNKNOWN
_PUT, _STOP = np.array([_CODES[name] for name in _MEMO]), _CODES["STOP"]


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise pickle.UnpicklingError(f"the foreign global {module}.{name}")
        return _NAMES[module, name]


def _check(path: Path, data: bytes) -> None:
    """Refuse what could exhaust memory before the loader sees it. Raises BadInput."""
    at, index, most = _first_fault(np.frombuffer(data, np.uint8), _SIZES, _PUT, _STOP)
    if at < 0:
        return
    found, expected = f"memo index {index}", f"at most {most}"
    if at == len(data):
        found, expected = "an end in the middle", "a whole pickle"
    elif index < 0:
        name = next((name for name, code in _CODES.items() if code == data[at]), f"{data[at]:#x}")
        found, expected = f"opcode {name}", "plain arrays, numbers and text"
    raise BadInput(path, "pickle", found=found, expected=expected)


@kernel
def _first_fault(data, sizes, puts, stop):
    """(where, memo index, largest allowed): an opcode that is not known, or a memo index above the number of opcodes
    before it. -1 is nowhere, the length of the data an argument beyond its end."""
    at, count = 0, 0
    while at < len(data):
        code, start = data[at], at + 1
        size = sizes[code]
        if size <= _UNKNOWN:
            return at, -1, count
        end, value = start, 0
        if size > 0:
            end += size
        elif size <= _LINE:
            for _ in range(size // _LINE):
                while end < len(data) and data[end] != 10:
                    end += 1
                end += 1
        elif size < 0:
            end -= size
        if end > len(data):
            return len(data), -1, count
        if size > _LINE:  # little endian, and a line of digits
            for i in range(min(end, start + 8) - 1, start - 1, -1):
                value = value * 256 + data[i]
            if size < 0:
                if value < 0 or value > len(data) - end:
                    return len(data), -1, count
                end += value
        elif (code == puts).any():
            for i in range(start, end - 1):
                value = min(value * 10 + data[i] - 48, 2**40)
        if (code == puts).any() and (value < 0 or value > count):
            return at, value, count
        if code == stop:
            return -1, 0, 0
        at, count = end, count + 1
    return len(data), -1, count


def load(path: Path) -> Any:
    """The object in `path`. Raises BadInput for anything but whitelisted globals and plain values."""
    data = files.read_bytes(path)
    if len(data) > MAX_BYTES:
        raise BadInput(path, "size", found=f"{len(data)} bytes", expected=f"at most {MAX_BYTES}")
    try:
        _check(path, data)
        return _Reader(io.BytesIO(data)).load()
    except BadInput:
        raise
    except Exception as error:  # a hostile stream can make the loader raise anything at all
        found = str(error) or type(error).__name__
        raise BadInput(
            path,
            "pickle",
            found=found[:200],
            expected="an RLBench pickle: demo, observations, numpy arrays",
        ) from None


class _Writer(pickle._Pickler):  # type: ignore[name-defined]  # the C pickler insists on importing what it names
    """Names our stand-ins as RLBench's classes and numpy's internals as numpy 1 did.

    RVT and RLBench run numpy <= 1.24, which has no `numpy._core`.
    """

    def save_global(self, obj: Any, name: str | None = None) -> None:
        module, name = _CLASSES.get(obj) or (obj.__module__, obj.__qualname__)
        self.save(module.replace("numpy._core", "numpy.core"))
        self.save(name)
        self.write(pickle.STACK_GLOBAL)
        self.memoize(obj)

    dispatch = dict(pickle._Pickler.dispatch)  # type: ignore[attr-defined]
    dispatch[type] = save_global
    dispatch[type(load)] = save_global


_CLASSES = {
    Demo: ("rlbench.demo", "Demo"),
    Observation: ("rlbench.backend.observation", "Observation"),
}


def dump(value: Any) -> bytes:
    """Protocol-4 bytes of `value`, readable by RLBench under numpy 1."""
    stream = io.BytesIO()
    _Writer(stream, protocol=4).dump(value)
    return stream.getvalue()
