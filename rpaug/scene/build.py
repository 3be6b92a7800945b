"""From an episode to the scene that a plan asks for: its instances come from the first of four sources that suits it.

A video of a moving camera (`rpaug.scene.video`), color images alone, motion of what has depth but no masks, and masks
that were recorded. They share what they are asked and what they answer (`rpaug.scene.instances.found`), and no method:
what each makes of its pixels stays in its own module. Single images of rollouts, which belong to no episode, are
compared by `rpaug.diagnosis.things`.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rpaug.core import memo, sampling
from rpaug.core.errors import Unsupported
from rpaug.core.types import Belief, Body, Episode, Scene
from rpaug.scene.instances import by_motion, rgb_episode
from rpaug.scene.instances.by_models import NOTHING, AskedModels, voted
from rpaug.scene.instances.found import FoundInstances, InstanceFinder
from rpaug.scene.recorded import sensed
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import roles
from rpaug.scene.tracking import bodies
from rpaug.scene.tracking.arms import KNOWN, Kinematics

SAMPLED = 32  # frames of each camera in which instances without depth are looked for


def build(
    episode: Episode,
    *,
    with_bodies: bool,
    arms: Sequence[Kinematics] = KNOWN,
) -> Scene:
    """The recorded scene. Bodies and roles are found only where an edit needs to know them.

    `arms` are those whose links are looked for; `arms.read` adds one from a URDF or MJCF file. Where
    instances are needed and an episode has depth but no masks, they are told by motion; without depth, by color too.
    Depth that a sensor measured is repaired.
    """
    if not with_bodies:
        return FoundInstances(sensed.repaired(episode)).scene()
    return find(episode, sources(lambda: arms)).scene()


@dataclass(frozen=True)
class ByImages:
    """Color images alone, with the models there are: of depth, and of what words mean."""

    models: AskedModels = NOTHING
    gives_way: bool = False

    def suits(self, episode: Episode) -> bool:
        return rgb_episode.lacking(episode)

    def find(self, episode: Episode) -> FoundInstances:
        outlined = self.models.outlined(episode)
        found = rgb_episode.find(episode, self.models.depth(), outlined)
        return replace(found, names=outlined.names, told=outlined.notes) if outlined else found


@dataclass(frozen=True)
class ByMasks:
    """Instance ids that were recorded; with depth their motions are told, `arms` among them."""

    arms: Sequence[Kinematics]
    models: AskedModels = NOTHING
    gives_way: bool = False

    def suits(self, episode: Episode) -> bool:
        return True

    def find(self, episode: Episode) -> FoundInstances:
        outlined = self.models.outlined(episode)
        names, told = voted(episode, outlined) if outlined else ({}, ())
        if not all(view.depth and view.ids for view in episode.views.values()):
            return FoundInstances(episode, _untracked(episode), names=names, told=told)
        tracked, beliefs = _tracked(memo.recorded(episode), tuple(self.arms))
        return FoundInstances(
            episode, tracked, roles.held(beliefs), beliefs=beliefs, names=names, told=told
        )


@memo.once
def _tracked(
    episode: Episode, arms: tuple[Kinematics, ...]
) -> tuple[tuple[Body, ...], dict[str, Belief]]:
    """How instances move and what is believed of roles, once for all copies of an episode."""
    sampled = look(episode)
    tracked = bodies.track(episode, sampled, arms)
    return tracked, roles.believe(episode, tracked, sampled)


@dataclass(frozen=True)
class ByMotion:
    """Instance ids that are told by what moves together, then taken for recorded ones."""

    arms: Sequence[Kinematics]
    models: AskedModels = NOTHING
    gives_way: bool = False

    def suits(self, episode: Episode) -> bool:
        return by_motion.unmasked(episode)

    def find(self, episode: Episode) -> FoundInstances:
        outlined = self.models.outlined(episode)
        masked = by_motion.masked(episode)
        if outlined is None:
            return ByMasks(self.arms).find(masked)
        views = {name: outlined.shown(view, name) for name, view in masked.views.items()}
        found = ByMasks(self.arms).find(replace(masked, views=views))
        return replace(found, names=outlined.names, told=outlined.notes)


def sources(
    arms: Callable[[], Sequence[Kinematics]],
    models: AskedModels = NOTHING,
    video: InstanceFinder | None = None,
) -> Iterator[InstanceFinder]:
    """The sources in the order in which they are tried; `arms` is asked only if `video` is not the one."""
    if video is not None:
        yield video
    known = arms()
    yield from (ByImages(models), ByMotion(known, models), ByMasks(known, models))


def find(episode: Episode, among: Iterable[InstanceFinder]) -> FoundInstances:
    """The instances as the first source tells them that suits the episode. Raises Unsupported if it cannot."""
    notes, episode = list[str](), sensed.repaired(episode)
    for source in among:
        if not source.suits(episode):
            continue
        try:
            return replace(source.find(episode), notes=tuple(notes))
        except Unsupported as error:
            if not source.gives_way:
                raise
            notes.append(f"{error}; rpaug falls back to images only")
    raise Unsupported("no source tells this episode's instances")


def _untracked(episode: Episode) -> tuple[Body, ...]:
    """One body an instance, where masks tell them apart but no depth tells how they move."""
    still = np.tile(np.eye(4), (episode.length, 1, 1))
    found: set[int] = set()
    for _, _, _, ids in sampling.images(episode, SAMPLED):
        found |= set() if ids is None else set(np.unique(ids).tolist())
    return tuple(
        Body(frozenset([instance_id]), still, "unknown", ambiguous=True)
        for instance_id in sorted(found - {0})
    )
