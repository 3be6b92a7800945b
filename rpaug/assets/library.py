"""The library of things to insert: what ships, and what its user added, found by category, color and size."""

import contextlib
import io
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from rpaug.assets import picture, shapes, shipped
from rpaug.core import color_space
from rpaug.core.errors import BadInput, RpaugError, TargetError, there_are
from rpaug.core.files import read_bytes, write_atomic
from rpaug.core.types import Gaussians, Mesh

FOLDER = "RPAUG_ASSETS"  # environment variable: where added things are kept
ENDING = ".asset.npz"
SHIPPED = Path(__file__).with_name("shipped.json")
COARSE = 24  # of 255: colors nearer than this vote alike
PARTS = ("points", "normals", "uv", "faces", "image")
OUTLINED = "outlined"
SPLATS = "splats_"  # before the names of Gaussians' arrays


@dataclass(frozen=True)
class Asset:
    """One thing: `size` are its extents in metres along the axes of its own frame, `color` a color word.

    `gaussians` is how many it is shown by, 0 for a mesh. `provenance` says how a generated thing came to be.
    """

    name: str
    category: str
    color: str
    size: tuple[float, float, float]
    source: str  # "shipped", or the file it was added from
    gaussians: int = 0
    provenance: Mapping[str, str] = field(default_factory=dict)

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
    color: str | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Asset, ...]:
    """Those of a category, or called so, of a color word and a longest side in metres between two. Raises TargetError
    if none fits."""
    known = assets()
    word = color_space.canonical(color) if color else None
    if color and word is None:
        raise TargetError(f"no such color word: {color!r}; {there_are(color, color_space.NAMES)}")
    found = tuple(
        asset
        for asset in known
        if category in (None, asset.category, asset.name)
        and (word is None or color_space.means(word, asset.color))
        and (size is None or size[0] <= asset.largest <= size[1])
    )
    if not found:
        kinds = ", ".join(sorted({asset.category for asset in known}))
        raise TargetError(
            f"no asset fits category {category}, color {color}, size {size}; categories are: {kinds}"
        )
    return found


def closest(
    category: str | None = None,
    color: str | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[tuple[Asset, ...], tuple[float, float, float] | None]:
    """Things as `find` gives them, or those that come to the same once painted or scaled, and the color to paint them.

    What consists of Gaussians takes no paint. Raises TargetError for a category or a color word that there is not.
    """
    paint = color_space.canonical(color) if color else None
    for bounds in (size, None):
        with contextlib.suppress(TargetError):
            return find(category, color, bounds), None
        if paint is not None:
            with contextlib.suppress(TargetError):
                bare = tuple(one for one in find(category, None, bounds) if not one.gaussians)
                if bare:
                    return bare, color_space.rgb(color or paint)
    return find(category, color, None), None


def get(name: str) -> Asset:
    """The asset of that name. Raises TargetError listing those there are."""
    for asset in assets():
        if asset.name == name:
            return asset
    raise TargetError(f"no asset is called {name!r}; {there_are(name, (a.name for a in assets()))}")


def mesh(name: str) -> Mesh:
    """Its mesh, standing on its own z = 0 or lying as it was added; of Gaussians, how far they reach."""
    return _loaded(folder(), name)[0]


def gaussians(name: str) -> Gaussians | None:
    """The Gaussians that it is shown by, in its frame; None for a mesh."""
    return _loaded(folder(), name)[1]


def outlined(name: str) -> bool:
    """Whether its mesh is the very surface that its Gaussians show."""
    return _loaded(folder(), name)[2]


@lru_cache(32)
def _loaded(where: Path, name: str) -> tuple[Mesh, Gaussians | None, bool]:
    if name in shipped.THINGS:
        return shapes.joined(shipped.THINGS[name][1]()), None, False
    get(name)
    with np.load(io.BytesIO(read_bytes(where / f"{name}{ENDING}")), allow_pickle=False) as data:
        points, normals, uv, faces, image = (data[part] for part in PARTS)
        splats = None
        if SPLATS + "means" in data:
            splats = Gaussians(**{part: data[SPLATS + part] for part in Gaussians.ARRAYS})
        known = OUTLINED in data and bool(data[OUTLINED])
    return Mesh(points, normals, uv, faces, image), splats, known


def check_name(name: str) -> None:
    """Raises BadInput if a new thing cannot be called so."""
    if not name.isidentifier():
        raise BadInput(name, "name", found=name, expected="letters, digits and underscores")
    if name in shipped.THINGS or (folder() / f"{name}{ENDING}").exists():
        raise BadInput(name, "name", found="an asset of that name", expected="a name that is free")


def add(
    name: str,
    category: str,
    thing: Mesh,
    source: str,
    splats: Gaussians | None = None,
    provenance: Mapping[str, str] | None = None,
    outlined: bool = False,
) -> Asset:
    """Keep a thing under a name: a mesh, or Gaussians with the mesh that says how far they reach, or, `outlined`, whose
    very surface they show.

    Raises BadInput if the name is taken or is no plain word.
    """
    check_name(name)
    asset = replace(
        _described(name, category, thing, source),
        gaussians=0 if splats is None else len(splats),
        provenance=dict(provenance or {}),
    )
    kept = ("category", "color", "size", "source", "gaussians", "provenance")
    facts = {key: getattr(asset, key) for key in kept}
    out = io.BytesIO()
    parts = {part: getattr(thing, part) for part in PARTS}
    if splats is not None:
        parts |= {SPLATS + part: getattr(splats, part) for part in Gaussians.ARRAYS}
        parts |= {OUTLINED: np.array(outlined)}
    np.savez_compressed(out, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8), **parts)
    write_atomic(folder() / f"{name}{ENDING}", out.getvalue())
    return asset


@lru_cache(1)
def _shipped() -> tuple[Asset, ...]:
    """By what was measured of each before (`tools/measure_assets.py`): it would take a worker two seconds."""
    facts = json.loads(SHIPPED.read_text())
    return tuple(
        Asset(name, category, facts[name]["color"], tuple(facts[name]["size"]), "shipped")
        for name, (category, _) in shipped.THINGS.items()
    )


def measured() -> Iterator[Asset]:
    """The things that ship, each measured as one that is added would be."""
    for name, (category, pieces) in shipped.THINGS.items():
        yield _described(name, category, shapes.joined(pieces()), "shipped")


def _added() -> Iterator[Asset]:
    for path in sorted(folder().glob(f"*{ENDING}")):
        try:
            with np.load(path, allow_pickle=False) as data:
                facts = json.loads(data["facts"].tobytes())
            x, y, z = facts["size"]
            yield Asset(
                path.name.removesuffix(ENDING),
                facts["category"],
                facts["color"],
                (x, y, z),
                facts["source"],
                facts.get("gaussians", 0),
                facts.get("provenance", {}),
            )
        except (OSError, ValueError, KeyError) as error:
            raise BadInput(
                path, "asset", found=str(error), expected="a file written by `rpaug assets add`"
            ) from None


def _described(name: str, category: str, thing: Mesh, source: str) -> Asset:
    x, y, z = np.ptp(thing.points, axis=0).tolist()
    return Asset(name, category, _main_color(thing), (x, y, z), source)


def _main_color(thing: Mesh) -> str:
    """The color word that covers most of what is seen of it from the front and from behind."""
    seen = np.concatenate([_albedo(thing, side) for side in (1.0, -1.0)])
    if not len(seen):
        raise RpaugError("this mesh has no surface")
    tones, count = np.unique((255 * seen).astype(np.uint8) // COARSE, axis=0, return_counts=True)
    votes: dict[str, int] = {}
    for tone, times in zip(tones, count.tolist(), strict=True):
        word = color_space.nearest((COARSE * tone + COARSE / 2) / 255.0)
        votes[word] = votes.get(word, 0) + times
    return max(votes, key=lambda word: votes[word])


def _albedo(thing: Mesh, towards: float) -> np.ndarray:
    seen = picture.drawn(thing, 96, towards)
    return seen.albedo[seen.hit]
