"""From surfaces to pixels: the z-buffer, outlines and mattes, and the splat rasteriser."""

__all__ = [
    "composite",
    "denoise",
    "gains",
    "holes",
    "mesh",
    "outlines",
    "pinhole",
    "splat",
    "unmix",
    "window",
    "zbuffer",
]
