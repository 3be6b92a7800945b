"""Holes are painted by name, every other pixel stays, and a network comes from a file."""

import numpy as np
import pytest
import torch

from rpaug.core.errors import BadInput, RpaugError
from rpaug.providers import inpaint

ROWS, COLUMNS = np.mgrid[:40, :52]
IMAGE = np.stack([90 + 2 * ROWS, 60 + 3 * COLUMNS, 100 + ROWS + COLUMNS], -1).astype(np.uint8)
HOLE = (ROWS > 14) & (ROWS < 26) & (COLUMNS > 20) & (COLUMNS < 30)


@pytest.mark.parametrize("method", inpaint.METHODS)
def test_a_gradient_is_continued_and_the_rest_stays(method):
    damaged = np.where(HOLE[..., None], 0, IMAGE).astype(np.uint8)
    painted = inpaint.paint(method, damaged, HOLE)
    np.testing.assert_array_equal(painted[~HOLE], IMAGE[~HOLE])
    assert np.abs(painted[HOLE].astype(int) - IMAGE[HOLE]).mean() < 40


def test_a_smooth_hole_has_no_edges_inside():
    """Where two colors meet at its border others draw the line on, with wedges."""
    halves = np.where(COLUMNS < 25, 60, 180).astype(np.uint8)[..., None].repeat(3, -1)
    steps = {
        method: np.abs(np.diff(inpaint.paint(method, halves, HOLE)[..., 0].astype(int), axis=1))[
            HOLE[:, 1:]
        ].max()
        for method in ("smooth", "telea")
    }
    assert steps["smooth"] < 30 < steps["telea"]


def test_unknown_ways_and_files_are_named():
    with pytest.raises(RpaugError, match=r"'magic'.*fsr, shiftmap, smooth, telea, lama:FILE"):
        inpaint.check("magic")
    with pytest.raises(BadInput, match="TorchScript"):
        inpaint.check("lama:/nowhere.pt")


def test_a_network_from_a_file_paints(tmp_path):
    class Grey(torch.nn.Module):
        def forward(self, image: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
            assert image.shape[2] % 8 == 0
            return image * (1 - mask) + 0.5 * mask

    path = tmp_path / "lama.pt"
    torch.jit.script(Grey()).save(str(path))
    painted = inpaint.paint(f"lama:{path}", IMAGE, HOLE)
    assert (painted[HOLE] == 128).all()
    np.testing.assert_array_equal(painted[~HOLE], IMAGE[~HOLE])


def test_a_file_that_is_no_network_is_refused(tmp_path):
    path = tmp_path / "lama.pt"
    path.write_bytes(b"not a network")
    with pytest.raises(BadInput, match="a TorchScript LaMa"):
        inpaint.paint(f"lama:{path}", IMAGE, HOLE)
