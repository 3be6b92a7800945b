"""A video's camera, depth and instances: structure from motion, and the scene made of it."""

__all__ = ["instances", "model", "reconstruct", "settings", "sweep", "video_scene"]
