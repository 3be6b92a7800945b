"""RLDS episodes of Open X-Embodiment: one TFRecord record each, read and written without TensorFlow.

`<dataset>/<version>/{features.json, dataset_info.json, <name>-<split>.tfrecord-<i>-of-<n>}`. Traps this file knows:

- `steps` is flattened: `steps/observation/image_0` holds the encoded images of all steps, `steps/action` T x 7 floats;
  which features are images, depth or words is told by their types in `features.json`, never by fixed names;
- no record carries intrinsics or extrinsics: `cameras.yaml` beside `features.json` may, else the cameras are `assumed`
  and whatever needs to measure in the world is refused;
- `numBytes` in `dataset_info.json` counts the records alone, not their framing;
- real files say is_last = 0 on every step, hold black dummy images, and describe their features wrongly.

Keys are `<split>/<number>`, below the dataset's own path. Records keep every byte but those of features that changed.
"""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

from rpaug_adapters import _cameras, _rlds_files, _rlds_fresh, _rlds_read, _rlds_write, _tfrecord
from rpaug_adapters._rlds_features import FEATURES, leaves
from rpaug_adapters._rlds_read import Recorded

from rpaug import Adapter, BadInput, Episode, Side, Unsupported, splits
from rpaug.files import atomic_folder, read_bytes, write_atomic

PLACES = ("all_variations", "episodes")  # of other layouts, and no names of tasks


class RLDS(Adapter):
    """Reads and writes TFDS datasets whose features have steps."""

    name: ClassVar[str] = "rlds"

    def episodes(self, root: Path) -> Sequence[str]:
        keys = []
        for folder in _rlds_files.datasets(root):
            if leaves(folder) is None:
                continue
            counts = {
                name: set(range(sum(split.lengths)))
                for name, split in _rlds_files.splits(folder).items()
            }
            for name, numbers in _rlds_files.staged(folder).items():
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
        return _rlds_read.read(folder, split, number, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, Recorded) else None
        folder, split, number = _place(root, key)
        if _packed(folder, split, number):
            raise BadInput(root / key, "output", found="an episode", expected="a key that is free")
        tree = (
            json.dumps(_rlds_fresh.features(episode), indent=4).encode()
            if recorded is None
            else b""
        )
        if tree and (folder / FEATURES).exists() and read_bytes(folder / FEATURES) != tree:
            reason = "its cameras or numbers are not those of the episodes before it"
            raise Unsupported(f"{key}: {reason}: an RLDS dataset has one kind of episode")
        with atomic_folder(root / key) as work:
            if recorded is None:
                record = _rlds_fresh.record(episode)
                files = {_cameras.NAME: _rlds_fresh.beside(episode)}
                common = {FEATURES: tree}
            else:
                record, files = _rlds_write.encoded(episode, recorded)
                common = _common(recorded.folder)
            (work / _rlds_files.STAGED).write_bytes(_tfrecord.frame(record))
            for name, data in {**files, **side()}.items():
                (work / name).write_bytes(data)
            for name, data in common.items():  # last: a write that failed leaves nothing
                if not (folder / name).exists():
                    write_atomic(folder / name, data)

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / str(index)).as_posix()

    def key_for(self, like: str, index: int) -> str:
        """`<task>/1.0.0/<split>/<number>`; without a split in its key an episode is for training."""
        parts = PurePosixPath(like).parts
        split = splits.of(like) or "train"
        named = [part for part in parts[:-1] if part != split and part not in PLACES]
        return f"{'_'.join(named) or 'episodes'}/1.0.0/{split}/{index}"

    def faults(self, root: Path) -> Sequence[str]:
        """Counts in `dataset_info.json` that are not those of the shards."""
        return [
            words for folder in _rlds_files.datasets(root) for words in _rlds_files.faults(folder)
        ]

    def finish(self, source: Path, target: Path) -> None:
        """Records into shards, `dataset_info.json`, and whatever else lies beside a dataset's features."""
        for folder in _rlds_files.datasets(target):
            like = source / folder.relative_to(target)
            _rlds_files.pack(like, folder)
            for path in like.iterdir() if like.is_dir() else ():
                # TFDS keeps label names and the like in files named after features.
                if path.is_file() and path.suffix == ".txt" and not (folder / path.name).exists():
                    shutil.copyfile(path, folder / path.name)


def _place(root: Path, key: str) -> tuple[Path, str, int]:
    *above, split, number = PurePosixPath(key).parts
    return root.joinpath(*above), split, int(number)


def _common(folder: Path) -> dict[str, bytes]:
    """What lies beside a dataset's shards and belongs to every episode."""
    names = (FEATURES, _cameras.NAME)
    return {name: read_bytes(folder / name) for name in names if (folder / name).is_file()}


def _packed(folder: Path, split: str, number: int) -> bool:
    """Whether an episode is in the shards already."""
    held = _rlds_files.splits(folder).get(split)
    return held is not None and number < sum(held.lengths)
