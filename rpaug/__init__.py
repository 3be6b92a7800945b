"""rpaug multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out."""

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

__version__ = "0.1.0"

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
]
