"""What is drawn into a photograph is as sharp and as grainy as the photograph, and nothing else changes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rgb_only_tables import episode

from rpaug.operators.distractors import Distractors
from rpaug.pipeline.contracts import shown
from rpaug.scene.build import build
from rpaug.scene.instances import backdrop
from rpaug.scene.lighting import grain

SIZE, LENGTH = 96, 9


def photographs(blur: float, noise: float, jpeg: int | None = None) -> list[np.ndarray]:
    """Plates of many grey levels, blurred, with noise."""
    rng = np.random.default_rng(0)
    flat = np.kron(rng.integers(30, 220, (8, 8)), np.ones((12, 12)))[..., None] * np.ones(3)
    sharp = np.clip(flat, 0, 255).astype(np.float32)
    soft = cv2.GaussianBlur(sharp, (0, 0), blur) if blur else sharp
    images = [soft + noise * rng.normal(size=soft.shape) for _ in range(LENGTH)]
    taken = [np.clip(np.rint(one), 0, 255).astype(np.uint8) for one in images]
    if jpeg is None:
        return taken
    packed = [cv2.imencode(".jpg", one, [cv2.IMWRITE_JPEG_QUALITY, jpeg])[1] for one in taken]
    return [cv2.imdecode(one, cv2.IMREAD_COLOR) for one in packed]


def of(images: list[np.ndarray]) -> grain.Grain:
    middle = np.median(images, 0).astype(np.uint8)
    return grain.Grain(backdrop.Backdrop(middle, 1.0, True, False), grain.blur(middle))


@pytest.mark.parametrize("blur", [0.0, 0.6, 0.8, 1.2])
def test_blur_is_told_by_the_sharpest_edges(blur: float) -> None:
    assert grain.blur(photographs(blur, 0)[0]) == pytest.approx(blur, abs=0.2)


def test_what_is_put_into_a_blurred_frame_of_a_video_is_as_blurred() -> None:
    soft = photographs(1.2, 0)[0]
    before = np.full_like(soft, 40)
    drawn = before.copy()
    drawn[20:70, 30:60] = 200
    made = grain.FrameBlur().onto(soft, before, drawn, np.zeros((SIZE, SIZE), bool))
    assert grain.blur(made) == pytest.approx(1.2, abs=0.3)
    np.testing.assert_array_equal(made[:10], before[:10])
    np.testing.assert_array_equal(made[40:50, 40:50], drawn[40:50, 40:50])


def test_a_picture_without_edges_has_no_blur() -> None:
    assert grain.blur(np.full((SIZE, SIZE, 3), 90, np.uint8)) == 0


@pytest.mark.parametrize("jpeg", [None, 85])
def test_what_is_drawn_has_the_grain_of_what_was_there(jpeg: int | None) -> None:
    images = photographs(0.7, 3.0, jpeg)
    known = of(images)
    made = []
    for one in images:
        drawn = one.copy()
        drawn[20:70, 30:60] = (160, 120, 60)
        made.append(known.onto(one, one, drawn, np.zeros((SIZE, SIZE), bool)))
    ours, theirs = (
        np.diff(np.stack(clip).astype(float), axis=0)[:, 24:66, 34:56] for clip in (made, images)
    )
    assert ours.std() == pytest.approx(theirs.std(), rel=0.1)
    fine = [np.std([cv2.Laplacian(one, cv2.CV_64F) for one in part]) for part in (ours, theirs)]
    assert fine[0] == pytest.approx(fine[1], rel=0.15)
    assert np.abs(np.mean(made, 0)[24:66, 34:56] - (160, 120, 60)).mean() < 1.5
    for one, drawn in zip(images, made, strict=True):
        assert np.array_equal(one[:12], drawn[:12])
        assert np.array_equal(one[:, 72:], drawn[:, 72:])


def test_its_outline_is_as_soft_as_the_others() -> None:
    images = photographs(1.0, 0)
    drawn = np.full_like(images[0], 40)
    before = drawn.copy()
    drawn[20:70, 30:60] = 200
    made = of(images).onto(images[0], before, drawn, np.zeros((SIZE, SIZE), bool))
    assert grain.blur(made) == pytest.approx(1.0, abs=0.3)


def test_what_was_painted_gets_grain_and_no_blur() -> None:
    images = photographs(0.7, 3.0)
    known, filled = of(images), images[0].copy()
    hole = np.zeros((SIZE, SIZE), bool)
    hole[40:60, 40:60] = True
    filled[hole] = 100
    made = known.onto(images[0], filled, filled, hole)
    assert made[hole].std() == pytest.approx(3.0, rel=0.2)
    assert np.array_equal(made[~hole], filled[~hole])


def test_only_photographs_have_it() -> None:
    scene = build(episode(LENGTH), with_bodies=True)
    view = scene.episode.views["image_0"]
    assert grain.of(scene.episode, "image_0") is not None
    masked = replace(scene.episode, views={"image_0": replace(view, inferred=False)})
    assert grain.of(masked, "image_0") is None


def test_what_is_inserted_flickers_as_the_clip_does() -> None:
    scene = build(episode(12), with_bodies=True)
    operator = Distractors(count=1, size=(0.04, 0.1))
    made = shown(operator.apply(scene, operator.sample(scene, np.random.default_rng(1))))
    clips = [
        np.stack([one.views["image_0"].rgb(t) for t in range(12)]).astype(float)
        for one in (made, scene.episode)
    ]
    new = (np.abs(clips[0] - clips[1]) > 25).any(-1).all(0)
    assert new.sum() > 5
    ours, theirs = (np.diff(clip, axis=0)[:, new].std() for clip in clips)
    assert ours == pytest.approx(theirs, rel=0.3)
