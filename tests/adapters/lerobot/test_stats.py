"""Statistics of LeRobot datasets: as LeRobot itself counts them, of parts and of the whole."""

import numpy as np
import pytest
from rpaug_adapters.lerobot import stats


@pytest.mark.parametrize("spoilt", [None, {"min": [0]}, {"mean": "x"}, 7])
def test_statistics_that_are_no_statistics_are_counted_anew(spoilt: object) -> None:
    whole = stats.plain({"a": stats.of_numbers(np.arange(3.0))})["a"]
    assert stats.recorded(whole, (1,)) == whole
    given = whole | spoilt if isinstance(spoilt, dict) and "mean" in spoilt else spoilt
    assert stats.recorded(given, (1,)) is None
    assert stats.recorded(whole, (2,)) is None


def test_statistics_of_parts_are_those_of_the_whole() -> None:
    values = np.random.default_rng(0).normal(size=(30, 4))
    parts = [{"a": stats.of_numbers(values[s])} for s in (slice(7), slice(7, 30))]
    both, whole = stats.together(parts)["a"], stats.of_numbers(values)
    for name in ("min", "max", "mean", "std", "count"):
        assert np.allclose(both[name], whole[name])
    assert np.array_equal(both["q01"], np.minimum(*(part["a"]["q01"] for part in parts)))
    assert np.array_equal(both["q99"], np.maximum(*(part["a"]["q99"] for part in parts)))


def test_quantiles_are_those_of_lerobots_histogram() -> None:
    """What huggingface/lerobot at 7427f31 counts of these numbers (`compute_stats.get_feature_stats`)."""
    found = stats.of_numbers(np.array([[0.0], [1.0], [2.0], [10.0]]))
    assert found["q50"] == pytest.approx([1.002], abs=1e-9)  # NumPy's would be 1.5
    assert found["q10"] == pytest.approx([0.0], abs=1e-9)
    assert found["q99"] == pytest.approx([9.99992], abs=1e-9)
    one = stats.of_numbers(np.array([[3.0]]))
    assert one["q01"] == one["q99"] == [3.0]


@pytest.mark.parametrize(("length", "count"), [(3, 3), (100, 100), (500, 105), (3000, 405)])
def test_as_many_frames_are_looked_at_as_lerobot_looks_at(length: int, count: int) -> None:
    seen: list[int] = []

    def image(t: int) -> np.ndarray:
        seen.append(t)
        return np.full((4, 6, 3), t % 256, np.uint8)

    found = stats.of_images(image, length)
    assert (len(seen), seen[0], seen[-1]) == (count, 0, length - 1)
    assert found["count"] == [count]
