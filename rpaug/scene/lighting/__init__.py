"""The light an episode was recorded in: albedo, shading, lamps and shadows."""

__all__ = [
    "albedo",
    "ambience",
    "casting",
    "gamut",
    "grain",
    "highlights",
    "intrinsic",
    "irradiance",
    "light",
    "rig",
    "shading",
    "shadows",
    "two_views",
]
