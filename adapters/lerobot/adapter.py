"""LeRobot datasets, v3.0 and v2.1: tables in parquet, cameras as mp4. Needs the extra `lerobot`.

`<dataset>/{meta, data, videos}` as `tables` lists them. Traps this file knows:

- an episode is a slice: its rows by `episode_index`, its frames by `from_timestamp` in a video that others share; our
  cuts begin at key frames, so that what no edit touched is copied and never encoded again;
- LeRobot's loader looks a frame up by its time and fails where none is within 0.1 ms: rates stay as they are told;
- it takes the words of a task from pandas' index of `meta/tasks.parquet`;
- nothing says where cameras are: `cameras.yaml` beside `meta/` may, as for RLDS;
- statistics are part of the dataset and are counted anew; a video of depth holds codes (`codes`).

Keys are `<split>/<number>`, below the dataset's own path.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from rpaug_adapters.lerobot import describe, fresh, pack, tables, write
from rpaug_adapters.lerobot.read import LeRobotSource, read_episode
from rpaug_adapters.lerobot.tables import INFO, STAGED, Info
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.folders import (
    GatheredAdapter,
    datasets,
    place,
    refuse,
    see_no_pickle,
    unlike,
    write_files,
)

from rpaug import BadInput, Episode, Side, Unsupported, files

MADE_ANEW = (
    "info.json",
    "tasks.*",
    "subtasks.parquet",
    "episodes*",
    "*stats*",
)  # in `meta`; all else is brought along


class LeRobot(GatheredAdapter):
    """Reads and writes LeRobot datasets, each in the version it came in."""

    name: ClassVar[str] = "lerobot"
    mark: ClassVar[str] = INFO
    rest: ClassVar[tuple[str, ...]] = ("meta/tasks.*", "meta/stats.json", "meta/episodes*")
    staged: ClassVar[str] = STAGED
    common: ClassVar[tuple[str, ...]] = ("meta/**/*", cameras.NAME)

    def __init__(self, version: str = "") -> None:
        self.version = version  # to write, or that of the source

    def in_version(self, version: str) -> "LeRobot":
        if version not in tables.VERSIONS:
            expected = " or ".join(f"{self.name}@{one}" for one in tables.VERSIONS)
            raise BadInput(Path(self.name), "version", found=version, expected=expected)
        return LeRobot(version)

    def gathered(self, folder: Path) -> Mapping[str, int]:
        return {name: len(span) for name, span in tables.info(folder).splits.items()}

    def read(self, root: Path, key: str) -> Episode:
        folder, split, number = place(root, key)
        return read_episode(root, folder, split, number, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, LeRobotSource) else None
        folder, _, _ = self.free(root, key)
        about = _described(episode, recorded, folder, key, self.version)
        for path in _brought(recorded.info.folder) if recorded else ():
            see_no_pickle(path)
        with files.atomic_folder(root / key) as work:
            extra, said = write.write_episode(episode, recorded, about, work)
            write_files(work, {**extra, **side(*said)})
            if not (folder / INFO).exists():  # last: a write that failed leaves nothing
                files.write_atomic(folder / INFO, json.dumps(about.given, indent=4).encode())
            given = recorded and cameras.nearest(recorded.root, recorded.info.folder)
            if given and not (folder / cameras.NAME).exists():
                files.write_atomic(folder / cameras.NAME, files.read_bytes(given))

    def losses(self, episode: Episode) -> Sequence[str]:
        recorded = episode.source
        if not isinstance(recorded, LeRobotSource) or not self.version:
            return ()
        return write.losses(recorded, self.version)

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        return write.untouched(episode.source, edited_words)

    def faults(self, root: Path) -> Sequence[str]:
        """Counts, places and statistics that are not those of the episodes."""
        return [words for folder in datasets(root, INFO) for words in describe.faults(folder)]

    def finish(self, source: Path, target: Path) -> None:
        """Episodes into shared files, and what else lies in `meta`: GR00T's `modality.json`, subtasks."""
        for folder in datasets(target, INFO):
            dataset = source / folder.relative_to(target)
            pack.pack(folder, dataset)
            for path in _brought(dataset):
                if not (folder / "meta" / path.name).exists():
                    files.write_atomic(folder / "meta" / path.name, files.read_bytes(path))

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:
        """Episodes out of shared files; `info.json` names none any more."""
        refuse(path for path in spoilt if path.name in (Path(INFO).name, cameras.NAME))
        for path in (path for path in spoilt if path.parent.name == "meta"):
            path.unlink(missing_ok=True)  # made again, or brought along
        for folder in datasets(root, INFO):
            pack.scatter(folder, spoilt)


def _brought(dataset: Path) -> Iterator[Path]:
    """Files of a dataset's `meta` that are passed on as they are."""
    meta = dataset / "meta"
    for path in sorted(meta.iterdir()) if meta.is_dir() else ():
        if path.is_file() and not any(path.match(pattern) for pattern in MADE_ANEW):
            yield path


def _described(
    episode: Episode, recorded: LeRobotSource | None, folder: Path, key: str, version: str
) -> Info:
    """What describes the dataset that an episode is written to. Raises Unsupported for one of another kind."""
    given: dict[str, Any] = (
        fresh.described(episode) if recorded is None else recorded.info.given | tables.EMPTY
    )
    given = tables.in_version(given, version or given["codebase_version"])
    if not (folder / INFO).is_file():
        rate, features = float(given["fps"]), given["features"]
        return Info(folder, given, rate, features, {})
    about = tables.info(folder)
    if about.rate != given["fps"]:
        reason = f"{given['fps']} frames a second, and the episodes before it have {about.rate:g}"
        raise Unsupported(f"{key}: {reason}: a LeRobot dataset has one rate")
    if about.features != given["features"]:
        reason = unlike(about.features, given["features"])
        raise Unsupported(f"{key}: {reason}: a LeRobot dataset has one kind of episode")
    return about
