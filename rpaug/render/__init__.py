"""From surfaces to pixels: the z-buffer, outlines and mattes, and the splat rasteriser."""

__all__ = [
    "batched",
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
