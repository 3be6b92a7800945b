"""Gathering a LeRobot dataset's episodes into its shared files: tables, videos, words, statistics, description.

One episode is in memory at a time. A table takes its place as soon as it is whole, all else at the end, the description
last; what is gathered until then can be brought back (`staged`). Killed at any point, the next `pack` comes to the same
bytes.
"""

import json
import os
import shutil
from collections.abc import Collection, Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

from rpaug_adapters.lerobot import describe, pack_tables, staged, tables, words
from rpaug_adapters.lerobot.pack_tables import Files
from rpaug_adapters.lerobot.read import is_depth, lent, own_video, read_episode
from rpaug_adapters.lerobot.tables import (
    DATA_PATH,
    EMPTY,
    INFO,
    LINKED,
    OLD_TASKS,
    ROW,
    STAGED,
    STATISTICS,
    SUBTASKS,
    TASKS,
    VIDEO_PATH,
    Info,
    filled,
)
from rpaug_adapters.lerobot.write import link, taken_out, write_episode
from rpaug_adapters.shared import folders, video

from rpaug import BadInput, files

MOVED = ("meta/episodes", "videos")  # to their places when all is gathered
SHARED = (*MOVED, "data")
OWN = (
    STAGED,
    STATISTICS,
    LINKED,
    ROW,
    "*.mp4",
)  # of an episode's folder: what the shared files hold


def pack(folder: Path, like: Path) -> None:
    """Gather what is in episodes' own folders, with what was gathered before, and describe it all. Words keep the
    numbers that they have here, or in the dataset `like` that the episodes are of."""
    about = tables.info(folder)
    if folders.ungathered(
        folder, STAGED, {split: len(span) for split, span in about.splits.items()}
    ):
        about = _pack(folder, like)
    folders.drop_staged(folder, about.splits, OWN)


def _pack(folder: Path, like: Path) -> Info:
    """Gather what is staged, some of which the shared files lack."""
    _scatter(folder, None)
    work = folder / f".gathered{files.PART}"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    try:
        given = _gather(tables.info(folder), work, like)
        for path in work.rglob("*"):
            if path.is_file():
                files.flush(path)
        for name in MOVED:
            if (work / name).is_dir():
                (folder / name).parent.mkdir(exist_ok=True)
                os.replace(work / name, folder / name)
        for path in (work / "meta").glob("*.*"):
            os.replace(path, folder / "meta" / path.name)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    described = json.dumps(given, indent=4, ensure_ascii=False).encode()
    files.write_atomic(folder / INFO, described, durable=True)
    return tables.info(folder)


def scatter(folder: Path, spoilt: Collection[Path]) -> None:
    """Every episode into a folder of its own, and none in shared files: what lies in `spoilt` ones is left out, and
    what cannot be read. Words keep their numbers."""
    _scatter(folder, spoilt)


def _scatter(folder: Path, spoilt: Collection[Path] | None) -> None:
    """As `scatter`, file by file, each of which is removed then. Without `spoilt` nothing is left out: raises BadInput
    for what cannot be read."""
    about = tables.info(folder)
    lost = () if spoilt is None else (BadInput,)
    for path, episodes in _by_file(about, lost).items():
        for split, number in episodes:
            own = folder / split / str(number)
            try:
                if (own / STAGED).exists():
                    staged.write(staged.read(own), own)
                else:
                    _take_out(about, split, number, spoilt or ())
            except lost:
                (own / STAGED).unlink(missing_ok=True)
        path.unlink(missing_ok=True)
    emptied = about.given | EMPTY | {"splits": dict.fromkeys(about.splits, "0:0")}
    data = json.dumps(emptied, indent=4, ensure_ascii=False).encode()
    files.write_atomic(folder / INFO, data, durable=True)
    for name in SHARED:
        shutil.rmtree(folder / name, ignore_errors=True)


def _by_file(about: Info, lost: tuple[type[BadInput], ...]) -> dict[Path, list[tuple[str, int]]]:
    """The files of frames, each with the episodes that lie there and, whole, nowhere else. Those of which none can be
    found are left out where such an error is `lost`; else raises BadInput."""
    found: dict[Path, list[tuple[str, int]]] = {}
    if not (about.folder / "data").is_dir():
        return found
    for split, own in _own(about.folder):
        with suppress(*lost):
            if path := staged.lender(own):
                found.setdefault(path, []).append((split, int(own.name)))
    for split, number in _gathered(about):
        with suppress(*lost):
            found.setdefault(_data_file(about, split, number), []).append((split, number))
    return found


def _data_file(about: Info, split: str, number: int) -> Path:
    """The file with an episode's rows. Raises BadInput."""
    at = about.splits[split][number]
    return about.path(at, {} if about.old else tables.episode(about.folder, at), "data")


def _gathered(about: Info) -> Iterator[tuple[str, int]]:
    """Split and number of each episode of the shared files that does not lie in a folder of its own too."""
    for split, span in about.splits.items():
        for number in range(len(span)):
            if not (about.folder / split / str(number) / STAGED).exists():
                yield split, number


def _take_out(about: Info, split: str, number: int, spoilt: Collection[Path]) -> None:
    """An episode into a folder of its own, unless its video lies in a `spoilt` file. Raises BadInput."""
    target = about.folder / split / str(number)
    episode = read_episode(about.folder, about.folder, split, number, f"{split}/{number}")
    if any(span.path in spoilt for span in episode.source.spans.values()):
        return
    work = target.with_name(f".{number}{files.PART}")
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    write_episode(episode, episode.source, about, work)
    for path in work.iterdir():
        files.flush(path)
    target.mkdir(exist_ok=True)
    for path in sorted(work.iterdir(), key=lambda path: path.name == STAGED):
        os.replace(path, target / path.name)  # the table last: it makes the episode
    shutil.rmtree(work)  # a file that is there already, by another name, is not moved


def _gather(about: Info, work: Path, like: Path) -> dict[str, Any]:
    """Fill a folder with the shared files; returns the new description."""
    own = list(_own(about.folder))
    spoken = {
        "task": _known(about.folder, like, TASKS, OLD_TASKS),
        "subtask": _known(about.folder, like, SUBTASKS),
    }
    rows: list[dict[str, Any]] = []
    counts = pack_tables.gather(about, work, own, spoken, rows)
    for key in about.of_kind("video"):
        (_own_videos if about.old else _videos)(about, work, own, key, rows)
    counted = [
        _in_order(about, json.loads((path / STATISTICS).read_bytes()) | counts[number])
        for number, (_, path) in enumerate(own)
    ]
    describe.episodes(about, work, rows, spoken["task"], counted)
    if spoken["subtask"]:
        describe.write_words(work / SUBTASKS, "subtask", spoken["subtask"])
    if about.old and any((one / words.MODALITY).is_file() for one in (about.folder, like)):
        describe.low_dimensional(about, work)
    spans, at = {}, 0
    for split in dict.fromkeys(split for split, _ in own):
        count = sum(one == split for one, _ in own)
        spans[split] = f"{at}:{at + count}"
        at += count
    return about.given | {
        "total_episodes": len(own),
        "total_frames": rows[-1]["dataset_to_index"],
        "total_tasks": len(spoken["task"]),
        "splits": spans,
        **_paths(about, len(own)),
    }


def _in_order(about: Info, statistics: dict[str, Any]) -> dict[str, Any]:
    """Statistics in the order of the features, whatever order they were counted in."""
    return {key: statistics[key] for key in about.features if key in statistics}


def _known(folder: Path, like: Path, *names: str) -> dict[str, int]:
    """The numbers of words that were recorded, by the words."""
    for place, name in product((folder, like), names):
        if (place / name).is_file():
            given = tables.vocabulary(place / name) if name == SUBTASKS else tables.tasks(place)
            return {
                text: i
                for i, text in enumerate(dict.fromkeys(text for _, text in sorted(given.items())))
            }
    return {}


def _paths(about: Info, episodes: int) -> dict[str, Any]:
    """What the description says of files."""
    filmed = len(about.of_kind("video"))
    if not about.old:
        return {"data_path": DATA_PATH, "video_path": VIDEO_PATH if filmed else None}
    chunks = -(-episodes // about.chunk)
    return {"total_videos": episodes * filmed, "total_chunks": chunks}


def _own(folder: Path) -> Iterator[tuple[str, Path]]:
    """Split and folder of each episode, splits as they were told first."""
    known, found = list(tables.info(folder).splits), folders.staged(folder, STAGED)
    for split in sorted(found, key=lambda name: known.index(name) if name in known else len(known)):
        for number in found[split]:
            yield split, folder / split / str(number)


def _videos(
    about: Info, work: Path, own: list[tuple[str, Path]], key: str, rows: list[dict[str, Any]]
) -> None:
    """Join one camera's videos, without decoding; adds their places to `rows`.

    A recorded file of which every frame is here stays one, by one more name. Of the others, only streams of one format
    share a file: a file has one set of parameters, and what was encoded by others cannot be decoded with them. Every
    new file is then decoded whole. Raises BadInput.
    """
    shared = Files(about.given.get("video_files_size_in_mb"), about.chunk)
    starts, parts = _parts(about, work, own, key, rows)
    numbers: dict[Path, list[int]] = {}
    for number, part in parts.items():
        about_part = part.stat()
        place = (
            shared.place(0.0, (about_part.st_dev, about_part.st_ino))
            if number in starts
            else shared.place(about_part.st_size, video.stream_format(part))
        )
        target = work / filled(VIDEO_PATH, {**place, "video_key": key})
        numbers.setdefault(target, []).append(number)
        rows[number] |= {f"videos/{key}/{name}": value for name, value in place.items()}
    for target, held in numbers.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        if held[0] in starts:
            os.link(parts[held[0]], target)
            begins = [starts[number] for number in held]
        else:
            joined = video.joined((parts[number] for number in held), target)
            begins = [start for start, _ in joined]
            spans = [
                video.Span(target, start, rows[number]["length"], about.rate)
                for number, start in zip(held, begins, strict=True)
            ]
            video.decode_whole(spans)
            _lend(spans, [own[number][1] for number in held], key)
        for number, start in zip(held, begins, strict=True):
            rows[number] |= {
                f"videos/{key}/from_timestamp": start,
                f"videos/{key}/to_timestamp": start + rows[number]["length"] / about.rate,
            }


def _lend(spans: list[video.Span], owns: list[Path], key: str) -> None:
    """Let the file that holds them all be each episode's own video, where the file system has links: none lies there
    twice. What a killed run lent is taken for what it is only if every episode of the file has it."""
    for span, own in zip(spans, owns, strict=True):
        if not link(span.path, own / f"{key}@{span.start!r}.mp4"):
            return
    for own in owns:
        (own / f"{key}.mp4").unlink(missing_ok=True)


def _take_back(own: list[tuple[str, Path]], key: str, rows: list[dict[str, Any]]) -> None:
    """What a killed run lent to some episodes of a file and not to all of them."""
    borrowed: dict[int, list[tuple[int, Path]]] = {}
    for number, (_, path) in enumerate(own):
        if found := lent(path, key):
            borrowed.setdefault(found[0].stat().st_ino, []).append((number, found[0]))
    for held in borrowed.values():
        if sum(rows[number]["length"] for number, _ in held) < video.count(held[0][1]):
            for _, path in held:
                if (path.parent / f"{key}.mp4").is_file():
                    path.unlink()


def _parts(
    about: Info, work: Path, own: list[tuple[str, Path]], key: str, rows: list[dict[str, Any]]
) -> tuple[dict[int, float], dict[int, Path]]:
    """Each episode's video of a camera, and where it begins in those that are recorded files and stay whole. What is of
    a file that is not here whole, or of one that v2.1 may not share, is taken out of it."""
    _take_back(own, key, rows)
    starts: dict[int, float] = {}
    parts: dict[int, Path] = {}
    held: dict[tuple[int, int], list[int]] = {}
    for number, (_, path) in enumerate(own):
        parts[number], start = own_video(path, key)
        if start is not None:
            starts[number] = start
            about_file = parts[number].stat()
            held.setdefault((about_file.st_dev, about_file.st_ino), []).append(number)
    for numbers in held.values():
        spans = {(starts[number], rows[number]["length"]) for number in numbers}
        whole = sum(length for _, length in spans) == video.count(parts[numbers[0]])
        if whole and (len(spans) == 1 or not about.old):
            continue
        for number in numbers:
            span = video.Span(parts[number], starts.pop(number), rows[number]["length"], about.rate)
            parts[number] = work / "parts" / f"{key}-{number}.mp4"
            parts[number].parent.mkdir(exist_ok=True)
            taken_out(span, parts[number], is_depth(about.features[key]))
    return starts, parts


def _own_videos(
    about: Info, work: Path, own: list[tuple[str, Path]], key: str, rows: list[dict[str, Any]]
) -> None:
    """One camera's videos, each in a file of its own, as v2.1 has them; new ones are decoded whole. Raises BadInput."""
    starts, parts = _parts(about, work, own, key, rows)
    for number, part in parts.items():
        place = about.path(number, {}, f"videos/{key}", video_key=key).relative_to(about.folder)
        target = work / place
        target.parent.mkdir(parents=True, exist_ok=True)
        if not link(part, target):
            shutil.copyfile(part, target)
        if number not in starts:
            video.decode_whole([video.Span(target, 0.0, rows[number]["length"], about.rate)])
