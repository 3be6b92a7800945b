"""Edges told by a slow judge that reads as the rule does, and by drawn outlines."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rpaug.scene import antialias


def judged_slowly(image: np.ndarray, label: np.ndarray) -> tuple[int, int]:
    """Runs of six pixels, three of a thing and three of the next, each side's outer two flat."""
    c = [image[:, i : image.shape[1] - 5 + i].astype(np.float32) / 255 for i in range(6)]
    k = [label[:, i : label.shape[1] - 5 + i] for i in range(6)]
    step = c[4] - c[1]
    size = (step**2).sum(-1)
    edge = (k[0] == k[1]) & (k[1] == k[2]) & (k[2] != k[3]) & (k[3] == k[4]) & (k[4] == k[5])
    flat = (((c[1] - c[0]) ** 2).sum(-1) < antialias.FLAT) & (
        ((c[5] - c[4]) ** 2).sum(-1) < antialias.FLAT
    )
    good = edge & flat & (size > antialias.STRONG)
    inner, outer = (((c[i] - c[1]) * step).sum(-1)[good] / size[good] for i in (2, 3))
    between = ((inner > 0.15) & (inner < 0.85)) | ((outer > 0.15) & (outer < 0.85))
    return int(between.sum()), int(good.sum())


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), width=st.integers(1, 40))
def test_edges_are_judged_as_the_rule_reads(seed: int, width: int) -> None:
    rng = np.random.default_rng(seed)
    label = np.repeat(rng.integers(1, 4, (3, width)), 3, axis=1).astype(np.int32)
    tones = rng.integers(0, 256, (4, 3))
    image = np.clip(tones[label] + rng.integers(-4, 5, (*label.shape, 3)), 0, 255)
    outline = np.pad(label[:, 1:] != label[:, :-1], ((0, 0), (1, 0)))
    image[outline] = (image[outline] + tones[rng.integers(0, 4, outline.sum())]) // 2
    image = image.astype(np.uint8)
    expected = judged_slowly(image, label) if label.shape[1] > 5 else (0, 0)
    assert antialias._judge(image, label) == expected
    turned = np.ascontiguousarray(image.swapaxes(0, 1)).swapaxes(0, 1)  # columns are judged too
    assert antialias._judge(turned, label) == expected
