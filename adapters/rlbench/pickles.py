"""Pickles without running them: a whitelist reader, and a writer that old readers understand.

A pickle is a program. Before one is opened its opcodes are listed (`pickletools.genops` parses without executing)
and held against bounds that no honest file exceeds; then it is loaded with every global looked up in a table of
stand-ins. Whatever is not in the table is refused by name.
"""

import io
import pickle
import pickletools
from pathlib import Path
from typing import Any

import numpy as np

from rpaug import BadInput, files

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

_FORBIDDEN = {
    "PERSID",
    "BINPERSID",
    "EXT1",
    "EXT2",
    "EXT4",
    "INST",
    "OBJ",
    "NEXT_BUFFER",
    "READONLY_BUFFER",
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise pickle.UnpicklingError(f"the foreign global {module}.{name}")
        return _NAMES[module, name]


def _check(path: Path, data: bytes) -> None:
    """Refuse what could exhaust memory before the loader sees it."""
    for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
        if opcode.name in _FORBIDDEN:
            raise BadInput(
                path,
                "pickle",
                found=f"opcode {opcode.name}",
                expected="plain arrays, numbers and text",
            )
        if opcode.name in ("PUT", "BINPUT", "LONG_BINPUT") and int(argument) > count:
            raise BadInput(
                path, "pickle", found=f"memo index {argument}", expected=f"at most {count}"
            )


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
