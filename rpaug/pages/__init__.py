"""HTML pages that need nothing beside them: contact sheet, an episode's instances, the preview; one stylesheet."""

__all__ = ["contact", "instances", "preview", "serve", "told"]
