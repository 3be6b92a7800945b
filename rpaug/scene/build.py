"""From an episode to the scene that a plan asks for, and no more."""

from rpaug.scene import antialias, bodies, roles
from rpaug.types import Episode, Scene


def build(episode: Episode, *, with_bodies: bool) -> Scene:
    """The recorded scene. Bodies and roles are found only where an edit needs to know them."""
    tracked = bodies.track(episode) if with_bodies else ()
    return Scene(
        episode=episode,
        cameras={name: view.camera for name, view in episode.views.items()},
        bodies=tracked,
        roles=roles.infer(episode, tracked) if with_bodies else {},
        antialiased=antialias.detect(episode),
        descriptions=episode.descriptions,
    )
