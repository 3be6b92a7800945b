"""Gaussians in space and time, for what no rigid motion explains."""
