"""Write a dataset in another layout."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from rpaug.core import registry
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.files import apart, write_atomic
from rpaug.core.version import __version__
from rpaug.pipeline import card, report

SILENT = "the source has no instruction: the words that policies are trained on are empty"
NAMED = 3  # slashes of a key that names its dataset


@dataclass
class Conversion:
    """How many episodes were written, those that could not be with the reason, and what readers may trip over."""

    episodes: int = 0
    failures: dict[str, str] = field(default_factory=dict)
    traps: dict[str, int] = field(
        default_factory=dict
    )  # words, and how many episodes they are about

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


def convert(
    source: Path,
    target: Path,
    layout: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    licence: str | None = None,
) -> Conversion:
    """Write every episode of `source` into the new folder `target` in another layout, and its dataset card.

    Episodes appear whole, one by one. `licence` is the source's, where it does not say. Raises BadInput where
    the source is no dataset or the target is there already.
    """
    reader, writer = registry.adapter_for(source), registry.adapter(layout)
    if reader.name == writer.name:
        found, expected = f"{layout}, which {source} is in already", "another layout"
        raise BadInput(source, "--to", found=found, expected=expected)
    if target.exists():
        raise BadInput(target, "--out", found="something there already", expected="a new path")
    apart(target, source)
    keys, done = list(reader.episodes(source)), Conversion()
    free: dict[str, int] = {}
    reports: dict[str, dict[str, Any]] = {}
    for number, key in enumerate(keys):
        progress(number, len(keys))
        like = named(source, key)
        group = PurePosixPath(writer.key_for(like, 0)).parent.as_posix()
        try:
            # Another layout takes the values alone: what was recorded beside them stays behind.
            episode = replace(reader.read(source, key), source=None)
            made = writer.key_for(like, free.get(group, 0))
            given = converted(source, key, reader.name)
            side = {report.NAME: report.encode(given)}
            writer.write(episode, target, made, partial(dict, side))
        except RpaugError as error:
            done.failures[key] = str(error).removeprefix(f"{key}: ")
            continue
        reports[made] = given
        free[group] = free.get(group, 0) + 1
        done.episodes += 1
        for words in (*writer.traps(episode), *([] if episode.instruction else [SILENT])):
            done.traps[words] = done.traps.get(words, 0) + 1
    progress(len(keys), len(keys))
    if done.episodes:
        writer.finish(source, target)
        text = card.text(source, writer.name, reports, converted=reader.name, licence=licence)
        write_atomic(target / card.NAME, text.encode())
    else:
        shutil.rmtree(target, ignore_errors=True)
    return done
