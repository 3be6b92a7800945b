"""VGG16: every file format gives the published network, and the real weights see what VGG16 sees."""

import os
from pathlib import Path

import numpy as np
import pytest
import torch
import vgg

from rpaug.assets.textures import shipped
from rpaug.core.errors import BadInput
from rpaug.providers import features


def published(widths: dict[int, int] = vgg.WIDTHS) -> torch.nn.Sequential:
    """The network as torchvision builds it."""
    modules: list[torch.nn.Module] = []
    channels = 3
    for block, count in enumerate(features.BLOCKS, 1):
        for _ in range(count):
            modules += [torch.nn.Conv2d(channels, widths[block], 3, padding=1), torch.nn.ReLU()]
            channels = widths[block]
        modules.append(torch.nn.MaxPool2d(2))
    return torch.nn.Sequential(*modules)


def test_features_are_those_of_the_published_network(tmp_path):
    path = tmp_path / "imagenet.pth"
    torch.save(vgg.state_dict(), path)
    network = features.load(path)
    assert network.origin == "imagenet.pth"
    reference = published()
    state = {k.removeprefix("features."): v for k, v in vgg.state_dict().items() if "feat" in k}
    reference.load_state_dict(state)
    picture = torch.rand(2, 3, 37, 50, generator=torch.Generator().manual_seed(0))
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x = (picture - mean[:, None, None]) / deviation[:, None, None]
    expected = {}
    for number, module in enumerate(reference):
        x = module(x)
        for layer, at in features.TORCHVISION.items():
            if number == at + 1:
                expected[layer] = x
    found = network.features(picture, features.LAYERS)
    assert list(found) == list(features.LAYERS)
    for layer, value in found.items():
        # Float32 sums over 108 products in another order, thirteen times.
        assert torch.allclose(value, expected[layer], rtol=1e-3, atol=1e-4), layer


def test_every_format_holds_the_same_network(tmp_path):
    torch.save(vgg.state_dict(), tmp_path / "one.pt")
    paths = [vgg.saved(tmp_path), tmp_path / "one.pt"]
    try:
        from safetensors.torch import save_file
    except ImportError:
        pass
    else:
        save_file(vgg.state_dict(), tmp_path / "one.safetensors")
        paths.append(tmp_path / "one.safetensors")
    loaded = [features.load(path) for path in paths]
    for network in loaded[1:]:
        for layer in features.LAYERS:
            for mine, other in zip(
                network.convolutions[layer], loaded[0].convolutions[layer], strict=True
            ):
                assert torch.equal(mine, other)
    assert [network.origin for network in loaded][:2] == ["vgg16.pth", "one.pt"]
    assert len({network.digest for network in loaded}) == 1


def test_gradients_reach_the_picture(tmp_path):
    network = features.load(vgg.saved(tmp_path))
    picture = torch.full((1, 3, 16, 16), 0.5, requires_grad=True)
    network.features(picture, ["conv5_3"])["conv5_3"].sum().backward()
    assert picture.grad is not None
    assert picture.grad.abs().sum() > 0


def test_unknown_layers_are_refused(tmp_path):
    network = features.load(vgg.saved(tmp_path))
    with pytest.raises(ValueError, match="conv3_4"):
        network.features(torch.zeros(1, 3, 16, 16), ["conv3_4"])


def test_a_missing_file_says_where_weights_come_from(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    with pytest.raises(BadInput, match=r"checkpoints.*put https://download.pytorch.org.* there"):
        features.load()
    (tmp_path / "checkpoints").mkdir()
    torch.save(vgg.state_dict(), features.default())
    assert features.load().origin == features.FILE


@pytest.mark.parametrize("ending", [".pth", ".safetensors"])
def test_damaged_files_are_named(tmp_path, ending):
    if ending == ".safetensors":
        pytest.importorskip("safetensors")
    path = tmp_path / f"broken{ending}"
    path.write_bytes(b"not weights at all" * 9)
    with pytest.raises(BadInput, match="undamaged"):
        features.load(path)


def test_code_in_a_file_is_never_run(tmp_path):
    """A pickle that is more than tensors is refused."""
    torch.save({"features.0.weight": pytest.raises}, tmp_path / "evil.pth")
    with pytest.raises(BadInput, match="undamaged"):
        features.load(tmp_path / "evil.pth")


def test_layers_that_do_not_fit_are_named(tmp_path):
    state = vgg.state_dict()
    state["features.5.weight"] = state["features.5.weight"][:, :-1]
    torch.save(state, tmp_path / "short.pth")
    with pytest.raises(BadInput, match=r"conv2_1.*expected \(n, 6, 3, 3\)"):
        features.load(tmp_path / "short.pth")
    (tmp_path / "other.txt").write_text("")
    with pytest.raises(BadInput, match=r"\.pth"):
        features.load(tmp_path / "other.txt")


@pytest.fixture(scope="module")
def real() -> features.VGG16:
    if "RPAUG_VGG" not in os.environ:
        pytest.skip("RPAUG_VGG names no weights: tools/fetch_vgg.py fetches some")
    return features.load(Path(os.environ["RPAUG_VGG"]))


def test_real_filters_are_vgg_s(real):
    """Color blobs and edges: half of the first filters are opponent in color or in space."""
    kernels = real.convolutions["conv1_1"][0].numpy()
    assert kernels.shape == (64, 3, 3, 3)
    assert real.convolutions["conv5_3"][0].shape == (512, 512, 3, 3)
    # Rows and columns are not swapped by a wrong order of axes: neighbours along each are alike.
    for axis in (2, 3):
        first, second = np.split(kernels, [2], axis)[0], np.split(kernels, [1], axis)[1]
        assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.3
    # Grey answers hardly differ between channels; blobs of one color do.
    grey = np.abs(kernels.mean(1)).mean((1, 2))
    color = kernels.std(1).mean((1, 2))
    assert (color > 1.5 * grey).sum() >= 10
    assert (grey > 1.5 * color).sum() >= 10


def test_real_features_tell_textures_apart(real):
    """Gram matrices (Gatys et al. 2016): two cuttings of one texture are nearer than two textures, or noise."""

    def gram(picture: np.ndarray) -> torch.Tensor:
        image = torch.from_numpy(picture.astype(np.float32) / 255).permute(2, 0, 1)[None]
        found = real.features(image, ["conv3_3"])["conv3_3"][0].flatten(1)
        return found @ found.T / found.shape[1]

    def distance(a: torch.Tensor, b: torch.Tensor) -> float:
        return float((a - b).norm() / (a.norm() * b.norm()).sqrt())

    names = ["oak", "granite_grey", "denim", "checker_red"]
    first = [gram(shipped.image(name)[:96, :96]) for name in names]
    second = [gram(shipped.image(name)[128:224, 128:224]) for name in names]
    noise = gram(np.random.default_rng(0).integers(0, 256, (96, 96, 3)))
    for k, one in enumerate(first):
        own = distance(one, second[k])
        assert own < 0.5 * min(distance(one, other) for j, other in enumerate(second) if j != k)
        assert own < 0.5 * distance(one, noise)
