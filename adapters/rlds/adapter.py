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
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from rpaug_adapters.rlds import fresh, shards, tfrecord
from rpaug_adapters.rlds.features import FEATURES, leaves, without
from rpaug_adapters.rlds.read import STEPS, RLDSSource, read_episode, texts
from rpaug_adapters.rlds.write import encoded_episode
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.folders import (
    GatheredAdapter,
    datasets,
    place,
    refuse,
    unlike,
    write_files,
)

from rpaug import Embeddings, Episode, Side, Unsupported, files


class RLDS(GatheredAdapter):
    """Reads and writes TFDS datasets whose features have steps."""

    name: ClassVar[str] = "rlds"
    mark: ClassVar[str] = FEATURES
    rest: ClassVar[tuple[str, ...]] = ("*.tfrecord-*-of-*",)
    staged: ClassVar[str] = shards.STAGED
    common: ClassVar[tuple[str, ...]] = ("*.json", "*.txt", cameras.NAME)
    version: ClassVar[str] = "1.0.0"

    def gathered(self, folder: Path) -> Mapping[str, int] | None:
        if leaves(folder) is None:
            return None
        return {name: one.count for name, one in shards.splits(folder).items()}

    def read(self, root: Path, key: str) -> Episode:
        folder, split, number = place(root, key)
        return read_episode(root, folder, split, number, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, RLDSSource) else None
        folder, _, _ = self.free(root, key)
        described = None if recorded is not None else fresh.features(episode)
        tree = b"" if described is None else json.dumps(described, indent=4).encode()
        if (
            described
            and (folder / FEATURES).exists()
            and files.read_bytes(folder / FEATURES) != tree
        ):
            reason = unlike(json.loads(files.read_bytes(folder / FEATURES)), described)
            raise Unsupported(f"{key}: {reason}: an RLDS dataset has one kind of episode")
        with files.atomic_folder(root / key) as work:
            if recorded is None:
                record = fresh.record(episode)
                extra = {cameras.NAME: fresh.beside(episode)}
                common = {FEATURES: tree}
            else:
                record, extra = encoded_episode(episode, recorded)
                common = _common(recorded, folder, episode.embeddings.drop)
            (work / shards.STAGED).write_bytes(tfrecord.frame(record))
            write_files(work, {**extra, **side()})
            for name, data in common.items():  # last: a write that failed leaves nothing
                if not (folder / name).exists():
                    files.write_atomic(folder / name, data)

    def unshared(self, episode: Episode) -> Sequence[str]:
        source: RLDSSource = episode.source
        known = {*source.shown, *source.languages, *(STEPS + name for name in episode.robot.extra)}
        known |= {STEPS + words.partition(" (")[0] for words in episode.unread}
        held = source.example.features
        return sorted(name for name in held.keys() - known if held[name].values)

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        source: RLDSSource = episode.source
        example = source.example
        names = example.features.keys() - source.shown
        if edited_words:
            names -= {*Embeddings.among(names), *texts(example, leaves(source.folder) or {})}
        return {name: example.data[slice(*example.features[name].entry)] for name in names}

    def faults(self, root: Path) -> Sequence[str]:
        """Counts in `dataset_info.json` that are not those of the shards."""
        return [words for folder in datasets(root, FEATURES) for words in shards.faults(folder)]

    def finish(self, source: Path, target: Path) -> None:
        """Records into shards, `dataset_info.json`, and whatever else lies beside a dataset's features."""
        for folder in datasets(target, FEATURES):
            like = source / folder.relative_to(target)
            shards.pack(like, folder)
            for path in like.iterdir() if like.is_dir() else ():
                # TFDS keeps label names and the like in files named after features.
                if path.is_file() and path.suffix == ".txt" and not (folder / path.name).exists():
                    files.write_atomic(folder / path.name, files.read_bytes(path))

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:
        """Records out of shards; `dataset_info.json` goes."""
        refuse(path for path in spoilt if path.name in (FEATURES, cameras.NAME))
        for path in (path for path in spoilt if path.suffix == ".txt"):
            path.unlink(missing_ok=True)  # brought along again
        for folder in datasets(root, FEATURES):
            shards.unpack(folder, spoilt)


def _common(recorded: RLDSSource, folder: Path, dropped: bool) -> dict[str, bytes]:
    """What lies beside a dataset's shards, belongs to every episode, and is not in the new folder yet; without vectors
    of words if they are dropped."""
    if (folder / FEATURES).exists():
        return {}
    beside = cameras.nearest(recorded.root, recorded.folder)
    found = {} if beside is None else {cameras.NAME: files.read_bytes(beside)}
    found[FEATURES] = files.read_bytes(recorded.folder / FEATURES)  # the mark of a dataset last
    if dropped:
        tree = without(json.loads(found[FEATURES]), lambda name: bool(Embeddings.among([name])))
        found[FEATURES] = json.dumps(tree, indent=4).encode()
    return found
