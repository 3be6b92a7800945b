"""Segmenters: GrabCut on known shapes, and the real SAM classes with tiny random weights from disk."""

from pathlib import Path

import numpy as np
import pytest

from rpaug.core.errors import Unsupported
from rpaug.providers.segment import Box, GrabCut, Sam, Sam2, segmenter, whole_pixels


def disc(radius: float = 6.0, size: int = 64) -> tuple[np.ndarray, np.ndarray, Box]:
    """A dark disc on a light, uneven ground, its mask and a box around it."""
    rows, columns = np.mgrid[:size, :size]
    inside = (rows - 30.2) ** 2 + (columns - 34.6) ** 2 < radius**2
    ground = 200 + 20 * np.sin(columns / 5) + np.random.default_rng(0).normal(0, 4, (size, size))
    image = np.where(inside, 60, ground)[..., None] + np.array([0, 5, 10])
    box = (34.6 - radius - 1, 30.2 - radius - 1, 34.6 + radius + 1, 30.2 + radius + 1)
    return np.clip(image, 0, 255).astype(np.uint8), inside, box


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("radius", [3.0, 6.0, 14.0])
def test_grabcut_finds_what_stands_out_in_the_box(radius: float) -> None:
    image, inside, box = disc(radius)
    found = GrabCut()(image, box)
    assert iou(found, inside) > (0.7 if radius < 5 else 0.9)
    np.testing.assert_array_equal(GrabCut()(image, box), found)


def test_grabcut_stays_within() -> None:
    image, inside, box = disc()
    half = np.zeros_like(inside)
    half[:, :35] = True
    assert not (GrabCut()(image, box, half) & ~half).any()
    assert not GrabCut()(image, box, np.zeros_like(inside)).any()


@pytest.mark.parametrize("box", [(-20, -20, -5, -5), (70, 10, 90, 20), (10, 10, 9, 9)])
def test_a_box_outside_the_image_holds_nothing(box: Box) -> None:
    image, _, _ = disc()
    assert not GrabCut()(image, box).any()


def test_a_box_over_the_whole_image_is_no_error() -> None:
    image, _, _ = disc()
    assert GrabCut()(image, (-1, -1, 64, 64)).shape == (64, 64)


def test_boxes_hold_the_pixels_whose_centres_lie_in_them() -> None:
    assert whole_pixels((0.5, 1.0, 3.4, 3.0), 10, 10) == (1, 1, 4, 4)
    assert whole_pixels((-5, -5, 50, 50), 10, 8) == (0, 0, 10, 8)


def test_names() -> None:
    assert isinstance(segmenter("grabcut"), GrabCut)
    with pytest.raises(Unsupported, match="there are: grabcut, sam:FOLDER, sam2:FOLDER"):
        segmenter("sam")


@pytest.fixture(scope="module")
def sam(tmp_path_factory: pytest.TempPathFactory) -> Path:
    transformers = pytest.importorskip("transformers", reason="the extra `models` is missing")
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
    config = transformers.SamConfig(
        vision_config={
            "hidden_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 64,
            "patch_size": 8, "output_channels": 16, "global_attn_indexes": [1], "window_size": 4, "mlp_dim": 16,
            "num_pos_feats": 8,
        },
        prompt_encoder_config={"hidden_size": 16, "image_size": 64, "patch_size": 8, "mask_input_channels": 4},
        mask_decoder_config={
            "hidden_size": 16, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "iou_head_hidden_dim": 16,
        },
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("sam")
    transformers.SamModel(config).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def sam2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    transformers = pytest.importorskip("transformers", reason="the extra `models` is missing")
    torch = pytest.importorskip("torch")
    if not hasattr(transformers, "Sam2Model"):
        pytest.skip("this transformers has no Sam2Model")
    torch.manual_seed(0)
    backbone = {
        "model_type": "sam2_hiera_det_model", "hidden_size": 8, "num_attention_heads": 1, "image_size": [64, 64],
        "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [8, 16, 32, 64],
        "num_attention_heads_per_stage": [1, 1, 2, 2], "window_size_per_stage": [4, 4, 4, 4],
        "global_attention_blocks": [3], "window_positional_embedding_background_size": [4, 4],
    }  # fmt: skip
    config = transformers.Sam2Config(
        vision_config={
            "backbone_config": backbone, "backbone_channel_list": [64, 32, 16, 8],
            "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]], "fpn_hidden_size": 16,
        },
        prompt_encoder_config={"hidden_size": 16, "image_size": 64, "patch_size": 16, "mask_input_channels": 4},
        mask_decoder_config={
            "hidden_size": 16, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2,
            "iou_head_hidden_dim": 16,
        },
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("sam2")
    transformers.Sam2Model(config).save_pretrained(folder)
    return folder


@pytest.mark.parametrize("kind", ["sam", "sam2"])
@pytest.mark.parametrize("shape", [(48, 64), (100, 50)])
def test_the_real_classes_give_a_mask_of_the_images_size(
    kind: str, shape: tuple[int, int], request: pytest.FixtureRequest
) -> None:
    model = segmenter(f"{kind}:{request.getfixturevalue(kind)}")
    assert isinstance(model, Sam if kind == "sam" else Sam2)
    image = np.random.default_rng(1).integers(0, 255, (*shape, 3)).astype(np.uint8)
    box = (10.0, 12.0, 30.0, 40.0)
    mask = model(image, box)
    assert mask.shape == shape
    assert mask.dtype == bool
    np.testing.assert_array_equal(model(image, box), mask)
    within = np.zeros(shape, bool)
    within[:20] = True
    np.testing.assert_array_equal(model(image, box, within), mask & within)


def test_sams_pictures_are_those_of_its_own_processor(sam: Path) -> None:
    """The reference: transformers' processor on the same image, box and model."""
    transformers = pytest.importorskip("transformers")
    torch = pytest.importorskip("torch")
    kinds = ("SamImageProcessorPil", "SamImageProcessor")
    try:
        kind = next(getattr(transformers, k) for k in kinds if hasattr(transformers, k))
        own = kind(size={"longest_edge": 64}, pad_size={"height": 64, "width": 64})
    except (ImportError, StopIteration):
        pytest.skip("no image processor of SAM works without torchvision")
    image = np.random.default_rng(2).integers(0, 255, (24, 32, 3)).astype(np.uint8)
    image = image.repeat(2, 0).repeat(2, 1)  # no resampling: 48 x 64 fills the longer side
    expected = torch.as_tensor(np.array(own(image)["pixel_values"][0]))
    from rpaug.providers.models import picture

    made = picture(image, (48, 64), (64, 64))[0]
    np.testing.assert_allclose(made[:, :48], expected[:, :48], atol=1e-5)
    np.testing.assert_allclose(made[:, 48:], 0, atol=0)


def test_a_folder_without_a_model_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("transformers", reason="the extra `models` is missing")
    with pytest.raises(Unsupported, match=r"no config.json.*segmenter: sam:FOLDER"):
        Sam(tmp_path)
    (tmp_path / "config.json").write_text("{}")
    with pytest.raises(Unsupported, match="not a Sam2Model that can be loaded"):
        Sam2(tmp_path)
