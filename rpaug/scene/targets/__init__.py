"""Which instances an edit means: by role, by instance id, or by words."""

__all__ = [
    "agreement",
    "nouns",
    "observed",
    "places",
    "relations",
    "roles",
    "settled",
    "shapes",
    "survey",
    "targets",
]
