"""Writing an RLDS episode: its record with only what changed encoded anew, in the encoding it had."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from rpaug_adapters.rlds.features import Leaf, leaves
from rpaug_adapters.rlds.pixels import TensorColors
from rpaug_adapters.rlds.pixels import encoded as encoded_pixels
from rpaug_adapters.rlds.read import RLDSSource, texts
from rpaug_adapters.shared import cameras
from rpaug_adapters.shared.images import reencoded

from rpaug import CameraView, Embeddings, Episode, Unsupported

SAME = (
    0.999  # cosine of a recorded vector to the same model's: float16 and other machines are nearer
)


def encoded_episode(episode: Episode, recorded: RLDSSource) -> tuple[bytes, dict[str, bytes]]:
    """The record, and the files to lay beside it: `cameras.yaml` where a camera was moved."""
    changes: dict[str, Sequence[bytes] | np.ndarray | None] = {}
    for name, view in episode.views.items():
        before = recorded.views[name]
        if view.rgb is not before.rgb:
            leaf = recorded.images[name]
            changes[leaf.key] = _colors(recorded, leaf, view, before)
        if name in recorded.depths and view.depth is not before.depth:
            leaf, metres = recorded.depths[name]
            assert view.depth
            assert before.depth
            changes[leaf.key] = _pixels(
                recorded, leaf, view.depth, before.depth, metres, episode.length
            )
        if name in recorded.ids and view.ids is not before.ids:
            assert view.ids
            assert before.ids
            leaf = recorded.ids[name]
            changes[leaf.key] = _pixels(recorded, leaf, view.ids, before.ids, 1, episode.length)
    if episode.descriptions != recorded.descriptions:
        changes |= _words(episode, recorded)
    if episode.embeddings.drop:
        changes |= dict.fromkeys(Embeddings.among(recorded.example.features))
    beside = cameras.moved(episode, recorded.views, recorded.beside, recorded.own)
    return recorded.example.replaced(changes), beside


def _colors(
    recorded: RLDSSource, leaf: Leaf, view: CameraView, before: CameraView
) -> Sequence[bytes] | np.ndarray:
    """A camera's images as the feature stores them."""
    if leaf.kind == "Image":
        return reencoded(recorded.example.blobs(leaf.key), view, before)
    assert isinstance(before.rgb, TensorColors)
    stored = [before.rgb.stored(t) for t in range(before.rgb.length)]
    return encoded_pixels(recorded.example, leaf, before.rgb.edited(view), stored)


def _words(
    episode: Episode, recorded: RLDSSource
) -> dict[str, Sequence[bytes] | np.ndarray | None]:
    """New words wherever a text of the record has the old, and the vectors made of them. Raises Unsupported."""
    example, old, new = recorded.example, recorded.descriptions, episode.descriptions
    if not recorded.languages:
        raise Unsupported(f"{episode.key}: the words changed, and no feature holds any")
    if len(old) != len(new):  # no edit of ours: all are the new instruction
        new = (episode.instruction,) * len(old)
    now = dict(zip(old, new, strict=True))
    changes: dict[str, Sequence[bytes] | np.ndarray | None] = {}
    known = leaves(recorded.folder) or {}
    for key in texts(example, known):
        blobs = example.blobs(key)
        said = [blob.decode(errors="replace").strip() for blob in blobs]
        if any(text in now and now[text] != text for text in said):
            changes[key] = [
                now[text].encode() if text in now and now[text] != text else blob
                for text, blob in zip(said, blobs, strict=True)
            ]
    if not episode.embeddings.drop:
        for key in Embeddings.among(example.features):
            changes |= _embedded(episode, recorded, key, now)
    return changes


def _embedded(
    episode: Episode, recorded: RLDSSource, key: str, now: Mapping[str, str]
) -> dict[str, np.ndarray]:
    """A feature of vectors of words, made anew by the recipe's model. Raises Unsupported without one, and where the
    recorded vectors are not that model's."""
    embed = episode.embeddings.embed
    if embed is None:
        choice = "the recipe's key `embeddings` may name its model, or drop it"
        raise Unsupported(
            f"{episode.key}: the words changed, and {key} was made of the old ones ({choice})"
        )
    stored = recorded.example.floats(key).reshape(episode.length, -1)
    texts = [*now]
    vectors = np.asarray(embed([*texts, *now.values()]), np.float32)
    before, after = vectors[: len(texts)], vectors[len(texts) :]
    length = np.linalg.norm(stored, axis=1, keepdims=True)
    if stored.shape[1] == vectors.shape[1]:
        likeness = stored / np.maximum(length, 1e-9) @ before.T
        which, blank = likeness.argmax(1), length[:, 0] == 0
        if (likeness.max(1)[~blank] >= SAME).all():
            kept = blank | np.array([now[text] == text for text in texts])[which]
            return {key: np.where(kept[:, None], stored, after[which] * length).ravel()}
    found = f"{key} ({stored.shape[1]} numbers a step) was not made of the words by this model"
    raise Unsupported(f"{episode.key}: the words changed, and {found}: name the one that made it")


def _pixels(
    recorded: RLDSSource,
    leaf: Leaf,
    after: Callable[[int], np.ndarray],
    before: Callable[[int], np.ndarray],
    unit: float,
    length: int,
) -> Sequence[bytes] | np.ndarray:
    """A feature of depth or handles, in its own unit."""
    old = [before(t) for t in range(length)]
    new = [after(t) for t in range(length)]
    frames = [
        None if np.array_equal(a, b) else (b / np.float32(unit) if unit != 1 else b)
        for a, b in zip(old, new, strict=True)
    ]
    stored = [a / np.float32(unit) if unit != 1 else a for a in old]
    return encoded_pixels(recorded.example, leaf, frames, stored)
