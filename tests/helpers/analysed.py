"""An episode with its bodies and roles found, unedited."""

from rpaug.core.types import Episode, Scene
from rpaug.scene.sampled_frames import look
from rpaug.scene.targets import roles
from rpaug.scene.tracking import bodies


def analysed(episode: Episode) -> Scene:
    sampled = look(episode)
    found = bodies.track(episode, sampled)
    beliefs = roles.believe(episode, found, sampled)
    cameras = {name: view.camera for name, view in episode.views.items()}
    known = roles.held(beliefs)
    return Scene(episode, cameras, found, known, False, episode.descriptions, beliefs=beliefs)
