"""Write a dataset in another layout."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug.core import registry
from rpaug.core.errors import BadInput, RpaugError, Unsupported
from rpaug.core.files import apart, write_atomic
from rpaug.core.interfaces import Adapter
from rpaug.core.progress import told
from rpaug.core.types import Episode
from rpaug.core.version import __version__
from rpaug.pipeline import card, compare_layouts, report

SILENT = "the source has no instruction: the words that policies are trained on are empty"
NAMED = 3  # slashes of a key that names its dataset


@dataclass
class Conversion:
    """How many episodes were written, those that could not be with the reason, what readers may trip over, and what of
    them the layout does not hold, or not exactly."""

    episodes: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    # Words, and how many episodes they are about: what readers trip over, what was lost or approximated.
    traps: dict[str, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)

    @property
    def exit_code(self) -> int:
        """0: all done; 1: some were skipped; 2: nothing was made."""
        return 0 if not self.failures else 1 if self.episodes else 2


def named(dataset: Path, key: str) -> str:
    """The key with its dataset's name in it: a short key does not say what the dataset is called, its folder does."""
    return key if key.count("/") >= NAMED else f"{dataset.resolve().name}/{key}"


def converted(source: Path, key: str, layout: str) -> dict[str, Any]:
    """The report of an episode in another layout: what it was made from, and whether that was synthetic."""
    synthetic = report.synthetic(source, key)
    given = {"rpaug": __version__, "synthetic": synthetic, "source": key}
    return given | {"converted": layout, "draws": []}


def timed(episode: Episode, fps: float | None) -> Episode:
    """The episode with a rate that was given for a source that states none. Raises Unsupported for one that does."""
    if fps is None or episode.rate == fps:
        return episode
    if episode.rate is not None:
        raise Unsupported(
            f"{episode.key}: {episode.rate:g} frames a second, and --fps says {fps:g}"
        )
    return replace(episode, rate=fps)


def _compared(writer: Adapter, target: Path, key: str, episode: Episode) -> list[str]:
    """What a written episode does not hold of the recorded one, or not exactly. Raises Unsupported, and takes it back,
    if it is wrong."""
    times = sorted({0, episode.length // 2, episode.length - 1})
    found = list(compare_layouts.compare(key, episode, writer.read(target, key), times))
    wrong = [f"{topic}: {words}" for level, _, topic, words in found if level == "bad"]
    if wrong:
        shutil.rmtree(target / key)
        raise Unsupported(f"{episode.key}: written, it reads otherwise: {'; '.join(wrong)}")
    return list(dict.fromkeys(words for *_, words in found))


def _unshared(reader: Adapter, recorded: Episode) -> list[str]:
    """What no other layout is given of an episode."""
    return [f"{name}: {compare_layouts.NO_PLACE}" for name in reader.unshared(recorded)]


def _parties(source: Path, layout: str) -> tuple[Adapter, Adapter]:
    """Who reads and who writes. Raises BadInput."""
    name, _, version = layout.partition("@")
    reader, writer = registry.adapter_for(source), registry.adapter(name)
    if reader.name == writer.name and not version:
        found = f"{layout}, which {source} is in already"
        expected = "another layout, or a version of this (lerobot@v2.1)"
        raise BadInput(source, "--to", found=found, expected=expected)
    return reader, writer.in_version(version) if version else writer


def convert(
    source: Path,
    target: Path,
    layout: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    licence: str | None = None,
    fps: float | None = None,
) -> Conversion:
    """Write every episode of `source` into the new folder `target` in another layout, or in a version of one
    ("lerobot@v2.1"), and its dataset card.

    Episodes appear whole, one by one; each is read again, and its report has as `lost` what it does not hold of the
    recorded one, or not exactly. One that reads otherwise is taken back. `licence` is the source's, and `fps` its
    frames a second, where it does not say. Raises BadInput where the source is no dataset or the target is there
    already.
    """
    reader, writer = _parties(source, layout)
    alike = reader.name == writer.name
    if target.exists():
        raise BadInput(target, "--out", found="something there already", expected="a new path")
    apart(target, source)
    keys, done = list(reader.episodes(source)), Conversion()
    free: dict[str, int] = {}
    written: list[tuple[str, str, bool]] = []
    for number, key in enumerate(keys):
        progress(number, len(keys))
        told(key, "reading and writing")
        like, key_of = (key, writer.key_at) if alike else (named(source, key), writer.key_for)
        group = PurePosixPath(key_of(like, 0)).parent.as_posix()
        try:
            # Another layout takes the values alone: what was recorded beside them stays behind.
            recorded = reader.read(source, key)
            episode = timed(recorded if alike else replace(recorded, source=None), fps)
            made = key_of(like, free.get(group, 0))
            given = converted(source, key, reader.name)
            writer.write(episode, target, made, partial(dict, {report.NAME: report.encode(given)}))
            lost = [*_compared(writer, target, made, episode), *writer.losses(episode)]
            lost += () if alike else _unshared(reader, recorded)
        except RpaugError as error:
            done.failures[key] = str(error).removeprefix(f"{key}: ")
            continue
        write_atomic(target / made / report.NAME, report.encode(given | {"lost": lost}))
        for words in lost:
            done.lost[words] = done.lost.get(words, 0) + 1
        written.append((made, given["source"], given["synthetic"]))
        free[group] = free.get(group, 0) + 1
        done.episodes += 1
        for words in (*writer.traps(episode), *([] if episode.instruction else [SILENT])):
            done.traps[words] = done.traps.get(words, 0) + 1
    progress(len(keys), len(keys))
    if done.episodes:
        writer.finish(source, target)
        text = card.text(
            source, writer.name, written, converted=reader.name, lost=done.lost, licence=licence
        )
        write_atomic(target / card.NAME, text.encode())
    else:
        shutil.rmtree(target, ignore_errors=True)
    return done
