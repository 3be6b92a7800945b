"""Recorded pixels as surfels: of the own camera, of other cameras and of other times."""

__all__ = ["carry", "lit", "parts", "plates", "pooled", "surface", "surfels", "unseen"]
