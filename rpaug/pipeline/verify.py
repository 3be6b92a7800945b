"""Check an augmented dataset against its source: what must not have changed, and what trips its readers."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from rpaug.core import registry, splits
from rpaug.core.errors import BadInput, RpaugError
from rpaug.core.files import REJECTED
from rpaug.core.interfaces import Adapter
from rpaug.core.progress import told
from rpaug.core.types import CameraView, Effect, Embeddings, Episode
from rpaug.pipeline import compare_layouts, compare_report, journal, plan, recipe, report
from rpaug.scene.tracking import agreement

LOOKED_AT = 6  # frames of each episode whose images are compared, evenly spread
SLACK = 2.0  # millimetres by which cameras may agree worse than they were recorded to
# Shares of a camera's points that another sees: what is worth comparing, and how much of it an edit may cost.
SEEN, LOST = 0.02, 0.2
Level = Literal["bad", "note"]
KINDS = {Effect.RGB: "rgb", Effect.DEPTH: "depth", Effect.MASK: "ids"}


@dataclass(frozen=True)
class Finding:
    """One thing that was found wrong, or worth knowing."""

    level: Level
    episode: str
    topic: str
    message: str


@dataclass(frozen=True)
class Verdict:
    """All findings, how many episodes were compared, and color statistics of both datasets, 0 to 255.

    Images were compared in `frames` frames of each episode, None for all.
    """

    episodes: int
    findings: tuple[Finding, ...]
    statistics: dict[str, dict[str, float]]
    frames: int | None = None

    @property
    def passed(self) -> bool:
        """Whether nothing bad was found."""
        return not any(finding.level == "bad" for finding in self.findings)

    def describe(self) -> dict[str, Any]:
        """Plain values."""
        findings = [asdict(finding) for finding in self.findings]
        return {
            "passed": self.passed,
            "episodes": self.episodes,
            "frames": "all" if self.frames is None else self.frames,
            "findings": findings,
            "statistics": self.statistics,
        }


def verify(
    target: Path,
    source: Path,
    *,
    frames: int | None = LOOKED_AT,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Verdict:
    """Compare every episode with the one that its report names. Images are compared in `frames` frames, None for all.

    Raises BadInput where either folder holds no dataset, or the source is not what any episode was made from.
    """
    adapter = registry.adapter_for(target)
    keys = list(adapter.episodes(target))
    theirs = registry.adapter_for(source)
    known = set(theirs.episodes(source))
    reports = {key: report.of(target / key) for key in keys}
    _related(target, source, reports.values(), known)
    findings = [*_numbering(adapter, keys), *_counts(target, keys)]
    findings += [Finding("bad", ".", "dataset", words) for words in adapter.faults(target)]
    tallies = {"rgb, source": _FoundTally(), "rgb, output": _FoundTally()}
    for number, key in enumerate(keys):
        progress(number, len(keys))
        told(key, "comparing")
        try:
            made = adapter.read(target, key)
            given = reports[key]
            if given is None or not {"source", "draws"} <= given.keys():
                spoilt = (target / key / report.NAME).exists()
                words = f"no {report.NAME} of a copy or a conversion: rpaug did not make it"
                if spoilt:
                    words = f"{report.NAME} is spoilt: expected JSON with source and draws in it"
                findings.append(Finding("bad", key, "report", words))
                continue
            if given["source"] not in known:
                words = f"made from {given['source']}, which is not in {source}"
                findings.append(Finding("bad", key, "source", words))
                continue
            recorded = theirs.read(source, given["source"])
        except RpaugError as error:
            findings.append(Finding("bad", key, "reading", str(error)))
            continue
        findings += _leak(key, given)
        if given.get("converted"):
            findings += _converted(key, recorded, made, given, frames)
            if adapter.name == theirs.name:
                findings += _kept(adapter, key, recorded, made, given)
        else:
            findings += compare(key, recorded, made, given, frames)
            findings += _kept(adapter, key, recorded, made, given)
        for name, episode in zip(tallies, (recorded, made), strict=True):
            tallies[name].add(episode, frames)
        findings += [Finding("note", key, "reader", words) for words in adapter.traps(made)]
    progress(len(keys), len(keys))
    statistics = {name: tally.figures() for name, tally in tallies.items()}
    return Verdict(len(keys), _merged(findings), statistics, frames)


def _kept(
    adapter: Adapter, key: str, recorded: Episode, made: Episode, given: dict[str, Any]
) -> Iterator[Finding]:
    """Is all that no edit reaches as it was recorded?"""
    before, after = (adapter.untouched(one, _reworded(given)) for one in (recorded, made))
    wrong = [name for name in sorted({*before, *after}) if before.get(name) != after.get(name)]
    for name in wrong:
        how = "gone" if name not in after else "new" if name not in before else "changed"
        yield Finding("bad", key, "untouched data", f"{name}: {how}, and no edit reaches it")


def _converted(
    key: str, recorded: Episode, made: Episode, given: dict[str, Any], frames: int | None
) -> Iterator[Finding]:
    """What differs in another layout: notes of what its conversion said was lost or approximated, else bad."""
    said = given.get("lost")
    times = _times(made.length, frames)
    for level, _, topic, words in compare_layouts.compare(key, recorded, made, times):
        noted = level != "bad" and (said is None or words in said)
        yield Finding("note" if noted else "bad", key, topic, words)


def _related(
    target: Path, source: Path, reports: Iterable[dict[str, Any] | None], known: Set[str]
) -> None:
    """See that some episode was made from one of the source. Raises BadInput."""
    named = [given["source"] for given in reports if given and isinstance(given.get("source"), str)]
    if named and not known & set(named):
        found = f"no episode that {target} was made from ({named[0]}, ...)"
        raise BadInput(source, "--against", found=found, expected="the dataset that was the source")


def compare(
    key: str,
    recorded: Episode,
    made: Episode,
    given: dict[str, Any],
    frames: int | None = LOOKED_AT,
) -> Iterator[Finding]:
    """What differs between an episode and its source that the edits in its report do not account for."""
    allowed = _allowed(given)
    if made.length != recorded.length:
        yield Finding(
            "bad", key, "length", f"{made.length} frames, recorded were {recorded.length}"
        )
        return
    yield from _robot(key, recorded, made, _reworded(given))
    told_words = tuple((given.get("words") or {}).get("written", recorded.descriptions))
    # Layouts that hold words step by step hold the same words once.
    if not allowed & Effect.WORDS and {*made.descriptions} != {*told_words}:
        yield Finding(
            "bad",
            key,
            "instruction",
            f"found {list(made.descriptions)}; expected {list(told_words)}",
        )
    if list(made.views) != list(recorded.views):
        yield Finding(
            "bad", key, "cameras", f"{list(made.views)}, recorded were {list(recorded.views)}"
        )
        return
    for name, view in made.views.items():
        yield from _camera(
            key, name, recorded.views[name], view, allowed, _times(made.length, frames)
        )
    if allowed & Effect.RGB:
        times = _times(made.length, frames)
        yield from (
            Finding(*one) for one in compare_report.compare(key, recorded, made, given, times)
        )
    yield from _instances(key, recorded, made, given, _times(made.length, frames))
    yield from _agreement(key, recorded, made, _times(made.length, frames))
    if given.get("synthetic") and allowed & Effect.RGB and not _shown(recorded, made, frames):
        words = "no pixel differs in the frames compared, though the episode is called synthetic"
        yield Finding("note", key, "statistics", words)


def _shown(recorded: Episode, made: Episode, frames: int | None) -> bool:
    """Whether any image differs."""
    return any(
        view.rgb is not recorded.views[name].rgb
        and not np.array_equal(view.rgb(t), recorded.views[name].rgb(t))
        for name, view in made.views.items()
        for t in _times(made.length, frames)
    )


def _instances(
    key: str, recorded: Episode, made: Episode, given: dict[str, Any], times: Sequence[int]
) -> Iterator[Finding]:
    """Do masks show what the report says was put in, and nothing else that was never recorded?"""
    added = given.get("added", {})
    for instance_id, where in added.items():
        if not where and any(view.ids for view in made.views.values()):
            words = f"{instance_id} was put in, and no camera's mask shows it"
            yield Finding("note", key, "instances", words)
        for name, (t, pixels) in where.items():
            ids = made.views[name].ids
            found = 0 if ids is None else int((ids(t) == int(instance_id)).sum())
            if found != pixels:
                words = f"{name}, frame {t}: {found} pixels of {instance_id}; the report counts {pixels}"
                yield Finding("bad", key, "instances", words)
    unknown = _ids(made, times) - {0, *map(int, added)} - _ids(recorded, times)
    if unknown:  # all of the recording is looked at only then
        unknown -= {*_parts(given)} | _ids(recorded, range(recorded.length))
    if unknown:
        listed = ", ".join(map(str, sorted(unknown)))
        words = f"masks hold {listed}: neither recorded nor put in by the report"
        yield Finding("bad", key, "instances", words)


def _ids(episode: Episode, times: Sequence[int]) -> set[int]:
    """All ids in the masks of these frames."""
    masks = [view.ids for view in episode.views.values() if view.ids]
    return {int(one) for ids in masks for t in times for one in np.unique(ids(t))}


def _parts(given: dict[str, Any]) -> Iterator[int]:
    """Instance ids of parts that the edits of a report told apart."""
    for draw in _done(given):
        for target in plan.targets(recipe.option(draw["op"], draw["fields"]).operator):
            if target.part is not None:
                yield target.part.instance_id


def _allowed(given: dict[str, Any]) -> Effect:
    """All that the edits of a report may change."""
    allowed = Effect.NONE
    for draw in _done(given):
        allowed |= registry.operator(draw["op"]).effect
    return allowed


def _done(given: dict[str, Any]) -> list[dict[str, Any]]:
    """The draws of a report that changed anything."""
    return [draw for draw in given["draws"] if not draw.get("skipped") and not draw.get("left_out")]


def _reworded(given: dict[str, Any]) -> bool:
    """Whether a report says that words, or the vectors made of them, are others."""
    return bool(given.get("words")) or given.get("recipe", {}).get("embeddings") == "drop"


def _robot(key: str, recorded: Episode, made: Episode, reworded: bool = False) -> Iterator[Finding]:
    for field in fields(recorded.robot):
        old, new = getattr(recorded.robot, field.name), getattr(made.robot, field.name)
        if field.name == "extra":
            left = {*Embeddings.among((*old, *new))} if reworded else set()
            same = old.keys() - left == new.keys() - left and all(
                np.array_equal(old[name], new[name]) for name in old.keys() - left
            )
        else:
            same = (old is None) == (new is None) and (old is None or np.array_equal(old, new))
        if not same:
            yield Finding("bad", key, "robot", f"{field.name} is not bit for bit as recorded")


def _camera(
    key: str,
    name: str,
    recorded: CameraView,
    made: CameraView,
    allowed: Effect,
    times: Sequence[int],
) -> Iterator[Finding]:
    old, new = recorded.camera, made.camera
    if (old.width, old.height) != (new.width, new.height):
        found = f"{new.width}x{new.height}, recorded was {old.width}x{old.height}"
        yield Finding("bad", key, "size", f"{name}: {found}")
        return
    moved = not (
        np.array_equal(old.K, new.K) and np.array_equal(old.cam_to_world, new.cam_to_world)
    )
    if moved and not allowed & Effect.CAMERA:
        yield Finding("bad", key, "camera", f"{name}: moved, and no edit moves cameras")
    for effect, kind in KINDS.items():
        before, after = getattr(recorded, kind), getattr(made, kind)
        if (before is None) != (after is None):
            yield Finding(
                "bad", key, kind, f"{name}: {'gone' if after is None else 'never recorded'}"
            )
        elif before is not None:
            yield from _images(key, f"{name} {kind}", before, after, bool(allowed & effect), times)


def _images(
    key: str,
    name: str,
    before: Callable[[int], np.ndarray],
    after: Callable[[int], np.ndarray],
    edited: bool,
    times: Sequence[int],
) -> Iterator[Finding]:
    for t in times:
        old, new = before(t), after(t)
        if (old.shape, old.dtype) != (new.shape, new.dtype):
            kind = f"{new.dtype} {new.shape}, recorded was {old.dtype} {old.shape}"
            yield Finding("bad", key, "kind of image", f"{name}, frame {t}: {kind}")
            return
        if not edited and not np.array_equal(old, new):
            share = 100 * float((old != new).mean())
            message = f"{name}, frame {t}: {share:.2f} % differ, and no edit changes that"
            yield Finding("bad", key, "untouched images", message)
            return


def _agreement(
    key: str, recorded: Episode, made: Episode, times: Sequence[int]
) -> Iterator[Finding]:
    """Do depth and cameras still say the same of each point, camera by camera?"""
    after = agreement.by_pair(made.views, times)
    for pair, (apart, share) in agreement.by_pair(recorded.views, times).items():
        if any(made.views[name].depth is None for name in pair):
            continue  # said already
        now, left = after.get(pair, (0.0, 0.0))
        if now > apart + SLACK or (share > SEEN and left < LOST * share):
            words = (
                f"{now:.2f} mm apart, recorded {apart:.2f} mm; {100 * left:.1f} % of the first's points agree, "
                f"recorded {100 * share:.1f} %: depth or cameras are stale"
            )
            yield Finding("bad", key, "depth and cameras", f"{' and '.join(pair)}: {words}")


def _numbering(adapter: Adapter, keys: Sequence[str]) -> Iterator[Finding]:
    """Readers walk the numbers of a group until one is missing."""
    groups: dict[str, int] = {}
    for key in keys:
        group = PurePosixPath(adapter.key_at(key, 0)).parent.as_posix()
        wanted = adapter.key_at(key, groups.get(group, 0))
        groups[group] = groups.get(group, 0) + 1
        if wanted != key and _stem(wanted) == _stem(key):
            yield Finding("bad", key, "numbering", f"expected {wanted}: readers stop at a gap")


def _counts(target: Path, keys: Sequence[str]) -> Iterator[Finding]:
    """As many episodes as the run that made them counted, if that ended."""
    if (target / journal.NAME).exists() and not (target / report.SUMMARY).exists():
        words = f"the run that made these {len(keys)} has not ended: the same command with --resume goes on"
        yield Finding("bad", ".", "counts", words)
    try:
        given = json.loads((target / report.SUMMARY).read_bytes()).get("copies")
    except (OSError, ValueError, AttributeError):
        return
    held = sum(PurePosixPath(key).parts[0] != REJECTED for key in keys)
    if isinstance(given, int) and given != held:
        yield Finding("bad", ".", "counts", f"{held} episodes; {report.SUMMARY} counted {given}")


def _stem(key: str) -> str:
    return key.rstrip("0123456789")


def _leak(key: str, given: dict[str, Any]) -> Iterator[Finding]:
    """A copy stays in its source's split, or what is trained on has seen what is tested on."""
    mine, theirs = splits.kind(key), splits.kind(given["source"])
    if given.get("converted") and theirs is None:  # layouts that have splits call all of it train
        theirs = "train" if mine else None
    if mine != theirs:
        yield Finding("bad", key, "splits", f"made from {given['source']}, of another split")


def _times(length: int, frames: int | None) -> list[int]:
    every = np.arange(length) if frames is None else np.linspace(0, length - 1, frames).round()
    return sorted({int(t) for t in every})


def _merged(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """The same words about many episodes are said once, with their number."""
    several: dict[tuple[Level, str, str], list[str]] = {}
    for one in findings:
        several.setdefault((one.level, one.topic, one.message), []).append(one.episode)
    found = []
    for (level, topic, message), keys in several.items():
        where = keys[0] if len(keys) == 1 else f"{keys[0]} and {len(keys) - 1} more"
        found.append(Finding(level, where, topic, message))
    return tuple(found)


class _FoundTally:
    """Mean and spread of colors, summed up image by image; one all black stands for a camera that is not there."""

    def __init__(self) -> None:
        self._count, self._sum, self._squares = 0, np.zeros(3), np.zeros(3)

    def add(self, episode: Episode, frames: int | None) -> None:
        for view in episode.views.values():
            for t in _times(episode.length, frames):
                image = view.rgb(t).reshape(-1, 3).astype(np.float64)
                if not image.any():
                    continue
                self._count += len(image)
                self._sum += image.sum(0)
                self._squares += (image**2).sum(0)

    def figures(self) -> dict[str, float]:
        if not self._count:
            return {}
        mean = self._sum / self._count
        spread = np.sqrt(np.maximum(self._squares / self._count - mean**2, 0))
        values = {"red": mean[0], "green": mean[1], "blue": mean[2], "spread": spread.mean()}
        return {name: round(float(value), 2) for name, value in values.items()}
