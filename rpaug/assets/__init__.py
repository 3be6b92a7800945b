"""Things to put into scenes: shapes that ship, and meshes and Gaussians of one's own."""

__all__ = ["generate", "library", "picture", "reading", "sampled", "settle"]
