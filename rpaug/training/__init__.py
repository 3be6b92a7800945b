"""Augmentation inside a training loop: every epoch sees every demonstration edited anew."""

from rpaug.training.episodes import AugmentedEpisodes

__all__ = ["AugmentedEpisodes"]
