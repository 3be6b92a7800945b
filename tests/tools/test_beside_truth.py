"""README's picture beside the truth: the best of the edits of single images stands there, not a weak one."""

from types import SimpleNamespace

import numpy as np

from tools import beside_truth
from tools.bench.harness import edits


def rows(**psnr: float) -> list:
    """Rows of a factor with these figures, by method."""
    methods = {"ours": beside_truth.OURS, "given": "rpaug", "jitter": edits.JITTER}
    methods |= {"lab": edits.LAB, "guessed": edits.LAB_ESTIMATED, "none": edits.NONE}
    return [
        SimpleNamespace(method=methods[name], scores=SimpleNamespace(psnr=value))
        for name, value in psnr.items()
    ]


def test_the_best_edit_of_single_images_is_chosen_and_ours_is_told_nothing() -> None:
    found = beside_truth.chosen(rows(ours=30, given=50, lab=35, guessed=20, jitter=10, none=60))
    assert {name: row.scores.psnr for name, row in found.items()} == {
        "rpaug": 30,
        "best 2D edit": 35,
        "2D jitter": 10,
    }


def test_a_strip_has_the_images_of_its_columns() -> None:
    def episode(gray: int) -> SimpleNamespace:
        view = SimpleNamespace(rgb=lambda _: np.full((8, 8, 3), gray, np.uint8))
        return SimpleNamespace(views={beside_truth.CAMERA: view})

    given = rows(ours=30, lab=35, jitter=10)
    made = {row.method: episode(gray) for row, gray in zip(given, (30, 35, 10), strict=True)}
    recorded, true = (SimpleNamespace(episode=episode(gray)) for gray in (1, 2))
    trial = SimpleNamespace(recorded=recorded, true=true, made=made)
    image = beside_truth.strip(trial, given)
    middle = beside_truth.BAND + beside_truth.SIDE // 2
    wide = beside_truth.SIDE + beside_truth.GAP
    seen = [image[middle, column * wide + 5, 0] for column in range(5)]
    assert seen == [1, 2, 30, 35, 10]
    assert image.shape[1] == 5 * wide - beside_truth.GAP
