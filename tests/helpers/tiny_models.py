"""Models of the real classes, small and with random weights, saved as the hub has them."""

from pathlib import Path
from typing import Any

import safetensors.torch
import torch
import transformers

WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "a", "red", "cup", "knob"]
SMALL = {
    "hidden_size": 16,
    "intermediate_size": 16,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
}
DECODER = {
    "hidden_size": 16, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "iou_head_hidden_dim": 16,
}  # fmt: skip
HIERA = {
    "model_type": "sam2_hiera_det_model", "hidden_size": 8, "num_attention_heads": 1, "image_size": [64, 64],
    "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [8, 16, 32, 64],
    "num_attention_heads_per_stage": [1, 1, 2, 2], "window_size_per_stage": [4, 4, 4, 4],
    "global_attention_blocks": [3], "window_positional_embedding_background_size": [4, 4],
}  # fmt: skip
SAM2 = {
    "vision_config": {
        "backbone_config": HIERA, "backbone_channel_list": [64, 32, 16, 8],
        "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]], "fpn_hidden_size": 16,
    },
    "prompt_encoder_config": {"hidden_size": 16, "image_size": 64, "patch_size": 16, "mask_input_channels": 4},
    "mask_decoder_config": DECODER,
}  # fmt: skip
MEMORY = {
    "memory_attention_hidden_size": 16, "memory_attention_num_layers": 1, "memory_attention_num_attention_heads": 1,
    "memory_attention_downsample_rate": 1, "memory_attention_feed_forward_hidden_size": 16,
    "memory_encoder_hidden_size": 16, "memory_encoder_output_channels": 8, "mask_downsampler_embed_dim": 16,
    "memory_fuser_num_layers": 1, "memory_fuser_embed_dim": 16, "memory_fuser_intermediate_dim": 16,
}  # fmt: skip
VIT3 = {
    "model_type": "sam3_vit_model", "hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 2,
    "num_attention_heads": 2, "image_size": 56, "patch_size": 14, "window_size": 2, "global_attn_indexes": [1],
    "pretrain_image_size": 28,
}  # fmt: skip
VISION3 = {
    "model_type": "sam3_vision_model", "backbone_config": VIT3, "fpn_hidden_size": 16,
    "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
}  # fmt: skip
DINO2 = {
    "model_type": "dinov2", "image_size": 28, "patch_size": 14, "reshape_hidden_states": False, "apply_layernorm": True,
    "out_features": ["stage1", "stage2", "stage3", "stage4"], "hidden_size": 16, "num_hidden_layers": 4,
    "num_attention_heads": 2, "mlp_ratio": 1,
}  # fmt: skip


def words(folder: Path) -> None:
    """A tokenizer of a few words."""
    vocabulary = {word: i for i, word in enumerate(WORDS)}
    transformers.BertTokenizerFast(vocab=vocabulary).save_pretrained(folder)


def saved(kind: str, folder: Path) -> Path:
    """A model whose config.json says `kind`, and a tokenizer beside it."""
    torch.manual_seed(0)
    MAKERS[kind]().save_pretrained(folder)
    if kind == "sam3_video":  # as published, the tracker's names have its prefix once
        held = safetensors.torch.load_file(folder / "model.safetensors")
        held = {
            name.replace("tracker_model.tracker_model.", "tracker_model."): v
            for name, v in held.items()
        }
        safetensors.torch.save_file(held, folder / "model.safetensors", {"format": "pt"})
    words(folder)
    return folder


def _sam() -> Any:
    vision = {
        "hidden_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 64, "patch_size": 8,
        "output_channels": 16, "global_attn_indexes": [1], "window_size": 4, "mlp_dim": 16, "num_pos_feats": 8,
    }  # fmt: skip
    prompt = {"hidden_size": 16, "image_size": 64, "patch_size": 8, "mask_input_channels": 4}
    return transformers.SamModel(
        transformers.SamConfig(
            vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=DECODER
        )
    )


def _sam2() -> Any:
    return transformers.Sam2Model(transformers.Sam2Config(**SAM2))


def _sam2_video() -> Any:
    config = transformers.Sam2VideoConfig(
        **SAM2, image_size=64, memory_attention_rope_feat_sizes=[4, 4], **MEMORY
    )
    return transformers.Sam2VideoModel(config)


def _sam3_config() -> Any:
    detr = {
        "hidden_size": 16,
        "intermediate_size": 16,
        "num_layers": 1,
        "num_attention_heads": 2,
    }
    return transformers.Sam3Config(
        vision_config=VISION3,
        text_config={**SMALL, "vocab_size": 10, "max_position_embeddings": 32, "projection_dim": 16},
        geometry_encoder_config={**detr, "roi_size": 2},
        detr_encoder_config=detr,
        detr_decoder_config={**detr, "num_queries": 6},
        mask_decoder_config={"hidden_size": 16, "num_upsampling_stages": 2, "num_attention_heads": 2},
    )  # fmt: skip


def _sam3() -> Any:
    return transformers.Sam3Model(_sam3_config())


def _sam3_video() -> Any:
    tracker = transformers.Sam3TrackerVideoConfig(
        vision_config=VISION3, image_size=56,
        prompt_encoder_config={"hidden_size": 16, "image_size": 56, "patch_size": 14, "mask_input_channels": 4},
        mask_decoder_config=DECODER, memory_attention_rope_feat_sizes=[4, 4], **MEMORY,
    )  # fmt: skip
    config = transformers.Sam3VideoConfig(detector_config=_sam3_config(), tracker_config=tracker)
    return transformers.Sam3VideoModel(config)


def _sam3_tracker() -> Any:
    config = transformers.Sam3TrackerConfig(
        vision_config=VISION3,
        prompt_encoder_config={"hidden_size": 16, "image_size": 56, "patch_size": 14, "mask_input_channels": 4},
        mask_decoder_config=DECODER,
    )  # fmt: skip
    return transformers.Sam3TrackerModel(config)


def _dino(kind: str) -> Any:
    backbone = transformers.SwinConfig(
        image_size=64, patch_size=4, embed_dim=8, depths=[1, 1, 1, 1], num_heads=[1, 2, 2, 2], window_size=4,
        out_features=["stage2", "stage3", "stage4"],
    )  # fmt: skip
    text = {"model_type": "bert", "vocab_size": 10, **SMALL}
    config = getattr(transformers, f"{kind}Config")(
        backbone_config=backbone, text_config=text, d_model=32, encoder_layers=1, decoder_layers=2,
        encoder_attention_heads=2, decoder_attention_heads=2, encoder_ffn_dim=16, decoder_ffn_dim=16,
        num_queries=8, max_text_len=16, num_feature_levels=4,
    )  # fmt: skip
    return getattr(transformers, f"{kind}ForObjectDetection")(config)


def _owl() -> Any:
    config = transformers.Owlv2Config(
        text_config={**SMALL, "vocab_size": 10, "max_position_embeddings": 8, "pad_token_id": 0},
        vision_config={**SMALL, "image_size": 32, "patch_size": 8},
        projection_dim=16,
    )
    return transformers.Owlv2ForObjectDetection(config)


def _anything(kind: str, estimates: str = "metric") -> Any:
    config = getattr(transformers, f"{kind}Config")(
        backbone_config=DINO2, reassemble_hidden_size=16, patch_size=14, neck_hidden_sizes=[8, 8, 8, 8],
        fusion_hidden_size=8, head_hidden_size=4, depth_estimation_type=estimates, max_depth=20,
    )  # fmt: skip
    return getattr(transformers, f"{kind}ForDepthEstimation")(config)


MAKERS: dict[str, Any] = {
    "sam": _sam,
    "sam2": _sam2,
    "sam2_video": _sam2_video,
    "sam3": _sam3,
    "sam3_tracker": _sam3_tracker,
    "sam3_video": _sam3_video,
    "grounding-dino": lambda: _dino("GroundingDino"),
    "mm-grounding-dino": lambda: _dino("MMGroundingDino"),
    "owlv2": _owl,
    "depth_anything": lambda: _anything("DepthAnything"),
    "prompt_depth_anything": lambda: _anything("PromptDepthAnything"),
}
