"""The light an episode was recorded in: albedo, shading, lamps and shadows."""

__all__ = [
    "albedo",
    "ambience",
    "beliefs",
    "black_body",
    "casting",
    "gamut",
    "grain",
    "highlights",
    "intrinsic",
    "irradiance",
    "light",
    "recast",
    "rig",
    "shading",
    "shadows",
    "two_views",
]
