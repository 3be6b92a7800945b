"""The light an episode was recorded in: albedo, shading, lamps and shadows."""
