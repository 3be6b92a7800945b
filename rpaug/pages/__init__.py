"""HTML pages that need nothing beside them: contact sheet, an episode's instances, the preview; one stylesheet. And an
episode in space, for viewers."""

__all__ = [
    "contact",
    "document",
    "instances",
    "live",
    "preview",
    "rerun_file",
    "serve",
    "space",
    "told",
]
