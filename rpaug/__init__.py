"""rpaug multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rpaug.core.errors import (
    BadInput,
    BadRecipe,
    MissingExtra,
    RpaugError,
    TargetError,
    Unsupported,
)
from rpaug.core.interfaces import Adapter, Added, Change, Edit, Needs, Operator, Painted, Side
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
    from rpaug.pipeline.contracts import AdapterContract, OperatorContract
    from rpaug.scene.targets.targets import Target
    from rpaug.scene.targets.targets import find as find_target

__version__ = "0.1.0"

# What is loaded only when it is asked for: its module, and its name there.
LATER = {
    "AdapterContract": ("rpaug.pipeline.contracts", "AdapterContract"),
    "OperatorContract": ("rpaug.pipeline.contracts", "OperatorContract"),
    "Target": ("rpaug.scene.targets.targets", "Target"),
    "find_target": ("rpaug.scene.targets.targets", "find"),
}

__all__ = [
    "Adapter",
    "AdapterContract",
    "Added",
    "Appearance",
    "BadInput",
    "BadRecipe",
    "Body",
    "Camera",
    "CameraView",
    "Change",
    "Edit",
    "Effect",
    "Episode",
    "Gaussians",
    "MissingExtra",
    "Needs",
    "Operator",
    "OperatorContract",
    "Painted",
    "Robot",
    "RpaugError",
    "Scene",
    "Sensor",
    "Side",
    "Surface",
    "Target",
    "TargetError",
    "Unsupported",
    "find_target",
]


def __getattr__(name: str) -> Any:
    if name in LATER:
        module, own = LATER[name]
        return getattr(import_module(module), own)
    raise AttributeError(f"module 'rpaug' has no attribute {name!r}")
