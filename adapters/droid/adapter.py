"""DROID's raw recordings, as `read` describes them. What rpaug writes has the same layout.

A copy is a folder `episode_<i>` beside where its source lay, with an uuid of its own (`<uuid>+episode_<i>`), so that
lists by uuid tell it from its source. Annotations of copies come into the list at the end of a run.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

from rpaug_adapters.droid.read import (
    ANNOTATIONS,
    EXTRINSICS,
    GROUPS,
    INTRINSICS,
    LANGUAGE,
    TASK,
    TRAJECTORY,
    DroidSource,
    annotations,
    names_and_values,
    read_episode,
    stored,
)
from rpaug_adapters.droid.write import renamed, write_episode
from rpaug_adapters.shared.folders import refuse, see_no_link_out, walk, write_files
from rpaug_adapters.shared.hdf5 import opened
from rpaug_adapters.shared.texts import json_bytes

from rpaug import Adapter, Episode, Side, Unsupported, files

RAW = "metadata names SVO files that are not here: readers that need the ZED SDK (depth, intrinsics) find none"


class DROID(Adapter):
    """Reads and writes DROID's raw recordings."""

    name: ClassVar[str] = "droid"
    gathers: ClassVar[bool] = True

    def episodes(self, root: Path) -> Sequence[str]:
        if _is_episode(root):
            return [root.name]
        keys = []
        for here, subfolders, _ in walk(root):
            if here != root and _is_episode(here):
                subfolders.clear()
                keys.append(here.relative_to(root).as_posix())
        return sorted(keys, key=files.natural)

    def read(self, root: Path, key: str) -> Episode:
        folder = root if _is_episode(root) else root / key
        see_no_link_out(root, folder)
        return read_episode(root, folder, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        if not isinstance(episode.source, DroidSource):
            reason = "the layout holds recordings of DROID as they were filmed, and this is none"
            raise Unsupported(f"{episode.key}: {reason}")
        with files.atomic_folder(root / key) as work:
            extra, said = write_episode(episode, episode.source, work, key)
            write_files(work, {**extra, **side(*said)})

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / f"episode_{index}").as_posix()

    def rename(self, root: Path, key: str, new: str) -> None:
        super().rename(root, key, new)
        for path in (root / new).glob("metadata_*.json"):
            given = renamed(names_and_values(path), path, new)
            path.unlink()
            write_files(root / new, given)

    def traps(self, episode: Episode) -> Sequence[str]:
        source: DroidSource = episode.source
        named = any(name.endswith("_svo_path") for name in source.about)
        return [RAW] if named and not any(source.folder.glob("recordings/**/*.svo")) else []

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        source, found = episode.source, {}
        path = source.folder / TRAJECTORY
        with opened(path, GROUPS) as file:
            for group in GROUPS:
                for name, held in stored(path, file, group):
                    if f"{group}/{name}".startswith((EXTRINSICS, INTRINSICS)):
                        continue  # cameras are compared as such
                    kind = repr((held.dtype.str, held.shape, held.chunks, held.compression))
                    values = held[()] if held.dtype.kind != "O" else repr(held[()]).encode()
                    found[f"{group}/{name}"] = kind.encode() + bytes(values)
            given = {key: value for key, value in file.attrs.items() if key != TASK}
            found |= {f"attribute {key}": repr(value).encode() for key, value in given.items()}
        kept = {
            name: value
            for name, value in source.about.items()
            if name not in ("uuid", TASK) and not name.endswith(("_path", "_extrinsics"))
        }
        found["metadata"] = json_bytes(kept)
        return found

    def finish(self, source: Path, target: Path) -> None:
        """Instructions of all copies into one list by uuid, named as the source's."""
        made = {}
        for key in self.episodes(target):
            own = target / key / LANGUAGE
            if own.is_file():
                (metadata,) = own.parent.glob("metadata_*.json")
                made[metadata.stem.removeprefix("metadata_")] = names_and_values(own)
        if not made:
            return
        given = next(
            (
                found
                for key in self.episodes(source)
                if (found := annotations(source, source / key))
            ),
            None,
        )
        name = ANNOTATIONS.replace("*", "") if given is None else given.name
        before = names_and_values(target / name) if (target / name).is_file() else {}
        files.write_atomic(target / name, json_bytes(before | made))
        for key in self.episodes(target):
            (target / key / LANGUAGE).unlink(missing_ok=True)

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:
        """Instructions out of the list into the folders of their episodes."""
        refuse(spoilt)  # which episode had which words stands there alone
        for path in root.glob(ANNOTATIONS):
            listed = names_and_values(path)
            for key in self.episodes(root):
                for metadata in (root / key).glob("metadata_*.json"):
                    words = listed.get(metadata.stem.removeprefix("metadata_"))
                    if words is not None:
                        files.write_atomic(root / key / LANGUAGE, json_bytes(words))
            path.unlink()


def _is_episode(folder: Path) -> bool:
    return (folder / TRAJECTORY).is_file() and (folder / "recordings").is_dir()
