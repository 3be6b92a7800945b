"""Values, contracts, geometry, colour, metrics, files and caches: what every other folder may import."""
