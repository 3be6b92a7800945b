"""rpaug multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out."""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from rpaug.core.errors import (
    BadInput,
    BadRecipe,
    MissingExtra,
    RpaugError,
    TargetError,
    Unsupported,
)
from rpaug.core.interfaces import Adapter, Edit, Operator, Side
from rpaug.core.types import (
    Appearance,
    Body,
    Camera,
    CameraView,
    Effect,
    Episode,
    Gaussians,
    Robot,
    Scene,
    Sensor,
    Surface,
)

if TYPE_CHECKING:
    from rpaug.core import files, geometry, safe_yaml, splits

__version__ = "0.1.0"

# What adapters are written with, loaded when it is asked for: the names in each module's `__all__`.
MODULES = {name: f"rpaug.core.{name}" for name in ("files", "geometry", "safe_yaml", "splits")}

__all__ = [
    "Adapter",
    "Appearance",
    "BadInput",
    "BadRecipe",
    "Body",
    "Camera",
    "CameraView",
    "Edit",
    "Effect",
    "Episode",
    "Gaussians",
    "MissingExtra",
    "Operator",
    "Robot",
    "RpaugError",
    "Scene",
    "Sensor",
    "Side",
    "Surface",
    "TargetError",
    "Unsupported",
    "files",
    "geometry",
    "safe_yaml",
    "splits",
]


def __getattr__(name: str) -> ModuleType:
    if name in MODULES:
        return import_module(MODULES[name])
    raise AttributeError(f"module 'rpaug' has no attribute {name!r}")
