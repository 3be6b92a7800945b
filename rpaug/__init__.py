"""rpaug multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out.

What is listed here, and `rpaug.training`, is for others to build on; everything else may change at any time. A name is
imported when it is first used: `import rpaug` alone costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rpaug.core.errors import BadInput as BadInput
    from rpaug.core.errors import BadRecipe as BadRecipe
    from rpaug.core.errors import MissingExtra as MissingExtra
    from rpaug.core.errors import Rejected as Rejected
    from rpaug.core.errors import RpaugError as RpaugError
    from rpaug.core.errors import TargetError as TargetError
    from rpaug.core.errors import Unsupported as Unsupported
    from rpaug.core.interfaces import Adapter as Adapter
    from rpaug.core.interfaces import Edit as Edit
    from rpaug.core.interfaces import Operator as Operator
    from rpaug.core.interfaces import Side as Side
    from rpaug.core.types import Appearance as Appearance
    from rpaug.core.types import Body as Body
    from rpaug.core.types import Camera as Camera
    from rpaug.core.types import CameraView as CameraView
    from rpaug.core.types import Effect as Effect
    from rpaug.core.types import Episode as Episode
    from rpaug.core.types import Gaussians as Gaussians
    from rpaug.core.types import Provenance as Provenance
    from rpaug.core.types import Robot as Robot
    from rpaug.core.types import Scene as Scene
    from rpaug.core.types import Sensor as Sensor
    from rpaug.core.types import Surface as Surface
    from rpaug.pipeline.contracts import AdapterContract as AdapterContract
    from rpaug.pipeline.contracts import OperatorContract as OperatorContract
    from rpaug.pipeline.python_api import augment as augment
    from rpaug.pipeline.python_api import episodes as episodes
    from rpaug.pipeline.python_api import inspect as inspect
    from rpaug.pipeline.python_api import read as read
    from rpaug.pipeline.python_api import replay as replay
    from rpaug.pipeline.python_api import verify as verify
    from rpaug.pipeline.python_api import write as write
    from rpaug.pipeline.recipe import Recipe as Recipe

__version__ = "0.1.0"

# Every public name and its module; a module that is public itself stands beside its own path.
_EXPORTS = {
    "Adapter": "rpaug.core.interfaces",
    "AdapterContract": "rpaug.pipeline.contracts",
    "Appearance": "rpaug.core.types",
    "BadInput": "rpaug.core.errors",
    "BadRecipe": "rpaug.core.errors",
    "Body": "rpaug.core.types",
    "Camera": "rpaug.core.types",
    "CameraView": "rpaug.core.types",
    "Edit": "rpaug.core.interfaces",
    "Effect": "rpaug.core.types",
    "Episode": "rpaug.core.types",
    "Gaussians": "rpaug.core.types",
    "MissingExtra": "rpaug.core.errors",
    "Operator": "rpaug.core.interfaces",
    "OperatorContract": "rpaug.pipeline.contracts",
    "Provenance": "rpaug.core.types",
    "Recipe": "rpaug.pipeline.recipe",
    "Rejected": "rpaug.core.errors",
    "Robot": "rpaug.core.types",
    "RpaugError": "rpaug.core.errors",
    "Scene": "rpaug.core.types",
    "Sensor": "rpaug.core.types",
    "Side": "rpaug.core.interfaces",
    "Surface": "rpaug.core.types",
    "TargetError": "rpaug.core.errors",
    "Unsupported": "rpaug.core.errors",
    "augment": "rpaug.pipeline.python_api",
    "episodes": "rpaug.pipeline.python_api",
    "inspect": "rpaug.pipeline.python_api",
    "read": "rpaug.pipeline.python_api",
    "replay": "rpaug.pipeline.python_api",
    "verify": "rpaug.pipeline.python_api",
    "write": "rpaug.pipeline.python_api",
}

__all__ = ["__version__", *_EXPORTS]


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module 'rpaug' has no attribute {name!r}")
    module = import_module(_EXPORTS[name])
    value = module if name == module.__name__.rpartition(".")[2] else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
