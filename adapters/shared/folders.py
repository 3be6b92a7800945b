"""Datasets whose episodes share files: while one grows, each of its episodes is a folder `<split>/<number>` of its own.

So that an episode appears by one rename, whatever it is gathered into at the end. Keys are `<split>/<number>` below the
dataset's own path.
"""

import os
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from rpaug import Adapter, BadInput, files, splits

# Keys of TFDS' and LeRobot's descriptions that name no feature.
DESCRIBING = {"featuresDict", "features", "sequence", "feature"} | {
    "tensor", "image", "text", "shape", "info", "length",
}  # fmt: skip
PICKLES = (".pkl", ".pickle", ".p", ".joblib", ".pt", ".pth")  # torch's files are pickles too
PLACES = ("all_variations", "episodes")  # of other layouts, and no names of tasks


class GatheredAdapter(Adapter):
    """An adapter of such datasets. `mark` is the file that makes a folder a dataset, `rest` patterns of what else lies
    in one, `staged` an episode's own file, `common` patterns of what all episodes have in common.

    New datasets have the folder `version` between their name and their splits, if there is one.
    """

    gathers: ClassVar[bool] = True
    mark: ClassVar[str]
    rest: ClassVar[tuple[str, ...]]
    staged: ClassVar[str]
    common: ClassVar[tuple[str, ...]]
    version: ClassVar[str] = ""

    @abstractmethod
    def gathered(self, folder: Path) -> Mapping[str, int] | None:
        """How many episodes each split of a dataset has in shared files; None for a dataset of another kind."""

    def episodes(self, root: Path) -> Sequence[str]:
        keys = []
        for folder in datasets(root, self.mark):
            files.see_inside(folder, folder / self.mark, *_links(folder, self.common))
            given = self.gathered(folder)
            if given is None:
                continue
            held = {split: set(range(count)) for split, count in given.items()}
            for split, numbers in staged(folder, self.staged).items():
                held.setdefault(split, set()).update(numbers)
            at = PurePosixPath(folder.relative_to(root).as_posix())
            keys += [
                (at / split / str(number)).as_posix()
                for split, numbers in held.items()
                for number in sorted(numbers)
            ]
        return keys

    def missing(self, root: Path) -> Path | None:
        for folder, subfolders, _ in os.walk(root):
            here = Path(folder)
            if (here / self.mark).is_file():
                subfolders.clear()
            elif any(any(here.glob(pattern)) for pattern in self.rest):
                return here / self.mark
        return None

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / str(index)).as_posix()

    def key_for(self, like: str, index: int) -> str:
        """`<task>[/<version>]/<split>/<number>`; without a split in its key an episode is for training."""
        parts = PurePosixPath(like).parts
        split = splits.of(like) or "train"
        named = [part for part in parts[:-1] if part != split and part not in PLACES]
        task = "_".join(named) or "episodes"
        return PurePosixPath(task, self.version, split, str(index)).as_posix()

    def free(self, root: Path, key: str) -> tuple[Path, str, int]:
        """Dataset, split and number of an episode to be written. Raises BadInput for one that is there already."""
        folder, split, number = place(root, key)
        given = (self.gathered(folder) if (folder / self.mark).is_file() else None) or {}
        if number < given.get(split, 0):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        return folder, split, number


def place(root: Path, key: str) -> tuple[Path, str, int]:
    """Dataset, split and number of an episode."""
    *above, split, number = key.split("/")
    return root.joinpath(*above), split, int(number)


def walk(root: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """As os.walk, in order, without hidden folders and without the rejected copies that lie beside a run's own."""
    for folder, subfolders, names in os.walk(root):
        apart = (files.REJECTED,) if Path(folder) == root else ()
        subfolders[:] = sorted(
            name for name in subfolders if not name.startswith(".") and name not in apart
        )
        yield Path(folder), subfolders, names


def datasets(root: Path, mark: str) -> Iterator[Path]:
    """Folders at or under `root` with the file `mark` in them, in order; none lies in another."""
    for folder, subfolders, _ in walk(root):
        if (folder / mark).is_file():
            yield folder
            subfolders.clear()


def staged(folder: Path, name: str) -> dict[str, list[int]]:
    """Numbers of the episodes that are not gathered yet, by split, ascending; `name` is the file of each."""
    found: dict[str, list[int]] = {}
    for path in folder.glob(f"*/*/{name}"):
        if path.parent.name.isdecimal():
            found.setdefault(path.parent.parent.name, []).append(int(path.parent.name))
    return {split: sorted(numbers) for split, numbers in sorted(found.items())}


def ungathered(folder: Path, name: str, gathered: Mapping[str, int]) -> bool:
    """Is an episode staged that the shared files lack? They hold so many of each split."""
    return any(
        number >= gathered.get(split, 0)
        for split, numbers in staged(folder, name).items()
        for number in numbers
    )


def drop_staged(folder: Path, held: Iterable[str], patterns: Sequence[str]) -> None:
    """Remove what shared files hold of the episodes of some splits from the episodes' own folders, what a killed run
    left of that too, and folders in which nothing lies beside it."""
    for split in held:
        within = folder / split
        if not within.is_dir():
            continue
        for own in sorted(within.iterdir()):
            for path in (path for pattern in patterns for path in own.glob(pattern)):
                path.unlink()
            if not any(own.iterdir()):
                own.rmdir()
        if not any(within.iterdir()):
            within.rmdir()


def unlike(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """The first feature in which an episode differs from those before it, by the trees that describe them."""
    old, new = dict(_leaves(before)), dict(_leaves(now))
    name = next(_feature(path) for path in [*new, *old] if old.get(path) != new.get(path))
    if name not in map(_feature, old):
        return f"it has {name}, and the episodes before it have not"
    if name not in map(_feature, new):
        return f"it lacks {name}, which the episodes before it have"
    return f"its {name} is of another kind or size than that of the episodes before it"


def _feature(path: tuple[str, ...]) -> str:
    """The name of what a place in such a tree is about; a feature may be called as a key that names none."""
    parts = zip(("", *path), path[:-1], strict=False)
    return "/".join(
        part for before, part in parts if part not in DESCRIBING or before == "features"
    )


def _leaves(
    tree: Mapping[str, Any], at: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, value in tree.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*at, name))
        else:
            yield (*at, name), value


def see_no_link_out(root: Path, folder: Path) -> None:
    """See that an episode's folder lies in its dataset, and that no link in it leads out of the folder, or to a folder:
    what lies there is nobody's to pass on. Raises BadInput."""
    files.see_inside(root, folder)
    _see_none_within(folder, folder)


def _see_none_within(home: Path, folder: Path) -> None:
    try:
        entries = list(os.scandir(folder))
    except OSError as error:
        expected = "a readable folder"
        raise BadInput(folder, "folder", found=error.strerror, expected=expected) from None
    for entry in entries:
        if entry.is_symlink():
            files.see_inside(home, path := Path(entry.path))
            if path.is_dir():
                expected = "the folder itself, or links to files"
                raise BadInput(path, "link", found=f"a link to {path.resolve()}", expected=expected)
        elif entry.is_dir():
            _see_none_within(home, Path(entry.path))


def _links(folder: Path, patterns: Iterable[str]) -> Iterator[Path]:
    """The links among what patterns name in a folder."""
    for pattern in patterns:
        yield from (path for path in folder.glob(pattern) if path.is_symlink())


def see_no_pickle(path: Path) -> None:
    """Raises BadInput for a pickle, by its name: a layout that has none passes none on, since one may hold code."""
    if path.suffix.lower() in PICKLES:
        raise BadInput(path, "format", found="a pickle, which may hold code", expected="none here")


def refuse(spoilt: Iterable[Path]) -> None:
    """Raises BadInput where files are spoilt that nothing makes again."""
    for path in sorted(spoilt):
        found = "another size than it was written with" if path.exists() else "nothing"
        expected = "the file as it was written: nothing here makes it again"
        raise BadInput(path, "file", found=found, expected=expected)


def write_files(folder: Path, named: Mapping[str, bytes]) -> None:
    """Files of a folder that is being written, by name, each a new one: what was passed on there may be a link to a
    recorded file."""
    for name, data in named.items():
        (folder / name).unlink(missing_ok=True)
        (folder / name).write_bytes(data)
