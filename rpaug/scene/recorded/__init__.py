"""Recorded pixels as surfels: of the own camera, of other cameras and of other times."""
