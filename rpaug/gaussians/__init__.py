"""Gaussians fitted to an episode: static, moving, semantic, stylised, stored."""
