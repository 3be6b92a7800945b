"""One episode of a run: read, built and planned once, then all its copies."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from rpaug.core import progress, registry, untouched
from rpaug.core.errors import BadInput
from rpaug.core.files import REJECTED
from rpaug.core.interfaces import IMAGE_KINDS, Adapter, ImageKind
from rpaug.core.types import Episode
from rpaug.pipeline import journal, report, totals
from rpaug.pipeline.copies import PreparedEpisode
from rpaug.pipeline.prepare import ground, prepare_scene
from rpaug.pipeline.recipe import build as build_recipe
from rpaug.pipeline.write import CopyPlace, write_copy
from rpaug.scene.recorded import surfels


@dataclass(frozen=True)
class Job:
    """One source episode and where its copies go, in plain values that cross process borders."""

    adapter: str
    source: Path
    key: str
    target: Path
    copies: tuple[tuple[int, str], ...]  # copy number, key in the target
    recipe: dict[str, Any]
    tier: int
    scenes: Path | None = None  # a store of fitted scenes
    donor: str | None = None  # key of the episode whose static Gaussians are borrowed
    keep_invalid: bool = False  # copies whose recorded actions no longer hold
    device: str = "cpu"  # that fits Gaussians and edits appearance
    linked: bool = False  # untouched files are hard links to the recorded ones


def augment(job: Job) -> Iterator[str]:
    """Read one episode, write its copies one by one, each noted in the journal; yield their keys. Raises RpaugError.

    All edits are tried before the first copy is written: whether a target is there does not depend on the draw. A job
    without copies fits what is to lend Gaussians to others, if the plan has any.
    """
    try:
        with untouched.hard_links(job.linked):
            yield from _copies(job)
    finally:
        progress.told(job.key, progress.FINISHED)


def _copies(job: Job) -> Iterator[str]:
    adapter, recipe = registry.adapter(job.adapter), build_recipe(job.recipe)
    watch = report.Stopwatch()
    progress.told(job.key, "reading")
    with watch("read"):
        episode = adapter.read(job.source, job.key)
    progress.told(job.key, "finding what is in the scene")
    donor = _donor(adapter, job)
    scene, plan = prepare_scene(
        episode, recipe, job.tier, job.scenes, watch, donor, device=job.device
    )
    if not job.copies:
        return
    with watch("read"):
        see_readable(adapter, job.source, episode)
    progress.told(job.key, "trying every edit once")
    with watch("ground"):
        ground(scene, recipe)
    kept = cache(partial(surfels.recorded, scene))
    prepared = PreparedEpisode(scene, plan, recipe, kept, job.keep_invalid, job.device)
    shared = {stage: seconds / len(job.copies) for stage, seconds in watch.seconds.items()}
    for number, (copy, key) in enumerate(job.copies, 1):
        place = CopyPlace(job.key, copy, job.target, key)
        place = write_copy(adapter, prepared, place, shared)
        within = "" if place.root == job.target else REJECTED
        described = json.loads((place.root / key / report.NAME).read_bytes())
        journal.made(job.target, (within, key), described, totals.facts(described, recipe))
        progress.told(job.key, progress.COPY, number, len(job.copies))
        yield key


def see_readable(adapter: Adapter, root: Path, episode: Episode) -> None:
    """See that all that an episode holds can be read: copies carry on the bytes of what no edit reaches. Raises
    RpaugError."""
    adapter.see_readable(episode, _images(episode))
    try:
        adapter.untouched(episode, False)
    except OSError as error:  # of HDF5, for a chunk that no filter undoes
        found = str(error)[:120]
        raise BadInput(
            root / episode.key, "data", found=found, expected="what can be read"
        ) from None


def _images(episode: Episode) -> Iterator[tuple[str, ImageKind, int]]:
    for name, view in episode.views.items():
        for kind in IMAGE_KINDS:
            if getattr(view, kind) is not None:
                yield from ((name, kind, t) for t in range(episode.length))


def left(job: Job) -> Job:
    """The job without the copies that are there already, rejected ones among them; what is there and not in the
    journal is removed."""
    noted, copies = journal.read(job.target).made, []
    for copy, key in job.copies:
        if not any((within, key) in noted for within in ("", REJECTED)):
            for within in ("", REJECTED):
                shutil.rmtree(job.target / within / key, ignore_errors=True)
            copies.append((copy, key))
    return replace(job, copies=tuple(copies))


def _donor(adapter: Adapter, job: Job) -> Callable[[], Episode] | None:
    return partial(adapter.read, job.source, job.donor) if job.donor else None
