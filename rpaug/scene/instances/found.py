"""What finding an episode's instances comes to, and the interface of whoever finds them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from rpaug.core.types import Back, Belief, Body, Episode, Scene
from rpaug.scene import antialias


@dataclass(frozen=True)
class FoundInstances:
    """An episode whose views have instance ids, its bodies and its roles.

    `photographed` says that a lens mixed the colors on both sides of every outline. `back` brings an edited episode
    back into the recording where that shows other frames (`Scene.back`). `notes` say which sources failed before.
    `names` are the instance ids of words that models were asked for, and `told` says in sentences what they found.
    """

    episode: Episode
    bodies: tuple[Body, ...] = ()
    roles: Mapping[str, frozenset[int]] = field(default_factory=dict)
    photographed: bool = False
    back: Back | None = None
    notes: tuple[str, ...] = ()
    beliefs: Mapping[str, Belief] = field(default_factory=dict)
    names: Mapping[str, frozenset[int]] = field(default_factory=dict)
    told: tuple[str, ...] = ()

    def scene(self) -> Scene:
        """The recorded scene, with nothing edited."""
        return Scene(
            episode=self.episode,
            cameras={name: view.camera for name, view in self.episode.views.items()},
            bodies=self.bodies,
            roles=dict(self.roles),
            antialiased=self.photographed or antialias.detect(self.episode),
            descriptions=self.episode.descriptions,
            back=self.back,
            beliefs=dict(self.beliefs),
            names=dict(self.names),
        )


class InstanceFinder(Protocol):
    """One source of instances: recorded masks, motion, color images alone, or a moving camera's video."""

    @property
    def gives_way(self) -> bool:
        """Whether another source is tried where this one fails."""
        ...

    def suits(self, episode: Episode) -> bool:
        """Whether the episode has what this source reads, and nothing better."""
        ...

    def find(self, episode: Episode) -> FoundInstances:
        """The instances. Raises Unsupported if they cannot be told."""
        ...
