"""CLIP tells which words suit a picture best, with models of the real class, small and untrained."""

from pathlib import Path

import numpy as np
import pytest
import torch
from small_clip import saved, tokenizer

from rpaug import Unsupported
from rpaug.providers.clip import Clip

WORDS = ["a", "jelly", "wood", "sand"]


def test_the_words_that_suit_best_are_those_with_the_largest_product(tmp_path: Path) -> None:
    made = tokenizer(saved(tmp_path, WORDS), WORDS)
    clip, asked = Clip.load(tmp_path), ["a jelly", "a wood", "a sand"]
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
    clip = Clip.load(saved(tmp_path, WORDS))
    with pytest.raises(Unsupported, match="no tokenizer beside the model"):
        clip.closest(np.zeros((32, 32, 3), np.uint8), ["a jelly"])
