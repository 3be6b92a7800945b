"""Worlds that are not of our making: recorded, truly changed, and what rpaug makes of them (docs/foreign.md)."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")  # before anything imports mujoco
