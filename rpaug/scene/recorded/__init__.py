"""Recorded pixels as surfels: of the own camera, of other cameras and of other times."""

__all__ = ["batched", "carry", "lit", "parts", "plates", "pooled", "surface", "surfels", "unseen"]
