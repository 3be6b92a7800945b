"""The light an episode was recorded in: albedo, shading, lamps and shadows."""

__all__ = ["albedo", "ambience", "gamut", "irradiance", "light", "shading", "shadows"]
