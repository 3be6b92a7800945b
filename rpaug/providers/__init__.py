"""Outside knowledge behind small interfaces: an offline default that works, and real models by local path.

Nothing here downloads anything unasked. Providers know images and words, never scenes.
"""

__all__ = [
    "clip",
    "depth",
    "detect",
    "features",
    "finder",
    "grabcut",
    "harmonise",
    "hub",
    "inpaint",
    "language",
    "llm_settings",
    "models",
    "models_settings",
    "poses",
    "segment",
    "words",
]
