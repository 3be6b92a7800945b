"""The library of things to insert: what ships, and what its user added, found by category, colour and size."""

import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from rpaug.assets import picture, shapes, shipped
from rpaug.errors import BadInput, RpaugError, TargetError
from rpaug.files import read_bytes, write_atomic
from rpaug.scene import colours
from rpaug.types import Mesh

FOLDER = "RPAUG_ASSETS"  # environment variable: where added things are kept
ENDING = ".asset.npz"
COARSE = 24  # of 255: colours nearer than this vote alike
PARTS = ("points", "normals", "uv", "faces", "image")


@dataclass(frozen=True)
class Asset:
    """One thing: `size` are its extents in metres along the axes of its own frame, `colour` a colour word."""

    name: str
    category: str
    colour: str
    size: tuple[float, float, float]
    source: str  # "shipped", or the file it was added from

    @property
    def largest(self) -> float:
        """Metres of the longest side."""
        return max(self.size)


def folder() -> Path:
    """Where added things are kept; it may not exist yet."""
    named = os.environ.get(FOLDER)
    return Path(named) if named else Path.home() / ".local/share/rpaug/assets"


def assets() -> tuple[Asset, ...]:
    """All there are, by name."""
    return tuple(sorted((*_shipped(), *_added()), key=lambda asset: asset.name))


def find(
    category: str | None = None,
    colour: str | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Asset, ...]:
    """Those of a category, a colour word and a longest side in metres between two. Raises TargetError if none fits."""
    known = assets()
    word = colours.canonical(colour) if colour else None
    if colour and word is None:
        raise TargetError(f"no such colour word: {colour!r}; there are: {', '.join(colours.NAMES)}")
    found = tuple(
        asset
        for asset in known
        if (category is None or asset.category == category)
        and (word is None or colours.means(word, asset.colour))
        and (size is None or size[0] <= asset.largest <= size[1])
    )
    if not found:
        kinds = ", ".join(sorted({asset.category for asset in known}))
        raise TargetError(
            f"no asset fits category {category}, colour {colour}, size {size}; categories are: {kinds}"
        )
    return found


def get(name: str) -> Asset:
    """The asset of that name. Raises TargetError listing those there are."""
    for asset in assets():
        if asset.name == name:
            return asset
    raise TargetError(
        f"no asset is called {name!r}; there are: {', '.join(a.name for a in assets())}"
    )


@lru_cache(32)
def mesh(name: str) -> Mesh:
    """Its mesh, standing on its own z = 0 or lying as it was added."""
    if name in shipped.THINGS:
        return shapes.joined(shipped.THINGS[name][1]())
    get(name)
    with np.load(io.BytesIO(read_bytes(folder() / f"{name}{ENDING}")), allow_pickle=False) as data:
        points, normals, uv, faces, image = (data[part] for part in PARTS)
    return Mesh(points, normals, uv, faces, image)


def add(name: str, category: str, thing: Mesh, source: str) -> Asset:
    """Keep a mesh under a name. Raises BadInput if the name is taken or is no plain word."""
    if not name.isidentifier():
        raise BadInput(name, "name", found=name, expected="letters, digits and underscores")
    if name in shipped.THINGS or (folder() / f"{name}{ENDING}").exists():
        raise BadInput(name, "name", found="an asset of that name", expected="a name that is free")
    asset = _described(name, category, thing, source)
    facts = {"category": category, "colour": asset.colour, "size": asset.size, "source": source}
    out = io.BytesIO()
    parts = {part: getattr(thing, part) for part in PARTS}
    np.savez_compressed(out, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8), **parts)
    write_atomic(folder() / f"{name}{ENDING}", out.getvalue())
    return asset


@lru_cache(1)
def _shipped() -> tuple[Asset, ...]:
    return tuple(
        _described(name, category, shapes.joined(pieces()), "shipped")
        for name, (category, pieces) in shipped.THINGS.items()
    )


def _added() -> Iterator[Asset]:
    for path in sorted(folder().glob(f"*{ENDING}")):
        try:
            with np.load(path, allow_pickle=False) as data:
                facts = json.loads(data["facts"].tobytes())
            x, y, z = facts["size"]
            yield Asset(
                path.name.removesuffix(ENDING),
                facts["category"],
                facts["colour"],
                (x, y, z),
                facts["source"],
            )
        except (OSError, ValueError, KeyError) as error:
            raise BadInput(
                path, "asset", found=str(error), expected="a file written by `rpaug assets add`"
            ) from None


def _described(name: str, category: str, thing: Mesh, source: str) -> Asset:
    x, y, z = np.ptp(thing.points, axis=0).tolist()
    return Asset(name, category, _main_colour(thing), (x, y, z), source)


def _main_colour(thing: Mesh) -> str:
    """The colour word that covers most of what is seen of it from the front and from behind."""
    seen = np.concatenate([_albedo(thing, side) for side in (1.0, -1.0)])
    if not len(seen):
        raise RpaugError("this mesh has no surface")
    tones, count = np.unique((255 * seen).astype(np.uint8) // COARSE, axis=0, return_counts=True)
    votes: dict[str, int] = {}
    for tone, times in zip(tones, count.tolist(), strict=True):
        word = colours.nearest((COARSE * tone + COARSE / 2) / 255.0)
        votes[word] = votes.get(word, 0) + times
    return max(votes, key=lambda word: votes[word])


def _albedo(thing: Mesh, towards: float) -> np.ndarray:
    seen = picture.drawn(thing, 96, towards)
    return seen.albedo[seen.hit]
