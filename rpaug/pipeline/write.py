"""Write one copy with its report, and write again what a report describes."""

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rpaug.core import devices
from rpaug.core.errors import Rejected, RpaugError
from rpaug.core.files import REJECTED
from rpaug.core.interfaces import Adapter, ImageKind
from rpaug.physics import verdict
from rpaug.pipeline import gates as gating
from rpaug.pipeline import report, role_facts
from rpaug.pipeline.copies import ORIGINAL, Known, Made, PreparedEpisode, draw_copy
from rpaug.pipeline.prepare import prepare_scene
from rpaug.pipeline.recipe import build as build_recipe


@dataclass(frozen=True)
class CopyPlace:
    """Which copy of which recorded episode is written, and where: as `key` in the dataset at `root`."""

    source: str
    copy: int
    root: Path
    key: str

    @property
    def rejected(self) -> "CopyPlace":
        """The same copy among the rejected ones."""
        return CopyPlace(self.source, self.copy, self.root / REJECTED, self.key)


def write_copy(
    adapter: Adapter, prepared: PreparedEpisode, place: CopyPlace, seconds: Mapping[str, float]
) -> CopyPlace:
    """Draw a copy and write it while its images are rendered; return where it is: what is faulty is kept apart.

    `seconds` are those of the stages before. Raises RpaugError.
    """

    def judge(made: Made) -> Sequence[str]:
        try:
            write(adapter, made, prepared.recipe.source, place, seconds, strict=True)
        except Rejected:
            return made.judged()
        return ()

    made = draw_copy(prepared, place.copy, judge)
    if made.faults:
        place = place.rejected
        write(adapter, made, prepared.recipe.source, place, seconds)
    return place


def write(
    adapter: Adapter,
    made: Made,
    recipe: Mapping[str, Any],
    place: CopyPlace,
    seconds: Mapping[str, float],
    strict: bool = False,
) -> None:
    """Write one copy with its report; images are rendered as the adapter asks for them. What was made anew is read
    back, each image once.

    Raises Rejected, before anything appears, if it is `strict` and the copy is faulty, and RpaugError, with nothing
    left there, if what was written cannot be read.
    """
    start = time.perf_counter()

    def side(*said: str) -> Mapping[str, bytes]:
        if strict and (faults := made.judged()):
            raise Rejected("; ".join(faults))
        return side_files(made, recipe, place.source, place.copy, seconds, start, *said)

    adapter.write(made.recorded, place.root, place.key, side)
    try:
        _read_back(adapter, made, place)
    except RpaugError as error:
        shutil.rmtree(place.root / place.key, ignore_errors=True)
        raise RpaugError(f"{place.key}: what was written cannot be read back: {error}") from None


def _read_back(adapter: Adapter, made: Made, place: CopyPlace) -> None:
    again, recorded = adapter.read(place.root, place.key), made.scene.episode
    changed = {at for at, pixels in made.tally.changed.items() if pixels}
    images: list[tuple[str, ImageKind, int]] = []
    for name in sorted(again.views.keys() & recorded.views.keys()):
        view, before, after = (one.views[name] for one in (again, recorded, made.episode))
        images += [(name, "rgb", t) for t in range(again.length) if (name, t) in changed]
        if view.depth is not None and after.depth is not before.depth:
            images += [(name, "depth", t) for t in range(again.length)]
        if view.ids is not None and after.ids is not before.ids:
            images += [(name, "ids", t) for t in range(again.length)]
    adapter.see_readable(again, images)


def side_files(
    made: Made,
    recipe: Mapping[str, Any],
    source: str,
    copy: int,
    seconds: Mapping[str, float],
    start: float,
    *said: str,
) -> Mapping[str, bytes]:
    """The report of a copy whose images are rendered, and its hole masks. It was begun to be written at `start`; what
    the adapter `said` of it is a warning."""
    spent = {"render": made.tally.seconds, "write": time.perf_counter() - start}
    judged = made.judged()
    gates = gating.described(made.figures, judged, made.attempt) if made.gates or judged else None
    told = (*made.lacking, *made.uneven)
    return report.side_files(
        source=source,
        copy=copy,
        synthetic=copy != ORIGINAL and _edited(made),
        recipe=dict(recipe),
        draws=[draw.describe() for draw in made.draws],
        repainted=made.repainted,
        plan=replace(made.plan, warnings=(*made.plan.warnings, *told, *said)).describe(),
        tally=made.tally,
        surfels=drawn(made),
        gaussians=len(made.scene.gaussians or ()),
        gates=gates,
        words=_words(made),
        roles=role_facts.describe(made.scene),
        physics=verdict.described(made.scene.simulated),
        seconds={**seconds, "draw": made.seconds, **spent},
    )


def _edited(made: Made) -> bool:
    """Whether a copy differs from its recording: edits may be left out, or not drawn."""
    return any(made.tally.changed.values()) or _words(made) is not None


def _words(made: Made) -> dict[str, Any] | None:
    """The instructions before and after, where an edit made them other ones or left some that may not hold."""
    before, after = made.scene.episode.descriptions, made.episode.descriptions
    if before == after and not made.left:
        return None
    words: dict[str, Any] = {"recorded": list(before), "written": list(after)}
    return {**words, "left": list(made.left)} if made.left else words


def drawn(made: Made) -> int:
    """Recorded pixels that stand for surfaces in this copy."""
    return sum(
        view.camera.width * view.camera.height * made.episode.length
        for name, view in made.episode.views.items()
        if made.plan.representations[name] < 3
    )


def replay(
    adapter: Adapter, source: Path, described: Mapping[str, Any], target: Path, key: str
) -> None:
    """Write again the episode that a report describes, from the recorded one; on the device that fitted it, which
    gives the same bits on the CPU alone. Raises RpaugError, also where that device is not there."""
    recipe = build_recipe(described["recipe"])
    plan, judged = described["plan"], described.get("gates") or {}
    episode = adapter.read(source, described["source"])
    donor_key = plan.get("fit", {}).get("founder")
    donor = partial(adapter.read, source, donor_key) if donor_key else None
    device = devices.chosen(plan.get("device", {}).get("fits", "cpu")).name
    scene, made_plan = prepare_scene(episode, recipe, plan["tier"], donor=donor, device=device)
    kept = not any(fault.startswith(verdict.INVALID) for fault in judged.get("faults", ()))
    words = (described.get("words") or {}).get("written")
    known = Known(judged.get("attempt", 0), described["draws"], words)
    prepared = PreparedEpisode(scene, made_plan, recipe, keep_invalid=kept, device=device)
    made = draw_copy(prepared, described["copy"], known=known)
    place = CopyPlace(described["source"], described["copy"], target, key)
    write(adapter, made, described["recipe"], place, {})
