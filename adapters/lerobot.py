"""LeRobot datasets, format v3.0: tables in parquet, cameras as mp4, many episodes a file. Needs the extra `lerobot`.

`<dataset>/{meta, data, videos}` as `_lerobot_files` lists them. Traps this file knows:

- an episode is a slice: its rows by `episode_index`, its frames by `from_timestamp` in a video that others share; our
  cuts begin at key frames, so that what no edit touched is copied and never encoded again;
- LeRobot's loader looks a frame up by its time and fails where none is within 0.1 ms: rates stay as they are told;
- it takes the words of a task from pandas' index of `meta/tasks.parquet`;
- nothing says where cameras are: `cameras.yaml` beside `meta/` may, as for RLDS;
- statistics are part of the dataset and are counted anew; a video of depth has 12 bits and is copied or refused.

Keys are `<split>/<number>`, below the dataset's own path.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from rpaug_adapters import (
    _cameras,
    _lerobot_files,
    _lerobot_fresh,
    _lerobot_pack,
    _lerobot_read,
    _lerobot_write,
)
from rpaug_adapters._folders import GatheredAdapter, datasets, place, unlike
from rpaug_adapters._lerobot_files import INFO, STAGED, Info
from rpaug_adapters._lerobot_read import LeRobotSource

from rpaug import Episode, Side, Unsupported
from rpaug.core.files import atomic_folder, read_bytes, write_atomic

EMPTY = {"total_episodes": 0, "total_frames": 0, "total_tasks": 0, "splits": {}}


class LeRobot(GatheredAdapter):
    """Reads and writes LeRobot v3.0 datasets."""

    name: ClassVar[str] = "lerobot"
    mark: ClassVar[str] = INFO
    rest: ClassVar[tuple[str, ...]] = ("meta/tasks.*", "meta/stats.json", "meta/episodes")
    staged: ClassVar[str] = STAGED

    def gathered(self, folder: Path) -> Mapping[str, int]:
        return {name: len(span) for name, span in _lerobot_files.info(folder).splits.items()}

    def read(self, root: Path, key: str) -> Episode:
        folder, split, number = place(root, key)
        _cameras.in_place(root, folder)
        return _lerobot_read.read(folder, split, number, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, LeRobotSource) else None
        folder, _, _ = self.free(root, key)
        about = _described(episode, recorded, folder, key)
        with atomic_folder(root / key) as work:
            files = _lerobot_write.write(episode, recorded, about, work)
            for name, data in {**files, **side()}.items():
                (work / name).write_bytes(data)
            if not (folder / INFO).exists():  # last: a write that failed leaves nothing
                write_atomic(folder / INFO, json.dumps(about.given, indent=4).encode())
            given = recorded and recorded.info.folder / _cameras.NAME
            if given and given.is_file() and not (folder / _cameras.NAME).exists():
                write_atomic(folder / _cameras.NAME, read_bytes(given))

    def faults(self, root: Path) -> Sequence[str]:
        """Counts, places and statistics that are not those of the episodes."""
        return [words for folder in datasets(root, INFO) for words in _lerobot_pack.faults(folder)]

    def finish(self, source: Path, target: Path) -> None:
        """Episodes into shared files."""
        for folder in datasets(target, INFO):
            _lerobot_pack.pack(folder)


def _described(episode: Episode, recorded: LeRobotSource | None, folder: Path, key: str) -> Info:
    """What describes the dataset that an episode is written to. Raises Unsupported for one of another kind."""
    given: dict[str, Any] = (
        _lerobot_fresh.described(episode) if recorded is None else recorded.info.given | EMPTY
    )
    if not (folder / INFO).is_file():
        rate, features = float(given["fps"]), given["features"]
        return Info(folder, given, rate, features, {})
    about = _lerobot_files.info(folder)
    if about.rate != given["fps"]:
        reason = f"{given['fps']} frames a second, and the episodes before it have {about.rate:g}"
        raise Unsupported(f"{key}: {reason}: a LeRobot dataset has one rate")
    if about.features != given["features"]:
        reason = unlike(about.features, given["features"])
        raise Unsupported(f"{key}: {reason}: a LeRobot dataset has one kind of episode")
    return about
