"""Instances that no mask names: found by motion, or by colour in recordings of colour images alone."""

__all__ = ["by_motion", "found", "ground_plane", "grouping", "outlines", "rgb_episode"]
