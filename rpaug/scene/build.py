"""From an episode to the scene that a plan asks for, and no more."""

from rpaug.scene import antialias, bodies, roles
from rpaug.scene.looks import look
from rpaug.types import Episode, Scene


def build(episode: Episode, *, with_bodies: bool) -> Scene:
    """The recorded scene. Bodies and roles are found only where an edit needs to know them."""
    tracked: tuple = ()
    named: dict = {}
    if with_bodies:
        looks = look(episode)
        tracked = bodies.track(episode, looks)
        named = dict(roles.infer(episode, tracked, looks))
    return Scene(
        episode=episode,
        cameras={name: view.camera for name, view in episode.views.items()},
        bodies=tracked,
        roles=named,
        antialiased=antialias.detect(episode),
        descriptions=episode.descriptions,
    )
