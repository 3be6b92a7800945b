"""Which split of a dataset an episode belongs to, by its key: what was trained on must never be tested on.

`rpaug.splits` to whoever writes an adapter, who may rely on the names in `__all__`.
"""

from pathlib import PurePosixPath

__all__ = [
    "kind",
    "of",
]

KINDS = {
    "train": "train", "training": "train",
    "val": "val", "valid": "val", "validation": "val", "dev": "val", "eval": "val",
    "test": "test", "testing": "test", "holdout": "test",
}  # fmt: skip
"""Names that folders of splits go by, and the one that layouts with names of their own give them."""


def of(key: str) -> str | None:
    """The folder in an episode's key that names its split, or None."""
    return next((part for part in PurePosixPath(key).parts[:-1] if part.lower() in KINDS), None)


def kind(key: str) -> str | None:
    """Train, val or test; None where the key does not say."""
    name = of(key)
    return None if name is None else KINDS[name.lower()]
