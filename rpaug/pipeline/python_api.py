"""What a notebook calls: read, inspect, augment, write, replay and verify. `rpaug` exports it."""

import json
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

from rpaug.core import registry
from rpaug.core.errors import BadInput, Rejected, Unsupported
from rpaug.core.files import apart, read_bytes
from rpaug.core.types import Episode, Provenance
from rpaug.pipeline import convert, inputs, prepare
from rpaug.pipeline import inspect as inspection
from rpaug.pipeline import recipe as recipes
from rpaug.pipeline import report as reports
from rpaug.pipeline import verify as verification
from rpaug.pipeline import write as writing
from rpaug.pipeline.copies import PreparedEpisode, draw_copy
from rpaug.pipeline.inputs import RecipeLike
from rpaug.scene.recorded import surfels
from rpaug.scene.targets import settled

Dataset = Path | str
"""The folder of a dataset, a video, or `sample`, the dataset that ships."""

REPLAYED = ("recipe", "source", "copy", "draws", "plan")  # what a replay takes from a report
FRESH = "rlbench"  # the layout of what was read from none


def episodes(dataset: Dataset) -> list[str]:
    """The keys of a dataset's episodes, in natural order. Raises BadInput."""
    root = registry.dataset(dataset)
    return list(registry.adapter_for(root).episodes(root))


def read(dataset: Dataset, key: str | None = None) -> Episode:
    """One episode, its images loaded when they are asked for; the first if no key is given. Raises BadInput."""
    root = registry.dataset(dataset)
    origin = Provenance(root, registry.adapter_for(root).name)
    return replace(registry.read(root, key), provenance=origin)


def inspect(episode: Episode) -> dict[str, Any]:
    """What `rpaug inspect --json` prints: cameras, frames, instruction, and every instance."""
    roles = settled.read(episode.provenance.dataset) if episode.provenance else {}
    return inspection.inspect(episode, roles=roles)[0]


def augment(
    episode: Episode,
    recipe: RecipeLike,
    copy: int = 1,
    *,
    seed: int | None = None,
    tier: int = 0,
    scenes: Path | str | None = None,
    keep_invalid: bool = False,
) -> Episode:
    """Copy number `copy` of an episode, its images rendered when they are asked for.

    It is what `rpaug augment` writes as that copy of the same episode, gates and redraws included. `recipe` is a file,
    the name of a shipped one, a dict or a `Recipe`; `seed` replaces its own. `tier` is the least one; from 3 on,
    Gaussians are kept in the folder `scenes`. Raises Rejected for a copy that `rpaug augment` puts among the rejected,
    and BadInput, BadRecipe, TargetError, Unsupported.
    """
    if isinstance(copy, bool) or not isinstance(copy, int) or copy < 1:
        raise Unsupported(f"copy {copy!r}: expected a whole number from 1")
    asked = inputs.recipe(recipe, [] if seed is None else [f"seed={seed}"])
    if episode.provenance is not None:
        asked = asked.settled(episode.provenance.dataset)
    folder = None if scenes is None else Path(scenes)
    start = time.perf_counter()
    prepared = _prepared(episode, json.dumps(asked.source), inputs.tier(tier), folder, keep_invalid)
    made = draw_copy(prepared, copy)
    if made.faults:
        raise Rejected(f"{episode.key}: copy {copy} is rejected: {'; '.join(made.faults)}")
    side = partial(writing.side_files, made, asked.source, episode.key, copy, {}, start)
    return replace(made.recorded, side=side)


@lru_cache(1)  # the copies of one episode share what they are made from
def _prepared(
    episode: Episode, source: str, tier: int, scenes: Path | None, keep_invalid: bool
) -> PreparedEpisode:
    recipe = recipes.build(json.loads(source))
    scene, plan = prepare.prepare_scene(episode, recipe, tier, scenes)
    prepare.ground(scene, recipe)
    return PreparedEpisode(
        scene, plan, recipe, cache(partial(surfels.recorded, scene)), keep_invalid
    )


def write(episode: Episode, path: Path | str, layout: str | None = None) -> str:
    """Write an episode as the first of a new dataset at `path`, a copy with its report; return its key.

    `layout` is `rlbench`, `rlds`, `rdt`, `lerobot` or an installed one; by default the one it was read in, `rlbench`
    for an episode of arrays. Raises BadInput where something is there already, Unsupported where the layout needs what
    the episode lacks.
    """
    origin, root = episode.provenance, _new(path)
    name = layout or (origin.layout if origin else FRESH)
    adapter = registry.adapter(name)
    side = episode.side or partial(_report, episode, name)
    dataset = origin.dataset if origin else root
    if origin and origin.layout == name:
        key = adapter.key_at(episode.key, 0)
    else:
        key = adapter.key_for(convert.named(dataset, episode.key), 0)
        episode = replace(episode, source=None)  # another layout takes the values alone
    if origin:
        apart(root, dataset)
    with _whole(root):
        adapter.write(episode, root, key, side)
        adapter.finish(dataset, root)
    return key


def replay(report: Mapping[str, Any] | Path | str, dataset: Dataset, path: Path | str) -> str:
    """Write the copy that a report describes again, byte for byte, from the recorded dataset; return its key.

    `report` is an `rpaug.json`, or its content. Raises BadInput, BadRecipe, TargetError, Unsupported.
    """
    described = report if isinstance(report, Mapping) else _json(Path(report))
    lacking = [name for name in REPLAYED if name not in described]
    if lacking:
        found = f"no {', '.join(lacking)}"
        raise BadInput("report", "keys", found=found, expected="the report of a copy")
    source, root = registry.dataset(dataset), _new(path)
    adapter = registry.adapter_for(source)
    key = adapter.key_at(described["source"], 0)
    with _whole(root):
        writing.replay(adapter, source, described, root, key)
        adapter.finish(source, root)
    return key


def verify(
    path: Path | str, dataset: Dataset, *, frames: int | None = verification.LOOKED_AT
) -> verification.Verdict:
    """What `rpaug verify` finds: what must not have changed did not, and what known readers trip over.

    Images are compared in `frames` frames of each episode, None for all. Raises BadInput.
    """
    return verification.verify(Path(path), registry.dataset(dataset), frames=frames)


def _report(episode: Episode, layout: str, *_said: str) -> Mapping[str, bytes]:
    """What lies beside an episode that was not augmented: where it was read, if it was."""
    origin = episode.provenance
    if origin is None:
        return {}
    given = convert.converted(origin.dataset, episode.key, origin.layout)
    if origin.layout == layout:
        del given["converted"]
    return {reports.NAME: reports.encode(given)}


def _new(path: Path | str) -> Path:
    """See that nothing is there yet. Raises BadInput."""
    root = Path(path)
    if root.exists():
        raise BadInput(root, "path", found="something there already", expected="a new path")
    return root


@contextmanager
def _whole(root: Path) -> Iterator[None]:
    """Leave nothing behind where writing fails."""
    try:
        yield
    except BaseException:
        shutil.rmtree(root, ignore_errors=True)
        raise


def _json(path: Path) -> Mapping[str, Any]:
    """A report's content. Raises BadInput."""
    try:
        given = json.loads(read_bytes(path))
    except ValueError:
        given = None
    if not isinstance(given, Mapping):
        raise BadInput(path, "report", found="no JSON object", expected=f"an {reports.NAME}")
    return given
