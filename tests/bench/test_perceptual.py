"""Networks as judges: LPIPS by its formula, CLIP by its own class, and figures that say how alike pictures are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import vgg
from torch.nn import functional

from rpaug import twin
from rpaug.core.errors import BadInput, Unsupported
from rpaug.pipeline.pareto import as_csv
from rpaug.providers import features
from rpaug.providers.clip import Clip
from tools.bench.harness import edits, perceptual, scores


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (48, 40, 3), dtype=np.uint8)


def heads(prefix: str = "lin{}.model.1.weight") -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(4)
    return {
        prefix.format(k): torch.rand(1, vgg.WIDTHS[k + 1], 1, 1, generator=generator)
        for k in range(5)
    }


def whole() -> dict[str, torch.Tensor]:
    """LPIPS' own state dict: trunk in slices, heads, and its scaling layer."""
    state = {}
    for name, value in vgg.state_dict().items():
        if name.startswith("features."):
            number = int(name.split(".")[1])
            part = 1 + sum(number > last for last in (3, 8, 15, 22))
            state[f"net.slice{part}.{name.removeprefix('features.')}"] = value
    return {**state, **heads(), "scaling_layer.shift": torch.zeros(1, 3, 1, 1)}


def lpips(a: np.ndarray, b: np.ndarray) -> float:
    """As published: inputs in -1..1, shifted and scaled; unit features; weighted squares; means over the cells."""
    shift = torch.tensor([-0.030, -0.088, -0.188])[:, None, None]
    scale = torch.tensor([0.458, 0.448, 0.450])[:, None, None]
    state, total = vgg.state_dict(), 0.0
    xs = [
        (torch.from_numpy(x).float().permute(2, 0, 1) / 127.5 - 1 - shift) / scale for x in (a, b)
    ]
    x = torch.stack(xs)
    weights_of = heads()
    for layer, number in features.TORCHVISION.items():
        if layer.endswith("_1") and layer != "conv1_1":
            x = functional.max_pool2d(x, 2)
        kernel, bias = state[f"features.{number}.weight"], state[f"features.{number}.bias"]
        x = functional.relu(functional.conv2d(x, kernel, bias, padding=1))
        if layer in perceptual.LAYERS:
            unit = x / (x.pow(2).sum(1, keepdim=True).sqrt() + 1e-10)
            weight = weights_of[f"lin{perceptual.LAYERS.index(layer)}.model.1.weight"]
            total += float(functional.conv2d((unit[:1] - unit[1:]) ** 2, weight).mean())
    return total


def test_lpips_is_as_published(tmp_path: Path, picture: np.ndarray) -> None:
    other = np.roll(picture, 3, axis=1)
    torch.save(whole(), tmp_path / "lpips.pth")
    judge = perceptual.Eyes(lpips=str(tmp_path / "lpips.pth"), vgg=str(vgg.saved(tmp_path))).open()
    # The shift is published with three digits, ImageNet's mean with more: they differ by 5e-4.
    assert judge._lpips(picture, other) == pytest.approx(lpips(picture, other), rel=2e-3)
    assert judge._lpips(picture, picture) == 0


def test_heads_alone_need_imagenet_s_trunk(tmp_path: Path, picture: np.ndarray) -> None:
    torch.save(heads("lin{}.weight"), tmp_path / "heads.pth")
    torch.save(vgg.state_dict(), tmp_path / "imagenet.pth")
    torch.save(whole(), tmp_path / "lpips.pth")
    both = {"lpips": str(tmp_path / "heads.pth"), "vgg": str(tmp_path / "imagenet.pth")}
    one, other = perceptual.Eyes(**both).open(), perceptual.Eyes(lpips=str(tmp_path / "lpips.pth"))
    shifted = np.roll(picture, 3, axis=1)
    assert one._lpips(picture, shifted) == other.open()._lpips(picture, shifted)
    with pytest.raises(BadInput, match="ImageNet"):
        perceptual.Eyes(lpips=both["lpips"]).open()


def test_a_file_that_is_not_lpips_is_refused(tmp_path: Path) -> None:
    torch.save(vgg.state_dict(), tmp_path / "x.pth")
    with pytest.raises(BadInput, match="lin0"):
        perceptual.Eyes(lpips=str(tmp_path / "x.pth")).open()
    torch.save({**whole(), "lin1.model.1.weight": torch.ones(1, 3, 1, 1)}, tmp_path / "y.pth")
    with pytest.raises(BadInput, match="3 channels"):
        perceptual.Eyes(lpips=str(tmp_path / "y.pth")).open()


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CLIP of the real class, small and untrained."""
    transformers = pytest.importorskip("transformers")
    common = {"hidden_size": 16, "intermediate_size": 16, "num_attention_heads": 2}
    text = {**common, "num_hidden_layers": 1, "vocab_size": 9, "max_position_embeddings": 8}
    text |= {"bos_token_id": 1, "eos_token_id": 2, "pad_token_id": 0}
    vision = {**common, "num_hidden_layers": 2, "image_size": 32, "patch_size": 8}
    config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=8)
    folder = tmp_path_factory.mktemp("clip")
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(folder)
    return folder


def test_clip_sees_what_its_own_class_sees(clip: Path, picture: np.ndarray) -> None:
    square = picture[:32, :32]  # of the model's size: nothing is scaled or cut
    model = Clip.load(clip)
    pixels = (square / 255 - [0.48145466, 0.4578275, 0.40821073]) / [
        0.26862954,
        0.26130258,
        0.27577711,
    ]
    given = torch.from_numpy(pixels.astype(np.float32)).permute(2, 0, 1)[None]
    with torch.no_grad():
        wanted = model.model.get_image_features(pixel_values=given)
    wanted = getattr(wanted, "pooler_output", wanted)[0].numpy()
    assert np.allclose(model.embed(square), wanted / np.linalg.norm(wanted), atol=1e-5)
    assert model.embed(picture) @ model.embed(picture) == pytest.approx(1)
    assert model.embed(picture) @ model.embed(255 - picture) < 0.9999


def test_a_folder_without_clip_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Unsupported, match=r"config\.json"):
        Clip.load(tmp_path)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(Unsupported, match="CLIP"):
        Clip.load(tmp_path)


def test_without_weights_nothing_is_judged() -> None:
    assert perceptual.Eyes().open().names == ()


@pytest.mark.gl
def test_the_truth_is_nearer_than_no_edit(tmp_path: Path, clip: Path) -> None:
    record = {"frames": 17, "size": 48}
    recorded = twin.perform("stack_cups", 1, **record)
    true = twin.perform("stack_cups", 1, factor="object_color", **record)
    torch.save(whole(), tmp_path / "lpips.pth")
    eyes = perceptual.Eyes(
        vgg=str(vgg.saved(tmp_path)), lpips=str(tmp_path / "lpips.pth"), clip=str(clip)
    )
    judge = eyes.open()
    assert judge.names == ("vgg", "lpips", "clip")
    best = judge.measure(recorded, true.episode, true, False)
    worse = judge.measure(recorded, recorded.episode, true, False)
    assert (best["vgg"], best["lpips"]) == (0, 0)
    assert best["clip"] == pytest.approx(1)
    assert worse["vgg"] > 1e-3
    assert worse["lpips"] > 1e-4
    assert worse["clip"] < 1
    seen = scores.measure(recorded, true.episode, true, {}, False, 1.0)
    row = edits.EditRow("object_color", edits.NONE, 1, "stack_cups", "cup", seen, best)
    lower = replace(row, perceived=worse, seed=2)
    (found,) = edits.summary([row, lower])
    assert found["vgg_worst"] == worse["vgg"]
    assert found["clip_worst"] == worse["clip"]
    head, *lines = as_csv([row.flat(), lower.flat()]).decode().splitlines()
    assert head.endswith("seconds,vgg,lpips,clip")
    assert len(lines) == 2
