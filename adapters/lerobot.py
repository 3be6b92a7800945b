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
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from rpaug_adapters import (
    _cameras,
    _lerobot_files,
    _lerobot_fresh,
    _lerobot_pack,
    _lerobot_read,
    _lerobot_write,
)
from rpaug_adapters._lerobot_files import INFO, Info
from rpaug_adapters._lerobot_read import Recorded

from rpaug import Adapter, BadInput, Episode, Side, Unsupported, splits
from rpaug.files import atomic_folder, read_bytes, write_atomic

PLACES = ("all_variations", "episodes")  # of other layouts, and no names of tasks
EMPTY = {"total_episodes": 0, "total_frames": 0, "total_tasks": 0, "splits": {}}


class LeRobot(Adapter):
    """Reads and writes LeRobot v3.0 datasets."""

    name: ClassVar[str] = "lerobot"

    def episodes(self, root: Path) -> Sequence[str]:
        keys = []
        for folder in _lerobot_files.datasets(root):
            about = _lerobot_files.info(folder)
            counts = {name: set(range(len(span))) for name, span in about.splits.items()}
            for name, numbers in _lerobot_files.staged(folder).items():
                counts.setdefault(name, set()).update(numbers)
            at = PurePosixPath(folder.relative_to(root).as_posix())
            keys += [
                (at / name / str(i)).as_posix()
                for name, held in counts.items()
                for i in sorted(held)
            ]
        return keys

    def read(self, root: Path, key: str) -> Episode:
        folder, split, number = _place(root, key)
        return _lerobot_read.read(folder, split, number, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, Recorded) else None
        folder, split, number = _place(root, key)
        about = _described(episode, recorded, folder, key)
        if number < len(about.splits.get(split, ())):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        with atomic_folder(root / key) as work:
            files = _lerobot_write.write(episode, recorded, about, work)
            for name, data in {**files, **side()}.items():
                (work / name).write_bytes(data)
            if not (folder / INFO).exists():  # last: a write that failed leaves nothing
                write_atomic(folder / INFO, json.dumps(about.told, indent=4).encode())
            told = recorded and recorded.info.folder / _cameras.NAME
            if told and told.is_file() and not (folder / _cameras.NAME).exists():
                write_atomic(folder / _cameras.NAME, read_bytes(told))

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / str(index)).as_posix()

    def key_for(self, like: str, index: int) -> str:
        """`<task>/<split>/<number>`; without a split in its key an episode is for training."""
        parts = PurePosixPath(like).parts
        split = splits.of(like) or "train"
        named = [part for part in parts[:-1] if part != split and part not in PLACES]
        return f"{'_'.join(named) or 'episodes'}/{split}/{index}"

    def faults(self, root: Path) -> Sequence[str]:
        """Counts, places and statistics that are not those of the episodes."""
        return [
            words
            for folder in _lerobot_files.datasets(root)
            for words in _lerobot_pack.faults(folder)
        ]

    def finish(self, source: Path, target: Path) -> None:
        """Episodes into shared files."""
        for folder in _lerobot_files.datasets(target):
            _lerobot_pack.pack(folder)


def _place(root: Path, key: str) -> tuple[Path, str, int]:
    *above, split, number = PurePosixPath(key).parts
    return root.joinpath(*above), split, int(number)


def _described(episode: Episode, recorded: Recorded | None, folder: Path, key: str) -> Info:
    """What describes the dataset that an episode is written to. Raises Unsupported for one of another kind."""
    told: dict[str, Any] = (
        _lerobot_fresh.described(episode) if recorded is None else recorded.info.told | EMPTY
    )
    if not (folder / INFO).is_file():
        rate, features = float(told["fps"]), told["features"]
        return Info(folder, told, rate, features, {})
    about = _lerobot_files.info(folder)
    if about.features != told["features"] or about.rate != told["fps"]:
        reason = "its cameras or numbers are not those of the episodes before it"
        raise Unsupported(f"{key}: {reason}: a LeRobot dataset has one kind of episode")
    return about
