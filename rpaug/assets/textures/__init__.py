"""Textures: a set that ships as code, the user's own images, and how either lies on a surface."""

__all__ = ["batched", "folder", "mapping", "shipped"]
