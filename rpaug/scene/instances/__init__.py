"""Instances that no mask names: found by motion, or by colour in recordings of colour images alone."""
