"""RLBench, PerAct and COLOSSEUM episodes: a folder of PNGs and three pickles each.

`<episode>/{front,left_shoulder,right_shoulder,overhead,wrist}_{rgb,depth,mask}/<t>.png`, `low_dim_obs.pkl`,
`variation_number.pkl`, `variation_descriptions.pkl`. Traps this file knows about:

- the camera model is CoppeliaSim's: focal lengths are negative and a camera looks along +z with x to the left and
  y up; pixel centres lie at integer coordinates, as everywhere in rpaug;
- depth is 24-bit fixed point over three channels between the camera's near and far plane, z and not ray length;
- a mask codes the object's handle as R + 256 G + 65536 B; COLOSSEUM's may be single-channel, taken as it is;
- upstream RLBench keeps the descriptions in `variation<N>/`, not in the episode;
- readers run numpy 1 and push every attribute of an observation into a replay buffer: nothing may be added there.
"""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import ClassVar

from rpaug_adapters.rlbench.pickles import load
from rpaug_adapters.rlbench.read import (
    DESCRIPTIONS,
    LOW_DIM,
    RLBenchSource,
    read_episode,
    untouched,
)
from rpaug_adapters.rlbench.write import write_episode
from rpaug_adapters.shared.folders import see_no_link_out, write_files

from rpaug import Adapter, BadInput, Episode, ImageKind, Side, files, splits

CAMERAS = ("front", "left_shoulder", "right_shoulder", "overhead", "wrist")
FOLDERS: Mapping[ImageKind, str] = {"rgb": "rgb", "depth": "depth", "ids": "mask"}
VERSION = re.compile(r"\d+\.\d+\.\d+")
ELSEWHERE = ("all_variations", "episodes")  # of other layouts, and no names of tasks
EPISODE = re.compile(r"episode(\d+)$")


class RLBench(Adapter):
    """Reads and writes RLBench-format datasets in every layout named above."""

    name: ClassVar[str] = "rlbench"
    after: ClassVar[str] = (
        "If RVT trained on this path before, delete its replay folder: it would be reused."
    )

    def episodes(self, root: Path) -> Sequence[str]:
        return sorted(_keys(root), key=files.natural)

    def read(self, root: Path, key: str) -> Episode:
        see_no_link_out(root, root / key)
        _see_beside(root, _beside(key))
        return read_episode(root / key, key)

    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        recorded = episode.source if isinstance(episode.source, RLBenchSource) else None
        homeless = recorded is not None and _homeless(recorded, key)
        with files.atomic_folder(root / key) as work:
            write_episode(episode, recorded, work, with_descriptions=homeless)
            write_files(work, side())

    def key_at(self, like: str, index: int) -> str:
        return (PurePosixPath(like).parent / f"episode{index}").as_posix()

    def key_for(self, like: str, index: int) -> str:
        """`<split>/<task>/all_variations/episodes/episode<i>`, as RVT wants it; keys that are like ours stay so."""
        parts = PurePosixPath(like).parts
        if EPISODE.search(parts[-1]):
            return self.key_at(like, index)
        named = (splits.of(like), *ELSEWHERE)
        task = [part for part in parts[:-1] if part not in named and not VERSION.fullmatch(part)]
        split = [kind] if (kind := splits.kind(like)) else []
        place = PurePosixPath(*split, "_".join(task) or "task", "all_variations", "episodes")
        return (place / f"episode{index}").as_posix()

    def see_readable(self, episode: Episode, images: Iterable[tuple[str, ImageKind, int]]) -> None:
        source: RLBenchSource = episode.source
        for camera, kind, t in images:
            path = f"{source.folder}/{camera}_{FOLDERS[kind]}/{t}.png"
            files.check_png_pixels(path, files.read_bytes(path))

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        return untouched(episode.source)

    def traps(self, episode: Episode) -> Sequence[str]:
        """RVT and the fork of RLBench that it reads with (NVlabs/RVT)."""
        found = []
        missing = [name for name in CAMERAS if name not in episode.views]
        if missing:
            found.append(f"RVT's reader wants all five cameras; missing: {', '.join(missing)}")
        sizes = {(v.camera.width, v.camera.height) for v in episode.views.values()} - {(128, 128)}
        if sizes:
            listed = ", ".join(f"{width}x{height}" for width, height in sorted(sizes))
            found.append(f"RVT takes images of 128x128; there are some of {listed}")
        if any(view.depth is None for view in episode.views.values()):
            found.append("RVT builds its point clouds from depth; there are cameras without")
        return found

    def finish(self, source: Path, target: Path) -> None:
        """Descriptions that upstream RLBench keeps beside the `episodes` folder."""
        for beside in {_beside(key) for key in _keys(target)}:
            if beside and (source / beside).is_file() and not (target / beside).exists():
                _see_beside(source, beside)
                files.write_atomic(target / beside, files.read_bytes(source / beside))


def _keys(root: Path) -> Iterator[str]:
    """Keys as they lie on the disk. Of a million little is held: where each lies, so that none is found twice."""
    seen: dict[int, set[int]] = {}  # by device, inodes: a link may lead back
    yield from _keys_below(os.fspath(root), "", seen)


def _keys_below(top: str, within: str, seen: dict[int, set[int]]) -> Iterator[str]:
    folder = os.path.join(top, within)
    try:
        status = os.stat(folder)
        known = seen.setdefault(status.st_dev, set())
        if status.st_ino in known:
            return
        known.add(status.st_ino)
        named = within and EPISODE.search(os.path.basename(within))
        if named or os.path.isfile(os.path.join(folder, LOW_DIM)):
            yield Path(within).as_posix()
            return
        with os.scandir(folder) as entries:
            for one in entries:
                apart = one.name.startswith(".") or (not within and one.name == files.REJECTED)
                if not apart and one.is_dir():
                    yield from _keys_below(top, os.path.join(within, one.name), seen)
    except OSError as error:
        raise BadInput(
            str(error.filename), "folder", found=error.strerror, expected="a readable folder"
        ) from None


def _beside(key: str) -> str | None:
    """Where upstream RLBench keeps an episode's descriptions, if that lies within the dataset's root."""
    parts = PurePosixPath(key).parts
    return PurePosixPath(*parts[:-2], DESCRIPTIONS).as_posix() if len(parts) > 2 else None


def _see_beside(root: Path, beside: str | None) -> None:
    """See that descriptions beside episodes may be read and passed on. Raises BadInput."""
    if beside and (root / beside).is_file():
        files.see_inside(root, root / beside)
        load(root / beside)


def _homeless(recorded: RLBenchSource, key: str) -> bool:
    """Whether descriptions came from outside the episode and `finish` has no place for them in the target."""
    return (
        bool(recorded.descriptions)
        and not (recorded.folder / DESCRIPTIONS).is_file()
        and not _beside(key)
    )
