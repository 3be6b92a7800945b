"""DROID's raw recordings: `<lab>/success/<date>/<time>` with `trajectory.h5` and what its ZED cameras filmed."""

from rpaug_adapters.droid.adapter import DROID

__all__ = ["DROID"]
