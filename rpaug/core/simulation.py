"""MuJoCo, to move things and not to show them."""

import os
import sys
from typing import Any

VARIABLE = "MUJOCO_GL"


def mujoco() -> Any:
    """The module. Where it is imported first, no OpenGL is asked for: whatever the variable names may be missing on a
    machine that renders nothing, and the import fails for it."""
    if "mujoco" not in sys.modules:
        before = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = "disable"
        try:
            import mujoco  # noqa: F401  # only here: it takes a third of a second to load
        finally:
            del os.environ[VARIABLE]
            if before is not None:
                os.environ[VARIABLE] = before
    return sys.modules["mujoco"]
