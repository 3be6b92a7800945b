"""CLIP tells which words suit a picture best, with models of the real class, small and untrained."""

from pathlib import Path

import numpy as np
import pytest
import torch

from rpaug import Unsupported
from rpaug.providers.clip import Clip

WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "a", "jelly", "wood", "sand"]


def model(folder: Path) -> Path:
    transformers = pytest.importorskip("transformers")
    common = {"hidden_size": 16, "intermediate_size": 16, "num_attention_heads": 2}
    text = {**common, "num_hidden_layers": 1, "vocab_size": 9, "max_position_embeddings": 16}
    text |= {"bos_token_id": 2, "eos_token_id": 3, "pad_token_id": 0}
    vision = {**common, "num_hidden_layers": 1, "image_size": 32, "patch_size": 8}
    config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=8)
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(folder)
    return folder


def test_the_words_that_suit_best_are_those_with_the_largest_product(tmp_path: Path) -> None:
    transformers = pytest.importorskip("transformers")
    folder = model(tmp_path)
    try:
        made = transformers.BertTokenizerFast(vocab={word: k for k, word in enumerate(WORDS)})
    except TypeError:  # before transformers 5
        (folder / "vocab.txt").write_text("\n".join(WORDS))
        made = transformers.BertTokenizerFast(vocab_file=str(folder / "vocab.txt"))
    made.save_pretrained(folder)
    clip, asked = Clip.load(folder), ["a jelly", "a wood", "a sand"]
    picture = np.random.default_rng(0).integers(0, 255, (40, 32, 3), np.uint8)
    scores = []
    for text in asked:
        tokens = made([text], return_tensors="pt")
        kept = {name: tokens[name] for name in ("input_ids", "attention_mask")}
        with torch.no_grad():
            read = clip.model.text_projection(clip.model.text_model(**kept).pooler_output)[0]
        scores.append(float((read / read.norm()).double().numpy() @ clip.embed(picture)))
    assert clip.closest(picture, asked) == int(np.argmax(scores))


def test_without_a_tokenizer_it_says_so(tmp_path: Path) -> None:
    clip = Clip.load(model(tmp_path))
    with pytest.raises(Unsupported, match="no tokenizer beside the model"):
        clip.closest(np.zeros((32, 32, 3), np.uint8), ["a jelly"])
