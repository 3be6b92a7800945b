"""From surfaces to pixels: the z-buffer, outlines and mattes, and the splat rasteriser."""
