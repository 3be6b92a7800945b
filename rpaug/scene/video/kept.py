"""Instances of a video as they were told before, in its folder of the cache: the map of its world, each frame's ids.

They hang on poses, depth, what moves, the scale, and on how instances are told: other ones, another folder.
"""

import io
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Int32

from rpaug.core import geometry, pixels
from rpaug.core.files import write_atomic
from rpaug.providers import grabcut
from rpaug.scene import instances as finders
from rpaug.scene.video.clear import ClearThing
from rpaug.scene.video.instances import InstanceMap, LevelInstance, Support
from rpaug.scene.video.model import DAMAGED, fingerprint
from rpaug.scene.video.support_look import SupportLook


@dataclass(frozen=True)
class KeptInstances:
    """The instances of one video, as one state of the program tells them, in `folder`."""

    folder: Path

    def map(self, find: Callable[[], InstanceMap]) -> InstanceMap:
        """The kept map; what `find` finds if none is kept, or it is damaged."""
        with suppress(*DAMAGED), np.load(self.folder / "map.npz", allow_pickle=False) as held:
            stated = json.loads(str(held["facts"]))
            return InstanceMap(
                float(held["cell"]), held["codes"], held["instance_ids"], int(held["count"]),
                tuple(_support(one, held, k) if one else None for k, one in enumerate(stated["supports"])),
                stated["level"], tuple(LevelInstance(**one) for one in stated["levels"]),
            )  # fmt: skip
        found, arrays = find(), dict[str, np.ndarray]()
        for k, one in enumerate(found.supports):
            if one and one.look:
                arrays |= {f"codes_{k}": one.look.codes, f"colors_{k}": one.look.colors}
                arrays |= {f"clear_{thing.instance_id}": thing.codes for thing in one.clear}
        stated = {
            "level": found.level,
            "levels": [asdict(one) for one in found.levels],
            "supports": [_plain(one) if one else None for one in found.supports],
        }
        with suppress(OSError):  # a cache that may only be read
            keep(
                self.folder / "map.npz", cell=np.array(found.cell), codes=found.codes,
                instance_ids=found.instance_ids, count=np.array(found.count),
                facts=np.array(json.dumps(stated)), **arrays,
            )  # fmt: skip
        return found

    def frame(
        self, k: int, find: Callable[[int], Int32[np.ndarray, "h w"]]
    ) -> Int32[np.ndarray, "h w"]:
        """The kept ids of frame `k`, as runs of one id; what `find` finds if none are kept, or they are damaged."""
        path = self.folder / f"{k:05d}.npz"
        with suppress(*DAMAGED), np.load(path, allow_pickle=False) as held:
            runs = np.repeat(held["ids"].astype(np.int32), held["lengths"])
            return runs.reshape(held["shape"])
        found = find(k)
        flat = found.reshape(-1)
        starts = np.flatnonzero(np.diff(flat, prepend=flat[0] - 1))
        with suppress(OSError):
            keep(
                path, ids=flat[starts].astype(np.uint16), shape=np.array(found.shape),
                lengths=np.diff(starts, append=len(flat)),
            )  # fmt: skip
        return found


def _plain(one: Support) -> dict[str, Any]:
    """A support in plain values, but for the arrays of its places."""
    look = one.look and {"side": one.look.side, "level": one.look.level}
    ids, color = sorted(one.instance_ids), one.color.tolist()
    clear = [{**asdict(thing), "codes": None} for thing in one.clear]
    return {**asdict(one), "instance_ids": ids, "color": color, "look": look, "clear": clear}


def _support(stated: Mapping[str, Any], held: Mapping[str, np.ndarray], k: int) -> Support:
    """The support of piece `k` from plain values, and the arrays that are `held`."""
    ids, color = frozenset(stated["instance_ids"]), np.array(stated["color"], np.float32)
    look = stated["look"] and SupportLook(
        **stated["look"], codes=held[f"codes_{k}"], colors=held[f"colors_{k}"]
    )
    clear = tuple(
        ClearThing(**{**one, "codes": held[f"clear_{one['instance_id']}"]})
        for one in stated["clear"]
    )
    return Support(**{**stated, "instance_ids": ids, "color": color, "look": look, "clear": clear})


def keep(path: Path, **arrays: np.ndarray) -> None:
    """Write arrays into one packed file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    write_atomic(path, buffer.getvalue())


@cache
def rule() -> str:
    """A name for how instances are told: the sources that tell them, and OpenCV's version."""
    own, others = Path(__file__).parent, Path(finders.__file__).parent
    more = [Path(str(one.__file__)) for one in (geometry, pixels, grabcut)]
    sources = [*sorted(own.glob("*.py")), *sorted(others.glob("*.py")), *more]
    return fingerprint(cv2.__version__.encode(), *(path.read_bytes() for path in sources))
