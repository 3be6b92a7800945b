"""Things that fall, bend and pour: a material point method, and a rigid solver for what is too stiff for it."""

__all__ = ["materials", "simulate", "verdict"]
