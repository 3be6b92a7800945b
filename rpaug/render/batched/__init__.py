"""Frames of many images at once, by torch: on a CUDA GPU, or on the CPU by the very same code.

What `rpaug.render` draws frame by frame, within stated tolerances; torch is imported with it, so that it is asked for
only where a device is.
"""

__all__ = ["composite", "matting", "pixels"]
