"""Adapters, operators and ways to paint by name, found through entry points: ours and anyone's alike."""

from collections.abc import Callable, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import numpy as np

from rpaug.core.errors import BadInput, RpaugError, there_are
from rpaug.core.interfaces import Adapter, Operator
from rpaug.core.types import Episode

SAMPLE = Path(__file__).parents[1] / "sample"
"""The dataset that ships."""


@cache
def _found(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda p: p.name)}


UNSEEN = {
    name: f"{name} is left out: it changes no recorded pixel, only how things would have moved"
    for name in ("object_mass", "object_friction")
}
"""COLOSSEUM's factors that no edit of a recording can show."""


def operator_names() -> list[str]:
    """Names usable as `op:` in a recipe."""
    return list(_found("rpaug.operators"))


def adapter_names() -> list[str]:
    """Names of the dataset layouts that can be read."""
    return list(_found("rpaug.adapters"))


def operator(name: str) -> type[Operator]:
    """The operator class called `name`. Raises RpaugError listing the known ones."""
    found = _found("rpaug.operators")
    if name in UNSEEN:
        raise RpaugError(UNSEEN[name])
    if name not in found:
        raise RpaugError(f"no operator is called {name!r}; {there_are(name, found)}")
    return found[name].load()


def shipped(name: str) -> bool:
    """Whether an operator comes with rpaug."""
    return _found("rpaug.operators")[name].value.startswith("rpaug.")


def adapter(name: str) -> Adapter:
    """The adapter called `name`. Raises RpaugError listing the known ones."""
    found = _found("rpaug.adapters")
    if name not in found:
        raise RpaugError(f"no adapter is called {name!r}; {there_are(name, found)}")
    return found[name].load()()


def _whole(root: Path, every: list[Adapter]) -> None:
    """See that no dataset lacks just the file that it is known by: its videos would be taken for recordings."""
    for one in every:
        if (path := one.missing(root)) is not None:
            expected = f"a whole {one.name} dataset: its other files are there"
            raise BadInput(path, "file", found="nothing", expected=expected)


def painters() -> list[str]:
    """Names of the ways to paint that packages bring: functions of an image and its hole."""
    return list(_found("rpaug.inpaint"))


def painter(name: str) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The way to paint called `name`, one of `painters`."""
    return _found("rpaug.inpaint")[name].load()


def adapter_for(root: Path) -> Adapter:
    """The adapter that finds episodes under `root`. Raises BadInput if none does."""
    if not root.exists():
        raise BadInput(root, "dataset", found="no such folder", expected="the folder of a dataset")
    every = [adapter(name) for name in _found("rpaug.adapters")]
    for candidate in sorted(every, key=lambda one: one.loose):
        if candidate.loose and root.is_dir():
            _whole(root, every)
        if (root.is_dir() or candidate.loose) and candidate.episodes(root):
            return candidate
    if root.is_file():
        raise BadInput(
            root, "dataset", found="a file", expected="the folder of a dataset, or a video"
        )
    known = ", ".join(_found("rpaug.adapters"))
    raise BadInput(root, "layout", found="no episodes", expected=f"a dataset in one of: {known}")


def datasets_below(root: Path) -> list[tuple[Path, str, int]]:
    """The folders directly below one that are datasets: with the layout, and how many episodes."""
    found = []
    every = sorted((adapter(name) for name in adapter_names()), key=lambda one: one.loose)
    for folder in sorted(one for one in root.iterdir() if one.is_dir()):
        for candidate in every:
            if count := len(candidate.episodes(folder)):
                found.append((folder, candidate.name, count))
                break
    return found


def dataset(given: Path | str) -> Path:
    """The folder or file of a dataset; `sample` is the one that ships, unless there is a path of that name."""
    path = Path(given)
    return SAMPLE if str(given) == "sample" and not path.exists() else path


def read(root: Path, key: str | None) -> Episode:
    """One episode of a dataset, the first if no key is given. Raises BadInput."""
    return read_among(root, key)[0]


def read_among(root: Path, key: str | None) -> tuple[Episode, Sequence[str]]:
    """One episode of a dataset, the first if no key is given, and the keys of all. Raises BadInput."""
    found = adapter_for(root)
    keys = found.episodes(root)
    if key is not None and key not in keys:
        raise BadInput(root, "episode", found=key, expected=f"one of: {', '.join(keys[:20])}")
    return found.read(root, key if key is not None else keys[0]), keys
