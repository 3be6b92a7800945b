"""The edited scene turned into images: every camera's views, what was added, the joint refinement."""

__all__ = ["batched", "inserted", "joint", "tuned", "views"]
