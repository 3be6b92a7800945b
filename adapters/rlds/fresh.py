"""An RLDS episode from another source: a record of everything the episode holds, and the features that describe it.

Color is PNG and depth a float image of TFDS, so that both come back exactly; numbers are float32, as all numbers in an
Example are. The action is where the gripper is in the next step: position, quaternion (x, y, z, w), opening.
"""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from rpaug_adapters.rlds.example import example
from rpaug_adapters.rlds.features import Leaf
from rpaug_adapters.rlds.pixels import packed
from rpaug_adapters.shared import fresh

from rpaug import Episode, files

CORE = "tensorflow_datasets.core.features."
DEPTH = Leaf("depth", "Image", True, (None, None, 1), "float32", "png")


def record(episode: Episode) -> bytes:
    """The episode as one Example."""
    length = episode.length
    first, last = np.zeros(length, int), np.zeros(length, int)
    first[0], last[-1] = 1, 1
    values: dict[str, Any] = {
        "steps/is_first": first,
        "steps/is_last": last,
        "steps/is_terminal": last,
        "steps/discount": np.ones(length, np.float32),
        "steps/reward": last.astype(np.float32),
        "steps/language_instruction": [episode.instruction.encode()] * length,
        "episode_metadata/descriptions": [text.encode() for text in episode.descriptions],
    }
    for name, track in fresh.tracks(episode).items():
        usual = values.get(f"steps/{name}")  # flags of steps that were recorded
        kind = usual.dtype if isinstance(usual, np.ndarray) else np.float32
        values[f"steps/{name}"] = track.astype(kind).ravel()
    for name, view in episode.views.items():
        at = f"steps/observation/{name}"
        values[at] = [files.encode_png(view.rgb(t)) for t in range(length)]
        if view.depth is not None:
            values[f"{at}_depth"] = [packed(DEPTH, view.depth(t)) for t in range(length)]
        if view.ids is not None:
            values[f"{at}_mask"] = [zlib.compress(view.ids(t).tobytes()) for t in range(length)]
    return example(values)


def features(episode: Episode) -> dict[str, Any]:
    """The tree of `features.json` for such a record."""
    observation: dict[str, Any] = {}
    steps: dict[str, Any] = {
        "is_first": _tensor("bool"),
        "is_last": _tensor("bool"),
        "is_terminal": _tensor("bool"),
        "discount": _tensor("float32"),
        "reward": _tensor("float32"),
        "language_instruction": _text(),
    }
    for name, track in fresh.tracks(episode).items():
        *above, last = name.removeprefix("observation/").split("/")
        within = observation if name.startswith("observation/") else steps
        for folder in above:
            within = within.setdefault(folder, {})
        within.setdefault(last, _tensor("float32", track.shape[1]))
    for name, view in episode.views.items():
        size = view.camera.height, view.camera.width
        observation[name] = _image("uint8", *size, 3)
        if view.depth is not None:
            observation[f"{name}_depth"] = _image("float32", *size, 1)
        if view.ids is not None:
            observation[f"{name}_mask"] = _tensor("int32", *size, encoding="zlib")
    texts = {
        "pythonClassName": f"{CORE}sequence_feature.Sequence",
        "sequence": {"feature": _text(), "length": "-1"},
    }
    steps["observation"] = _several(observation)
    sequence = {"feature": _several(steps), "length": "-1"}
    every = {"pythonClassName": f"{CORE}dataset_feature.Dataset", "sequence": sequence}
    return _several({"steps": every, "episode_metadata": _several({"descriptions": texts})})


def beside(episode: Episode) -> bytes:
    """What `cameras.yaml` says of the episode."""
    words = {"language": ["language_instruction", "episode_metadata/descriptions"]}
    return fresh.beside(episode, lambda name: name, lambda name: f"observation/{name}", words)


def _tensor(dtype: str, *shape: int, encoding: str = "none") -> dict[str, Any]:
    kind = "tensor_feature.Tensor" if shape else "scalar.Scalar"
    dimensions = {"dimensions": [str(side) for side in shape]} if shape else {}
    about = {"shape": dimensions, "dtype": dtype, "encoding": encoding}
    return {"pythonClassName": CORE + kind, "tensor": about}


def _image(dtype: str, *shape: int) -> dict[str, Any]:
    dimensions = {"dimensions": [str(side) for side in shape]}
    about = {"shape": dimensions, "dtype": dtype, "encodingFormat": "png"}
    return {"pythonClassName": f"{CORE}image_feature.Image", "image": about}


def _text() -> dict[str, Any]:
    return {"pythonClassName": f"{CORE}text_feature.Text", "text": {}}


def _several(inner: Mapping[str, Any]) -> dict[str, Any]:
    """Features by name; those without a class of their own are folders of further ones."""
    features = {
        name: one if "pythonClassName" in one else _several(one) for name, one in inner.items()
    }
    return {
        "pythonClassName": f"{CORE}features_dict.FeaturesDict",
        "featuresDict": {"features": features},
    }
