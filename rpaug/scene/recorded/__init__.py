"""Recorded pixels as surfels: of the own camera, of other cameras and of other times."""

__all__ = [
    "batched",
    "carry",
    "lit",
    "parts",
    "plates",
    "pooled",
    "sensed",
    "surface",
    "surfels",
    "unseen",
]
