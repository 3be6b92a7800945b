"""Augmentation inside a training loop: every epoch sees every demonstration edited anew."""

from rpaug.training.episodes import AugmentedEpisodes, AugmentedStream
from rpaug.training.frames import Windows
from rpaug.training.schedule import Schedule
from rpaug.training.wrapping import wrap

__all__ = ["AugmentedEpisodes", "AugmentedStream", "Schedule", "Windows", "wrap"]
