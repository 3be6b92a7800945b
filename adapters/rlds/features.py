"""What `features.json` says an RLDS episode holds: one leaf for every feature, by its path in the Example.

The file is a tree of `pythonClassName`s (tensorflow_datasets' `core/features`). Its one `Dataset` node is the sequence
of steps; below it every value is there once a step. Classes not known here are leaves that are carried along unread.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from rpaug_adapters.shared.texts import read_json, stamp

from rpaug import BadInput

FEATURES = "features.json"
DEEPEST = 32  # levels of nesting


@dataclass(frozen=True)
class Leaf:
    """One feature: its key in the Example, its class, and, where it has them, shape (None: unknown), type, encoding."""

    key: str
    kind: str  # "Image", "Text", "Tensor", "Scalar", ...
    stepwise: bool
    shape: tuple[int | None, ...]
    dtype: str
    encoding: str

    @property
    def name(self) -> str:
        """The last part of the key."""
        return self.key.rpartition("/")[2]


def leaves(folder: Path) -> Mapping[str, Leaf] | None:
    """All features of the dataset in a folder by key, or None if its features have no steps. Raises BadInput."""
    return _leaves(folder / FEATURES, *stamp(folder / FEATURES))


@lru_cache(16)
def _leaves(path: Path, _modified: int, _size: int) -> Mapping[str, Leaf] | None:
    tree = read_json(path, "a tree of features")
    found = {leaf.key: leaf for leaf in _walk(path, tree, (), False, 0)}
    return found if any(leaf.stepwise for leaf in found.values()) else None


def without(tree: Any, drop: Callable[[str], bool]) -> Any:
    """The tree of a `features.json` without the features whose names `drop` takes."""
    if not isinstance(tree, Mapping):
        return tree
    return {
        name: {key: without(one, drop) for key, one in child.items() if not drop(key)}
        if name == "features" and isinstance(child, Mapping)
        else without(child, drop)
        for name, child in tree.items()
    }


def _walk(path: Path, node: Any, at: tuple[str, ...], stepwise: bool, depth: int) -> Iterator[Leaf]:
    where = "/".join(at) or "root"
    if depth > DEEPEST:
        raise BadInput(path, where, found="a deeper tree", expected=f"at most {DEEPEST} levels")
    if not isinstance(node, Mapping) or not isinstance(node.get("pythonClassName"), str):
        raise BadInput(path, where, found="no pythonClassName", expected="a feature of TFDS")
    kind = node["pythonClassName"].rpartition(".")[2]
    if kind == "FeaturesDict":
        inner = _inner(path, where, node, "featuresDict", "features")
        for name, child in inner.items():
            yield from _walk(path, child, (*at, name), stepwise, depth + 1)
    elif kind == "Dataset":
        child = _inner(path, where, node, "sequence", "feature")
        yield from _walk(path, child, at, True, depth + 1)
    else:
        about = node.get("image") or node.get("tensor") or {}
        about = about if isinstance(about, Mapping) else {}
        yield Leaf(
            "/".join(at),
            kind,
            stepwise,
            _shape(path, where, about.get("shape", {})),
            _dtype(path, where, about.get("dtype", "")),
            str(about.get("encodingFormat") or about.get("encoding", "")),
        )


def _dtype(path: Path, where: str, named: Any) -> str:
    """A type that TFDS may name; numpy would understand more than that."""
    if not isinstance(named, str) or not re.fullmatch(r"[a-z]*\d{0,2}", named):
        found = repr(named)[:40]
        raise BadInput(path, f"{where}, dtype", found=found, expected="the name of a number type")
    return named


def _inner(path: Path, where: str, node: Mapping[str, Any], *names: str) -> Mapping[str, Any]:
    value: Any = node
    for name in names:
        value = value.get(name) if isinstance(value, Mapping) else None
    if not isinstance(value, Mapping):
        raise BadInput(path, where, found=f"no {'.'.join(names)}", expected="a feature of TFDS")
    return value


def _shape(path: Path, where: str, shape: Any) -> tuple[int | None, ...]:
    """Dimensions are strings; -1 and "" are unknown."""
    dimensions = shape.get("dimensions", []) if isinstance(shape, Mapping) else []
    try:
        sides = [int(d) if str(d) else -1 for d in dimensions]
    except (TypeError, ValueError, OverflowError):
        raise BadInput(
            path, f"{where}, shape", found=repr(dimensions), expected="whole numbers"
        ) from None
    return tuple(None if side < 0 else side for side in sides)
