"""What makes an episode's scene ready for drawing, kept in a file: found once, then read in a moment.

A `.npz` archive, without pickles, named by a hash of the recorded content and of what was asked for: how bodies move,
which roles they play, and, where cameras are moved, the recordings that stand for what a camera cannot see at one time.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpaug.core.errors import BadInput
from rpaug.core.files import read_bytes, write_atomic
from rpaug.core.types import Belief, Body, Scene
from rpaug.render import zbuffer
from rpaug.render.holes import Edges
from rpaug.render.zbuffer import Source
from rpaug.scene.recorded.parts import PartRecording
from rpaug.scene.recorded.plates import Plate
from rpaug.scene.recorded.surfels import Surfels

VERSION = 3
ENDING = ".npz"
IMAGES = ("rgb", "depth", "ids", "use")
Arrays = dict[str, np.ndarray]


def save(path: Path, scene: Scene, surfels: Surfels | None) -> None:
    """Write what was found of a scene, whole or not at all."""
    arrays: Arrays = {}
    facts: dict[str, Any] = {
        "version": VERSION,
        "bodies": [_body(body, arrays) for body in scene.bodies],
        "roles": {name: sorted(instance_ids) for name, instance_ids in scene.roles.items()},
        "beliefs": {
            name: [sorted(belief.instance_ids), belief.confidence, list(belief.reasons)]
            for name, belief in scene.beliefs.items()
        },
        "surfels": _surfels(surfels, arrays) if surfels else None,
    }
    stream = io.BytesIO()
    np.savez_compressed(stream, facts=np.array(json.dumps(facts)), **arrays)  # type: ignore[arg-type]
    write_atomic(path, stream.getvalue())


def load(path: Path, bare: Scene) -> tuple[Scene, Surfels | None] | None:
    """The recorded scene with what is kept of it, None if nothing is. Raises BadInput for a damaged file.

    `bare` is the scene before its bodies were looked for.
    """
    if not path.is_file():
        return None
    data = read_bytes(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        facts = json.loads(str(arrays["facts"]))
        if facts["version"] != VERSION:
            raise BadInput(path, "version", found=str(facts["version"])[:40], expected=f"{VERSION}")
        kept = _surfels_of(facts["surfels"], arrays) if facts["surfels"] else None
        bodies = tuple(
            Body(frozenset(one.pop("handles")), arrays[one.pop("to_world")], **one)
            for one in facts["bodies"]
        )
    except (ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise BadInput(
            path, "scene", found=f"{error}"[:120], expected="a file of prepared scenes; delete it"
        ) from None
    roles = {name: frozenset(instance_ids) for name, instance_ids in facts["roles"].items()}
    beliefs = {
        name: Belief(frozenset(instance_ids), confidence, tuple(reasons))
        for name, (instance_ids, confidence, reasons) in facts["beliefs"].items()
    }
    return replace(bare, bodies=bodies, roles=roles, beliefs=beliefs), kept


def size(surfels: Surfels | None) -> int:
    """Bytes that surfels hold in memory."""
    if surfels is None:
        return 0
    return sum(
        array.nbytes
        for source in _sources(surfels)
        for array in (*vars(source).values(), *vars(source.lifted or source).values())
        if isinstance(array, np.ndarray)
    )


def _body(body: Body, arrays: Arrays) -> dict[str, Any]:
    return {
        "handles": sorted(map(int, body.instance_ids)),
        "to_world": _put(arrays, body.to_world),
        "motion": body.motion,
        "reference": int(body.reference),
        "residual": float(body.residual),
        "ambiguous": bool(body.ambiguous),
    }


def _surfels(surfels: Surfels, arrays: Arrays) -> dict[str, Any]:
    put = lambda source: _source(source, arrays)  # noqa: E731
    return {
        "static": sorted(map(int, surfels.static)),
        "noise": surfels.noise,
        "plates": {name: put(plate.source) for name, plate in surfels.plates.items()},
        "history": {name: [*map(put, past)] for name, past in surfels.history.items()},
        "parts": [
            {
                "handles": sorted(map(int, part.instance_ids)),
                "to_world": _put(arrays, part.to_world),
                "source": put(part.source),
            }
            for part in surfels.parts
        ],
        "edges": {name: _put(arrays, array) for name, array in vars(surfels.edges).items()},
    }


def _surfels_of(facts: Mapping[str, Any], arrays: Arrays) -> Surfels:
    empty = Surfels(frozenset(facts["static"]), {}, {}, (), facts["noise"])
    take: Callable[[dict[str, Any]], Source] = lambda one: zbuffer.lift(  # noqa: E731
        _source_of(one, arrays), empty.tolerance
    )
    parts = tuple(
        PartRecording(frozenset(one["handles"]), take(one["source"]), arrays[one["to_world"]])
        for one in facts["parts"]
    )
    return replace(
        empty,
        plates={name: _plate(take(one)) for name, one in facts["plates"].items()},
        history={name: tuple(map(take, past)) for name, past in facts["history"].items()},
        parts=parts,
        edges=Edges(**{name: arrays[held] for name, held in facts["edges"].items()}),
    )


def _plate(source: Source) -> Plate:
    assert source.use is not None  # a plate is drawn where anything was seen
    return Plate(source.rgb, source.depth, source.ids, source.use, source)


def _source(source: Source, arrays: Arrays) -> dict[str, Any]:
    facts: dict[str, Any] = {
        name: None if (image := getattr(source, name)) is None else _put(arrays, image)
        for name in (*IMAGES, "K", "cam_to_world")
    }
    return facts | {"distant": source.distant, "carved": source.carved}


def _source_of(facts: Mapping[str, Any], arrays: Arrays) -> Source:
    images = {
        name: None if facts[name] is None else arrays[facts[name]]
        for name in (*IMAGES, "K", "cam_to_world")
    }
    return Source(**images, distant=facts["distant"], carved=facts["carved"])  # type: ignore[arg-type]


def _sources(surfels: Surfels) -> list[Source]:
    plates = [plate.source for plate in surfels.plates.values()]
    past = [source for kept in surfels.history.values() for source in kept]
    return [*plates, *past, *(part.source for part in surfels.parts)]


def _put(arrays: Arrays, array: np.ndarray) -> str:
    """Keep an array once, whoever refers to it; its name is its content's."""
    held = np.ascontiguousarray(array)
    stated = f"{held.dtype.str}{held.shape}".encode()
    name = hashlib.sha256(stated + held.tobytes()).hexdigest()[:24]
    arrays[name] = held
    return name
