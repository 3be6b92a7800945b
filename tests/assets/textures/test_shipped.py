"""The shipped textures: many, distinct, always the same, and without seams."""

import numpy as np
import pytest

from rpaug import RpaugError
from rpaug.assets.textures import patterns, shipped


def test_there_are_many_of_several_kinds() -> None:
    assert len(shipped.NAMES) >= 40
    assert set(shipped.KINDS) >= {"wood", "stone", "fabric", "checker", "noise", "metal"}
    assert sum(map(len, shipped.KINDS.values())) == len(shipped.NAMES)


@pytest.fixture(scope="module")
def images() -> dict[str, np.ndarray]:
    return {name: shipped.image(name) for name in shipped.NAMES}


def test_each_is_a_picture_of_its_own(images: dict[str, np.ndarray]) -> None:
    small = []
    for name, image in images.items():
        assert image.shape == (256, 256, 3), name
        assert image.dtype == np.uint8
        assert image.std() > 2, name
        small.append(image[::16, ::16].astype(float).ravel())
    apart = np.abs(np.array(small)[:, None] - np.array(small)[None]).mean(-1)
    assert apart[~np.eye(len(small), dtype=bool)].min() > 3


def test_they_repeat_without_a_seam(images: dict[str, np.ndarray]) -> None:
    for name, image in images.items():
        wide = image.astype(float)
        for axis in (0, 1):
            steps = np.abs(np.diff(np.concatenate([wide, wide.take([0], axis)], axis), axis=axis))
            lines = steps.mean(tuple(k for k in range(3) if k != axis))
            assert lines[-1] <= 1.3 * lines[:-1].max() + 2, (name, axis)


def test_a_name_always_gives_the_same_texture(images: dict[str, np.ndarray]) -> None:
    for name in ("oak", "terrazzo", "plaid_red"):
        shipped.image.cache_clear()
        assert np.array_equal(shipped.image(name), images[name])


def test_people_have_a_word_for_each() -> None:
    assert {shipped.pattern(name) for name in shipped.NAMES} >= {"checkered", "plaid", "wooden"}
    assert shipped.pattern("ash_grey") == "wooden"


def test_a_color_word_is_plain_paint() -> None:
    image = shipped.image("teal")
    assert image.shape == (256, 256, 3)
    assert (image == [0, 128, 128]).all()


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(RpaugError, match=r"oak.*checker_black"):
        shipped.image("plywood")


def test_cells_belong_to_the_nearest_of_their_spots() -> None:
    rng = np.random.default_rng(3)
    spots = rng.random((7, 2)) * patterns.SIDE
    y, x = (rng.random((12, 9)) * patterns.SIDE for _ in range(2))
    off = np.abs(np.stack([y, x], -1)[..., None, :] - spots) % patterns.SIDE
    away = np.hypot(*np.moveaxis(np.minimum(off, patterns.SIDE - off), -1, 0))
    first, second = np.moveaxis(np.sort(away, -1)[..., :2], -1, 0)
    owner, gaps = patterns._nearest(y, x, spots)
    assert np.array_equal(owner, away.argmin(-1))
    assert np.allclose(gaps, second - first, atol=1e-9)
