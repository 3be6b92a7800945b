"""Instances that no mask names: found by motion, or by color in recordings of color images alone."""

__all__ = [
    "backdrop",
    "by_models",
    "by_motion",
    "color_clusters",
    "found",
    "ground_plane",
    "grouping",
    "jumps",
    "outlines",
    "rgb_episode",
]
