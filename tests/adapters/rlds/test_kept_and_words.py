"""RLDS records as labs store them: pixels that are no encoded color, several instructions, vectors made of words."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rlds_samples
import yaml
from rlds_samples import SIDE, STEPS, TEXT, image, several, tensor
from rpaug_adapters.rlds import RLDS, tfrecord
from rpaug_adapters.rlds.example import Example, example

from rpaug import BadInput, Episode, Unsupported
from rpaug.core.types import Embeddings
from rpaug.pipeline import inspect, recipe
from rpaug.pipeline.augment import Run, execute
from rpaug.pipeline.verify import verify

KEY = "toy/1.0.0/train/0"
WORDS = [b"pick the red cup", b"grasp the red mug", b"move the red cup"]
NEW = ("pick the blue cup", "grasp the blue mug", "move the blue cup")


def made(
    folder: Path, features: dict[str, Any], values: dict[str, Any], beside: dict | None = None
) -> Path:
    """A dataset of one record: `features` of the steps, and what they hold by key below `steps/`."""
    place = folder / "toy" / "1.0.0"
    place.mkdir(parents=True)
    sequence = {"feature": several(**features)}
    steps = {
        "pythonClassName": "tensorflow_datasets.core.features.dataset_feature.Dataset",
        "sequence": sequence,
    }
    (place / "features.json").write_text(json.dumps(several(steps=steps)))
    record = example({f"steps/{name}": value for name, value in values.items()})
    (place / "toy-train.tfrecord-00000-of-00001").write_bytes(tfrecord.frame(record))
    split = {"name": "train", "numBytes": str(len(record)), "shardLengths": ["1"]}
    info = {"fileFormat": "tfrecord", "name": "toy", "splits": [split], "version": "1.0.0"}
    (place / "dataset_info.json").write_text(json.dumps(info))
    if beside is not None:
        (place / "cameras.yaml").write_text(yaml.safe_dump(beside))
    return folder


def pixels(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (STEPS, *shape), np.uint8)


def dimmed(episode: Episode) -> Episode:
    """Every view at half its brightness in its second frame."""
    views = {
        name: replace(view, rgb=lambda t, view=view: view.rgb(t) // 2 if t == 1 else view.rgb(t))
        for name, view in episode.views.items()
    }
    return replace(episode, views=views)


def again(root: Path, episode: Episode, folder: Path) -> Episode:
    RLDS().write(episode, folder, KEY, dict)
    RLDS().finish(root, folder)
    return RLDS().read(folder, KEY)


@pytest.mark.parametrize("channels", [3, 4])
def test_a_tensor_of_bytes_is_a_view_and_is_written_as_stored(
    tmp_path: Path, channels: int
) -> None:
    stored = pixels(SIDE, SIDE, channels)
    root = made(
        tmp_path / "in",
        {"cam": tensor("uint8", SIDE, SIDE, channels), "words": TEXT},
        {"cam": stored.ravel(), "words": [b""] * STEPS},
    )
    episode = RLDS().read(root, KEY)
    assert np.array_equal(episode.views["cam"].rgb(2), stored[2, ..., :3])
    shown = again(root, dimmed(episode), tmp_path / "out")
    wanted = stored.copy()
    wanted[1, ..., :3] //= 2
    assert np.array_equal(shown.source.example.integers("steps/cam").reshape(stored.shape), wanted)


@pytest.mark.parametrize("most", [1.0, 255.0])
def test_a_tensor_of_floats_is_color_where_that_is_stated(tmp_path: Path, most: float) -> None:
    stored = np.random.default_rng(0).uniform(0, most, (STEPS, SIDE, SIDE, 3)).astype(np.float32)
    features = {"cam": tensor("float32", SIDE, SIDE, 3), "words": TEXT}
    values = {"cam": stored.ravel(), "words": [b""] * STEPS}
    with pytest.raises(BadInput, match="found none; expected a color image"):
        RLDS().read(made(tmp_path / "silent", features, values), KEY)
    root = made(tmp_path / "in", features, values, {"images": {"front": "cam"}})
    episode = RLDS().read(root, KEY)
    scale = 255 / most
    assert np.array_equal(episode.views["front"].rgb(0), np.rint(stored[0].astype(float) * scale))
    after = again(root, dimmed(episode), tmp_path / "out").source.example.floats("steps/cam")
    after = after.reshape(stored.shape)
    assert np.array_equal(after[[0, 2]], stored[[0, 2]])  # floats between the bytes stay
    off = after[1] * scale - episode.views["front"].rgb(1) // 2
    assert np.abs(off).max() <= 0.5


def test_floats_beyond_colors_are_refused(tmp_path: Path) -> None:
    normals = np.random.default_rng(0).uniform(-1, 1, STEPS * SIDE * SIDE * 3).astype(np.float32)
    features = {"cam": tensor("float32", SIDE, SIDE, 3), "words": TEXT}
    values = {"cam": normals, "words": [b""] * STEPS}
    root = made(tmp_path, features, values, {"images": {"front": "cam"}})
    with pytest.raises(BadInput, match="expected 0 to 1, or to 255"):
        RLDS().read(root, KEY)


def test_gray_images_stay_gray(tmp_path: Path) -> None:
    small = np.random.default_rng(0).integers(0, 255, (STEPS, 4, 4), np.uint8)
    stored = [cv2.resize(one, (SIDE, SIDE)) for one in small]
    encoded = {
        name: [cv2.imencode(ending, one)[1].tobytes() for one in stored]
        for name, ending in (("photo", ".jpg"), ("plate", ".png"))
    }
    root = made(
        tmp_path / "in",
        {
            "photo": image("uint8", "jpeg", SIDE, SIDE, 1),
            "plate": image("uint8", "png", SIDE, SIDE, 1),
            "flat": tensor("uint8", SIDE, SIDE, 1),
        },
        {**encoded, "flat": np.stack(stored).ravel()},
        {"images": {"plate": "plate", "flat": "flat"}},
    )
    episode = RLDS().read(root, KEY)
    assert list(episode.views) == ["flat", "photo", "plate"]
    shown = again(root, dimmed(episode), tmp_path / "out")
    for name in ("photo", "plate"):
        blobs = shown.source.example.blobs(f"steps/{name}")
        assert [blobs[0], blobs[2]] == [encoded[name][0], encoded[name][2]]
        assert cv2.imdecode(np.frombuffer(blobs[1], np.uint8), cv2.IMREAD_UNCHANGED).ndim == 2
        off = shown.views[name].rgb(1).astype(int) - episode.views[name].rgb(1) // 2
        assert np.abs(off).max() <= (3 if name == "photo" else 0)
    assert np.array_equal(shown.views["flat"].rgb(1), episode.views["flat"].rgb(1) // 2)


def half_read(folder: Path) -> Path:
    """One camera that is read, and two features that may be cameras too."""
    photo = [cv2.imencode(".png", one)[1].tobytes() for one in pixels(SIDE, SIDE, 3)]
    plate = [cv2.imencode(".png", one)[1].tobytes() for one in pixels(SIDE, SIDE)]
    return made(
        folder,
        {
            "cam": image("uint8", "png", SIDE, SIDE, 3),
            "plate": image("uint8", "png", SIDE, SIDE, 1),
            "normals": tensor("float32", SIDE, SIDE, 3),
            "matrix": tensor("float32", 4, 4),
        },
        {
            "cam": photo,
            "plate": plate,
            "normals": np.zeros(STEPS * SIDE * SIDE * 3, np.float32),
            "matrix": np.zeros(STEPS * 16, np.float32),
        },
    )


def test_what_other_layouts_have_no_place_for_is_named(tmp_path: Path) -> None:
    root = rlds_samples.dataset(tmp_path)
    episode = RLDS().read(root, KEY)
    assert RLDS().unshared(episode) == ["episode_metadata/file_path", "unknown"]


def test_what_may_be_an_image_is_named_where_it_stays_as_it_was(tmp_path: Path) -> None:
    root = half_read(tmp_path / "in")
    episode = RLDS().read(root, KEY)
    assert [words.split()[0] for words in episode.unread] == ["plate", "normals"]
    assert "images: {NAME: plate}" in episode.unread[0]
    assert inspect.inspect(episode)[0]["unread"] == list(episode.unread)
    given = {"version": 1, "edits": [{"op": "light_color"}]}
    done = execute(Run(root, recipe.build(given), tmp_path / "out"))
    assert [words for words in done.warnings[KEY] if words in episode.unread] == [*episode.unread]


@pytest.mark.parametrize("name", ["steps/plate", "steps/matrix"])
def test_tampering_beside_the_views_is_found(tmp_path: Path, name: str) -> None:
    root = half_read(tmp_path / "in")
    given = {"version": 1, "edits": [{"op": "light_color"}]}
    execute(Run(root, recipe.build(given), tmp_path / "out"))
    assert verify(tmp_path / "out", root).passed
    path = tmp_path / "out/toy/1.0.0/toy-train.tfrecord-00000-of-00001"
    whole = Example("", tfrecord.read(path, 0))
    kind = whole.features[name].kind
    other: Any = [b"x"] * STEPS if kind == "bytes" else whole.floats(name) + 1
    path.write_bytes(tfrecord.frame(whole.replaced({name: other})))
    found = [one for one in verify(tmp_path / "out", root).findings if one.level == "bad"]
    assert [one.message for one in found if one.topic == "untouched data"] == [
        f"{name}: changed, and no edit reaches it"
    ]


def spoken(folder: Path, vectors: np.ndarray) -> Path:
    """DROID's three instructions, the first also under another name, and a vector of the first."""
    photo = [cv2.imencode(".png", one)[1].tobytes() for one in pixels(SIDE, SIDE, 3)]
    names = ("language_instruction", "language_instruction_2", "language_instruction_3")
    return made(
        folder,
        {
            "cam": image("uint8", "png", SIDE, SIDE, 3),
            **dict.fromkeys((*names, "goal"), TEXT),
            "language_embedding": tensor("float32", 4),
        },
        {
            "cam": photo,
            **{name: [words] * STEPS for name, words in zip(names, WORDS, strict=True)},
            "goal": [WORDS[0], b"idle", b""],
            "language_embedding": np.tile(vectors, STEPS),
        },
    )


def embed(texts: Sequence[str]) -> np.ndarray:
    """A unit vector of each text, by its letters."""
    raw = np.array([[text.count(letter) + 1.0 for letter in "adpu"] for text in texts])
    return (raw / np.linalg.norm(raw, axis=1, keepdims=True)).astype(np.float32)


def test_every_instruction_follows_and_vectors_with_them(tmp_path: Path) -> None:
    old = embed([WORDS[0].decode()])[0] * 3
    root = spoken(tmp_path / "in", old)
    episode = RLDS().read(root, KEY)
    assert episode.descriptions == tuple(text.decode() for text in WORDS)
    edited = replace(episode, descriptions=NEW)
    with pytest.raises(Unsupported, match=r"language_embedding .* `embeddings`"):
        RLDS().write(edited, tmp_path / "refused", KEY, dict)
    edited = replace(edited, embeddings=Embeddings(embed))
    shown = again(root, edited, tmp_path / "out")
    assert shown.descriptions == NEW
    stored = shown.source.example
    assert stored.blobs("steps/goal") == [NEW[0].encode(), b"idle", b""]
    vectors = stored.floats("steps/language_embedding").reshape(STEPS, -1)
    assert np.allclose(vectors, embed(NEW[:1]) * 3)


def test_vectors_of_another_model_are_not_mixed(tmp_path: Path) -> None:
    root = spoken(tmp_path / "in", np.array([1, -1, 0, 0], np.float32))
    episode = replace(RLDS().read(root, KEY), descriptions=NEW, embeddings=Embeddings(embed))
    with pytest.raises(Unsupported, match="not made of the words by this model"):
        RLDS().write(episode, tmp_path / "out", KEY, dict)


def test_vectors_are_dropped_by_choice_from_every_episode(tmp_path: Path) -> None:
    root = spoken(tmp_path / "in", np.ones(4, np.float32))
    edits = [{"op": "light_color"}]
    given = {"version": 1, "keep_originals": True, "embeddings": "drop", "edits": edits}
    done = execute(Run(root, recipe.build(given), tmp_path / "out"))
    assert (done.copies, done.failures) == (2, {})
    assert "embedding" not in (tmp_path / "out/toy/1.0.0/features.json").read_text()
    for number in range(2):
        held = RLDS().read(tmp_path / "out", f"toy/1.0.0/train/{number}").source.example
        assert not [name for name in held.features if "embedding" in name]
    assert verify(tmp_path / "out", root).passed
