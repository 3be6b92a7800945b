"""A video's camera, depth and instances: structure from motion, and the scene made of it."""
