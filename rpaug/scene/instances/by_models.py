"""What models know of an episode, asked once and kept: depth, and the instances that words mean.

What was found stays in the cache under the images, the words and the models it was found with.
"""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpaug.core import fingerprint, sampling
from rpaug.core.cache import place, trim
from rpaug.core.files import write_atomic
from rpaug.core.types import Episode
from rpaug.providers.models_settings import Models
from rpaug.scene.instances import outlined
from rpaug.scene.instances.outlined import Outlined

if TYPE_CHECKING:
    from rpaug.providers.depth import DepthModel
    from rpaug.providers.finder import Finder

KIND = "instances"  # in the cache
LOOKED = 12  # frames of each camera in which outlines are held against other masks
COVERED = 0.5  # of an instance, in an outline: it is part of what the words mean
AGREES = 0.5  # overlap of an outline and the instances in it: below, they are not the same thing

Progress = Callable[[float], None]


@dataclass(frozen=True)
class AskedModels:
    """The models of a run, and the words to ask them for."""

    models: Models
    phrases: tuple[str, ...] = ()
    progress: Progress = lambda share: None

    def depth(self) -> "DepthModel | None":
        """The model of depth, if one is named. Raises Unsupported, MissingExtra."""
        from rpaug.providers import depth  # only here: it brings torch

        named = self.models.depth
        return depth.depth(named, self.models.device) if named else None

    def outlined(self, episode: Episode) -> Outlined | None:
        """What the words mean in an episode; None without a model or words. Raises Unsupported, MissingExtra."""
        if not self.models.finds or not self.phrases:
            return None
        finder = _finder(self.models)
        stated = json.dumps([outlined.RULE, finder.name, sorted(self.phrases), episode.key])
        images = (
            view.rgb(t).tobytes() for view in episode.views.values() for t in range(episode.length)
        )
        where = place(KIND, fingerprint.of_all(stated.encode(), images)) / "outlined.npz"
        known = _load(where)
        if known is None:
            known = outlined.find(episode, sorted(self.phrases), finder, self.progress)
            _save(where, known)
            trim(keep=[where.parent])
        return known


NOTHING = AskedModels(Models())


@cache
def _finder(models: Models) -> "Finder":
    from rpaug.providers import finder  # only here: models bring torch

    return finder.finder(models)


def voted(episode: Episode, found: Outlined) -> tuple[dict[str, frozenset[int]], tuple[str, ...]]:
    """Of an episode with masks, which of its own instances the words mean: those that lie in the outlines."""
    inside: dict[int, dict[int, int]] = {}
    sizes: dict[int, int] = {}
    areas: dict[int, int] = {}
    for name, t, _, ids in sampling.images(episode, LOOKED):
        if ids is None:
            continue
        outline = found.at(name, t)
        for one, count in zip(*np.unique(ids, return_counts=True), strict=True):
            sizes[int(one)] = sizes.get(int(one), 0) + int(count)
        for thing in np.unique(outline[outline > 0]).tolist():
            mask = outline == thing
            areas[thing] = areas.get(thing, 0) + int(mask.sum())
            for one, count in zip(*np.unique(ids[mask], return_counts=True), strict=True):
                held = inside.setdefault(thing, {})
                held[int(one)] = held.get(int(one), 0) + int(count)
    names: dict[str, frozenset[int]] = {}
    notes = list[str]()
    for words, things in found.names.items():
        meant = set[int]()
        for thing in sorted(things):
            held = inside.get(thing, {})
            own = {one for one, count in held.items() if one and count >= COVERED * sizes[one]}
            shared = sum(held[one] for one in own)
            union = areas.get(thing, 0) + sum(sizes[one] for one in own) - shared
            if union and shared / union >= AGREES:
                meant |= own
                listed = ", ".join(map(str, sorted(own)))
                notes.append(f"{words!r}: instance {listed} by models and masks")
            else:
                notes.append(f"{words!r}: the models' outline is of no instance of the masks")
        names[words] = frozenset(meant)
        if not things:
            notes.append(f"{words!r}: the models found none")
    return names, tuple(notes)


def _save(path: Path, found: Outlined) -> None:
    facts = {
        "names": {words: sorted(ids) for words, ids in found.names.items()},
        "notes": found.notes,
    }
    packed = io.BytesIO()
    stacks: dict[str, Any] = {f"ids/{name}": ids for name, ids in found.ids.items()}
    np.savez_compressed(packed, facts=np.array(json.dumps(facts)), **stacks)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, packed.getvalue())


def _load(path: Path) -> Outlined | None:
    """What was kept; None if there is nothing, or nothing that can be read."""
    try:
        with np.load(path, allow_pickle=False) as held:
            facts = json.loads(str(held["facts"]))
            ids = {name[4:]: held[name] for name in held.files if name.startswith("ids/")}
    except (OSError, ValueError, KeyError, EOFError):
        return None
    names = {words: frozenset(some) for words, some in facts["names"].items()}
    return Outlined(ids, names, tuple(facts["notes"]))
