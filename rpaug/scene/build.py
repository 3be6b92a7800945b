"""From an episode to the scene that a plan asks for, and no more."""

from collections.abc import Sequence

import numpy as np

from rpaug.core import sampling
from rpaug.core.types import Body, Episode, Scene
from rpaug.scene import antialias
from rpaug.scene.instances import by_motion, rgb_episode
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
    depth: str | None = None,
) -> Scene:
    """The recorded scene. Bodies and roles are found only where an edit needs to know them.

    `arms` are those whose links are looked for; `arms.read` adds one from a URDF or MJCF file. Where
    instances are needed and an episode has depth but no masks, they are told by motion; without depth, by colour too,
    and the model that `depth` names guesses it (`rpaug.providers.depth`).
    """
    if with_bodies:
        episode = by_motion.masked(episode)
    tracked: tuple = ()
    named: dict = {}
    lens = False
    if with_bodies and rgb_episode.lacking(episode):
        found = rgb_episode.find(episode, depth)
        episode, tracked, named = found.episode, found.bodies, dict(found.roles)
        lens = True  # a real one: it mixes the colours on either side of every outline
    elif with_bodies and not all(view.depth and view.ids for view in episode.views.values()):
        tracked = _untracked(episode)
    elif with_bodies:
        sampled = look(episode)
        tracked = bodies.track(episode, sampled, arms)
        named = dict(roles.infer(episode, tracked, sampled))
    return Scene(
        episode=episode,
        cameras={name: view.camera for name, view in episode.views.items()},
        bodies=tracked,
        roles=named,
        antialiased=lens or antialias.detect(episode),
        descriptions=episode.descriptions,
    )


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
