"""Values, contracts, geometry, color, metrics, files and caches: what every other folder may import."""

__all__ = [
    "cache",
    "color_space",
    "errors",
    "files",
    "geometry",
    "image_cache",
    "interfaces",
    "jit",
    "keyframes",
    "memo",
    "metrics",
    "phrases",
    "pixels",
    "registry",
    "safe_yaml",
    "sampling",
    "splits",
    "types",
    "validation",
    "version",
]
