"""The three contracts a third party implements or meets: Operator, Adapter, Edit."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import ConfigDict

from rpaug.core.errors import BadInput, Unsupported
from rpaug.core.types import Effect, Episode, Scene
from rpaug.core.validation import Validated

ImageKind = Literal["rgb", "depth", "ids"]  # as a camera's view names them
IMAGE_KINDS: tuple[ImageKind, ...] = get_args(ImageKind)

Edit = dict[str, Any]
"""One drawn change as plain JSON values: enough, with the operator's fields, to replay it exactly."""

Examples = tuple[tuple[str, Mapping[str, Any]], ...]
"""Wishes in a person's words, each with the fields of the operator that it comes to."""

Side = Callable[..., Mapping[str, bytes]]
"""Files to lay beside an episode's own, by name; asked for once all its images have been rendered. Given what could not
be had in writing it, in words, for the report's warnings."""


@dataclass(frozen=True)
class Needs:
    """What an operator asks of the scene before it is drawn: `targets` and `anchors` name its own fields.

    `targets` hold the things it edits: each field one target, several or None. `anchors` hold things that only say
    where. `bodies`: instances are told apart and tracked though no target is given. `gaussians`: fitted ones are there.
    `depth`: a source without any is refused. `lamps`: instances are told apart and tracked where shadows pass over
    what rests, since they tell where lamps are; a field's name: only where that field is given.
    """

    targets: tuple[str, ...] = ()
    anchors: tuple[str, ...] = ()
    bodies: bool = False
    gaussians: bool = False
    depth: bool = False
    lamps: bool | str = False


@dataclass(frozen=True)
class Painted:
    """Recorded instances look different now. `word` is the color or pattern they go by, None where none fits. `anew`:
    in the place of what was painted so on them before."""

    instance_ids: frozenset[int]
    word: str | None
    anew: bool = False


@dataclass(frozen=True)
class Added:
    """A thing was put in: its kind ("mug"), its name with words joined by "_", and its color word."""

    kind: str
    name: str
    color: str


Change = Painted | Added
"""What instructions are told of an edit. What was moved, resized, copied or taken out is read off the bodies."""


class Operator(metaclass=Validated):
    """One kind of edit. Subclasses are frozen keyword-only dataclasses; their fields are the recipe's keys, and taken
    from Python as from a recipe.

    A subclass declares `effect`, what it `needs`, and for `rpaug ask` the `phrases` that ask for it (`core.phrases`),
    and two `examples`: wishes, and the fields that each comes to, which a language model is shown. `asked_as` are words
    by what they ask for, parted by commas, which rpaug's own operators bring to its grammar.
    `undone_as` are words by which a wish takes it back, beside its name. Two edits that `settle` the same ("size") of
    one thing cannot both hold: the later takes the earlier's place. An edit made `everywhere` asks for no place in an
    image; one that `puts` things puts them where none were. Registering it under the entry-point group
    `rpaug.operators` makes its entry-point name an `op:` in recipes.
    `rpaug.OperatorContract` holds it to the promises below.
    """

    __pydantic_config__ = ConfigDict(extra="forbid", arbitrary_types_allowed=True)

    effect: ClassVar[Effect]
    needs: ClassVar[Needs] = Needs()
    phrases: ClassVar[tuple[str, ...]] = ()
    asked_as: ClassVar[Mapping[str, str]] = {}
    examples: ClassVar[Examples] = ()
    undone_as: ClassVar[tuple[str, ...]] = ()
    settles: ClassVar[str] = ""
    puts: ClassVar[bool] = False
    everywhere: ClassVar[bool] = False

    def ready(self) -> None:  # most need nothing but the scene
        """Raises RpaugError where something beside the recording is missing, before any work is done."""

    @abstractmethod
    def sample(self, scene: Scene, rng: np.random.Generator) -> Edit:
        """Draw once for the whole episode. Raises TargetError if the scene lacks what the edit needs."""

    @abstractmethod
    def apply(self, scene: Scene, edit: Edit) -> Scene:
        """The edited scene; the one passed in is left as it was."""

    def says(self, edit: Edit) -> Sequence[Change]:
        """What an instruction must follow. An instance with more appearances than `Painted` has no true color word."""
        return ()

    def falls_short(self, edit: Edit) -> Mapping[str, tuple[int, int]]:
        """What of the wish the edit could not fulfil: in words, and how many of how many things it befell, 0 too."""
        return {}


class Adapter(ABC):
    """One dataset layout: where its episodes are, how to read one, how to write one.

    Registered under the entry-point group `rpaug.adapters`. Episodes are named by keys, paths relative to the
    dataset's root with forward slashes. `rpaug.AdapterContract` holds an adapter to its promises.
    """

    name: ClassVar[str]
    gathers: ClassVar[bool] = False  # `finish` brings parts of episodes into files that they share
    loose: ClassVar[bool] = False  # claims files that other layouts hold too: is asked last
    after: ClassVar[str] = (
        ""  # what whoever trains on the output should know, said at the end of a run
    )

    @abstractmethod
    def episodes(self, root: Path) -> Sequence[str]:
        """Keys of all episodes in natural order; empty if this is not our layout. Reads no episode."""

    @abstractmethod
    def read(self, root: Path, key: str) -> Episode:
        """One episode, images lazy. Raises BadInput for whatever is wrong in its files, before any edit."""

    @abstractmethod
    def write(self, episode: Episode, root: Path, key: str, side: Side) -> None:
        """Write the episode as `key`, with side files beside its own, by one atomic rename.

        Begins with what was recorded (`episode.source`), so that unknown fields survive; an image whose
        accessor is the recorded one, or whose pixels are unchanged, keeps its bytes. Raises BadInput if
        `key` exists.
        """

    @abstractmethod
    def key_at(self, like: str, index: int) -> str:
        """The key of episode number `index` in the group that `like` belongs to; keys of a group count from 0."""

    def key_for(self, like: str, index: int) -> str:
        """The key here of episode number `index` of the group that another layout's key `like` belongs to."""
        return self.key_at(like, index)

    def in_version(self, version: str) -> "Adapter":
        """The adapter that writes one version of the layout (`rpaug convert --to NAME@VERSION`). Raises BadInput."""
        found, expected = f"@{version}", "no version: the layout is written in one"
        raise BadInput(Path(self.name), "version", found=found, expected=expected)

    def losses(self, episode: Episode) -> Sequence[str]:  # versions of most layouts hold the same
        """What the version that is written does not hold of an episode recorded in another version, in words."""
        return ()

    def unshared(
        self, episode: Episode
    ) -> Sequence[str]:  # most layouts have a place for little else
        """Names of what the files of an episode that was read hold, and no episode of another layout does."""
        return ()

    def traps(self, episode: Episode) -> Sequence[str]:  # most layouts have none
        """What known readers of this layout would trip over in an episode, in words."""
        return ()

    def see_readable(self, episode: Episode, images: Iterable[tuple[str, ImageKind, int]]) -> None:
        """See that images of an episode that was read, by camera, kind and frame, can be decoded. Raises RpaugError."""
        for camera, kind, t in images:
            getattr(episode.views[camera], kind)(t)

    def untouched(self, episode: Episode, edited_words: bool) -> Mapping[str, bytes]:
        """What the files of an episode that was read hold beside images, depth, instance ids, words and cameras, by
        name: no edit may change any of it. Vectors made of words are left out where an edit changed the words."""
        return {}

    def faults(self, root: Path) -> Sequence[str]:  # most layouts describe nothing as a whole
        """What a dataset of this layout says of itself as a whole that is not so, in words."""
        return ()

    def missing(self, root: Path) -> Path | None:  # most layouts can be read without any one file
        """The file that a dataset of this layout under `root` lacks, whose other files are there; or None."""
        return None

    def reobserve(
        self,
        root: Path,
        target: Path,
        simulator: Path,
        progress: Callable[[int, int], None],
        color: bool = False,
    ) -> tuple[int, Mapping[str, str]]:
        """Write the dataset to a new folder with what its simulator sees in the states that it holds: depth, instance
        ids, cameras, roles, and `color` too, which need not be the stored one then. `simulator` is the Python of that
        simulator. Returns how many episodes were written, and why others were not. Raises Unsupported for layouts that
        hold no states."""
        raise Unsupported(f"{self.name}: this layout holds no states of a simulator")

    def rename(self, root: Path, key: str, new: str) -> None:
        """Give an episode that a run wrote another key of its group, which is free."""
        os.rename(root / key, root / new)

    def finish(self, source: Path, target: Path) -> None:  # noqa: B027  # nothing to do for most layouts
        """Bring along what belongs to the dataset and to no single episode."""

    def scatter(self, root: Path, spoilt: Collection[Path]) -> None:  # noqa: B027  # most layouts gather nothing
        """The inverse of `finish`: episodes lie in folders of their own again, so that single ones can be made anew.
        What lies in one of the `spoilt` files, or cannot be read, is left out and is no episode then. Killed at any
        point, it may be called again. Raises BadInput where nothing can be brought back."""
