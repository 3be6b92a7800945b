"""rpaug multiplies robot demonstrations: recorded episodes in, edited and consistent episodes out.

What is listed here, and `rpaug.training`, is for others to build on; everything else may change at any time. A name is
imported when it is first used: `import rpaug` alone costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rpaug.core.version import __version__

if TYPE_CHECKING:
    from rpaug.core import files as files
    from rpaug.core import geometry as geometry
    from rpaug.core import safe_yaml as safe_yaml
    from rpaug.core import splits as splits
    from rpaug.core.ahead import in_order as in_order
    from rpaug.core.errors import BadInput as BadInput
    from rpaug.core.errors import BadRecipe as BadRecipe
    from rpaug.core.errors import Missing as Missing
    from rpaug.core.errors import MissingExtra as MissingExtra
    from rpaug.core.errors import Rejected as Rejected
    from rpaug.core.errors import RpaugError as RpaugError
    from rpaug.core.errors import TargetError as TargetError
    from rpaug.core.errors import Unsupported as Unsupported
    from rpaug.core.interfaces import Adapter as Adapter
    from rpaug.core.interfaces import Added as Added
    from rpaug.core.interfaces import Change as Change
    from rpaug.core.interfaces import Edit as Edit
    from rpaug.core.interfaces import ImageKind as ImageKind
    from rpaug.core.interfaces import Needs as Needs
    from rpaug.core.interfaces import Operator as Operator
    from rpaug.core.interfaces import Painted as Painted
    from rpaug.core.interfaces import Side as Side
    from rpaug.core.jit import kernel as kernel
    from rpaug.core.types import Appearance as Appearance
    from rpaug.core.types import Body as Body
    from rpaug.core.types import Camera as Camera
    from rpaug.core.types import CameraView as CameraView
    from rpaug.core.types import Effect as Effect
    from rpaug.core.types import Embeddings as Embeddings
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
    from rpaug.scene.targets.targets import Target as Target
    from rpaug.scene.targets.targets import find as find_target  # noqa: F401


# Every public name, its module, and its name there where that is another.
_EXPORTS = {
    "Adapter": "rpaug.core.interfaces",
    "AdapterContract": "rpaug.pipeline.contracts",
    "Added": "rpaug.core.interfaces",
    "Appearance": "rpaug.core.types",
    "BadInput": "rpaug.core.errors",
    "BadRecipe": "rpaug.core.errors",
    "Body": "rpaug.core.types",
    "Camera": "rpaug.core.types",
    "CameraView": "rpaug.core.types",
    "Change": "rpaug.core.interfaces",
    "Edit": "rpaug.core.interfaces",
    "Effect": "rpaug.core.types",
    "Embeddings": "rpaug.core.types",
    "Episode": "rpaug.core.types",
    "Gaussians": "rpaug.core.types",
    "ImageKind": "rpaug.core.interfaces",
    "Missing": "rpaug.core.errors",
    "MissingExtra": "rpaug.core.errors",
    "Needs": "rpaug.core.interfaces",
    "Operator": "rpaug.core.interfaces",
    "OperatorContract": "rpaug.pipeline.contracts",
    "Painted": "rpaug.core.interfaces",
    "Provenance": "rpaug.core.types",
    "Recipe": "rpaug.pipeline.recipe",
    "Rejected": "rpaug.core.errors",
    "Robot": "rpaug.core.types",
    "RpaugError": "rpaug.core.errors",
    "Scene": "rpaug.core.types",
    "Sensor": "rpaug.core.types",
    "Side": "rpaug.core.interfaces",
    "Surface": "rpaug.core.types",
    "Target": "rpaug.scene.targets.targets",
    "TargetError": "rpaug.core.errors",
    "Unsupported": "rpaug.core.errors",
    "augment": "rpaug.pipeline.python_api",
    "episodes": "rpaug.pipeline.python_api",
    "files": "rpaug.core.files",
    "find_target": "rpaug.scene.targets.targets:find",
    "geometry": "rpaug.core.geometry",
    "in_order": "rpaug.core.ahead",
    "inspect": "rpaug.pipeline.python_api",
    "kernel": "rpaug.core.jit",
    "read": "rpaug.pipeline.python_api",
    "replay": "rpaug.pipeline.python_api",
    "safe_yaml": "rpaug.core.safe_yaml",
    "splits": "rpaug.core.splits",
    "verify": "rpaug.pipeline.python_api",
    "write": "rpaug.pipeline.python_api",
}

__all__ = ["__version__", *_EXPORTS]


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        raise AttributeError(f"module 'rpaug' has no attribute {name!r}")
    place, _, own = _EXPORTS[name].partition(":")
    module = import_module(place)
    value = module if place.endswith(f".{name}") else getattr(module, own or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
