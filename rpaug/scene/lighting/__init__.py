"""The light an episode was recorded in: albedo, shading, lamps and shadows."""

__all__ = ["albedo", "ambience", "irradiance", "light", "shading", "shadows"]
