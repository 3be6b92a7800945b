"""Videos of one camera; Ego4D's annotations are one reader of it."""

from rpaug_adapters.video.adapter import Videos

__all__ = ["Videos"]
