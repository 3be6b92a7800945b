"""Nearest neighbour feature matching: its terms by their definitions, and a run that goes down."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import vgg
from analytic import BOX, TABLE
from styled import stripes, with_gaussians

from rpaug.core.errors import TargetError, Unsupported
from rpaug.gaussians import nnfm
from rpaug.gaussians.gaussians import SH0
from rpaug.gaussians.windows import render, windows
from rpaug.providers import features

SHORT = nnfm.StyleSettings(steps=32, size=48, picture=48)


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> features.VGG16:
    return features.load(vgg.saved(tmp_path_factory.mktemp("vgg")))


@pytest.fixture(scope="module")
def styled(network) -> nnfm.Styled:
    return nnfm.stylise(with_gaussians(), frozenset({BOX}), stripes(), network, 0, SHORT)


def test_matching_is_the_distance_to_the_nearest():
    generator = torch.Generator().manual_seed(1)
    seen, wanted = (torch.rand(5, n, generator=generator) for n in (7, 9))
    unit = wanted / wanted.norm(dim=0)
    a, b = seen.numpy().T, wanted.numpy().T
    by_hand = np.mean(
        [
            min(1 - x @ y / np.linalg.norm(x) / np.linalg.norm(y) for y in b)
            for x in a
        ]
    )  # fmt: skip
    assert float(nnfm.matching(seen, unit)) == pytest.approx(by_hand, abs=1e-6)
    assert float(nnfm.matching(3 * wanted, unit)) == pytest.approx(0, abs=1e-6)


def test_palette_compares_distributions_not_places():
    generator = torch.Generator().manual_seed(2)
    colors = torch.rand(60, 3, generator=generator)
    directions = torch.eye(3)
    shuffled = colors[torch.randperm(60, generator=generator)]
    assert float(nnfm.palette(shuffled, colors, directions)) == 0
    assert float(nnfm.palette(colors + 0.1, colors, directions)) == pytest.approx(0.01, rel=1e-4)
    few = colors[:20]  # of other sizes, too
    assert float(nnfm.palette(few, few.repeat(3, 1), directions)) == pytest.approx(0, abs=1e-9)


def test_the_loss_falls(styled):
    match, outside = (
        np.array([getattr(loss, name) for loss in styled.losses]) for name in ("match", "outside")
    )
    assert match[-8:].mean() < 0.8 * match[:8].mean()
    assert outside[-8:].mean() < 1.2 * outside[:8].mean()
    assert np.isfinite(match).all()


def test_only_the_target_s_gaussians_have_new_colors(styled):
    scene = with_gaussians()
    assert set(scene.gaussians.ids[styled.rows].tolist()) == {BOX}
    assert len(styled.rows) == (scene.gaussians.ids == BOX).sum()
    assert styled.colors.shape == (len(styled.rows), 3)
    assert styled.colors.min() >= 0
    assert styled.colors.max() <= 1
    # Red and white: green and blue go together, as in the picture.
    green, blue = styled.colors[:, 1], styled.colors[:, 2]
    assert np.abs(green - blue).mean() < 0.1


def test_gaussians_and_places_are_of_one_color(styled):
    scene = with_gaussians()
    ids, means = scene.gaussians.ids[styled.rows], scene.gaussians.means[styled.rows]
    found, weight = styled.new.at(ids, means, np.zeros(len(means), np.float32))
    assert (weight > 0).all()
    assert np.abs(found - styled.colors).max() < 1e-5


def test_old_colors_are_those_recorded(styled):
    """On the box each place was of the color its own pattern has there."""
    window = styled.windows[0]
    found, weight = styled.old.at(window.ids, window.points, np.zeros(len(window.ids), np.float32))
    off = np.abs(found - window.recorded[window.mask])[weight > 0]
    assert np.median(off) < 0.03  # Gaussians blur a pattern whose period is ten pixels


def test_a_window_in_old_colors_is_the_recording():
    scene = with_gaussians()
    rows = np.flatnonzero(scene.gaussians.ids == BOX)
    for window in windows(scene, frozenset({BOX}), rows, 1):
        old = torch.from_numpy(0.5 + SH0 * scene.gaussians.sh[rows, 0])
        image = render(window, rows, old).numpy()
        assert np.median(np.abs(image - window.recorded)[window.mask]) < 0.03
        assert window.lit == pytest.approx(1)  # it stands still


def test_the_seed_decides(network, styled):
    def colors(seed: int) -> np.ndarray:
        settings = nnfm.StyleSettings(steps=3, size=32, picture=32)
        return nnfm.stylise(
            with_gaussians(), frozenset({BOX}), stripes(), network, seed, settings
        ).colors

    assert np.array_equal(colors(5), colors(5))
    assert not np.array_equal(colors(5), colors(6))


def test_what_cannot_be_stylised_is_refused(network):
    scene = with_gaussians()
    bare = replace(scene, gaussians=None)
    with pytest.raises(Unsupported, match="Gaussians"):
        nnfm.stylise(bare, frozenset({TABLE}), stripes(), network, 0, SHORT)
    with pytest.raises(TargetError, match="no camera"):
        nnfm.stylise(scene, frozenset({12345}), stripes(), network, 0, SHORT)
