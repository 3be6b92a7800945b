"""A CLIPModel of the real class, small enough to be made, and taught, within a test."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from jaxtyping import UInt8
from torch.nn import functional

from rpaug.providers.clip import Clip

SPECIAL = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]"]


def saved(folder: Path, words: list[str]) -> Path:
    """An untrained one in `folder`, and nothing beside it."""
    transformers = pytest.importorskip("transformers")
    common = {"hidden_size": 16, "intermediate_size": 16, "num_attention_heads": 2}
    size = len(SPECIAL) + len(words)
    text = {**common, "num_hidden_layers": 1, "vocab_size": size, "max_position_embeddings": 16}
    text |= {"bos_token_id": 2, "eos_token_id": 3, "pad_token_id": 0}
    vision = {**common, "num_hidden_layers": 1, "image_size": 32, "patch_size": 8}
    config = transformers.CLIPConfig(text_config=text, vision_config=vision, projection_dim=8)
    torch.manual_seed(0)
    transformers.CLIPModel(config).save_pretrained(folder)
    return folder


def tokenizer(folder: Path, words: list[str]) -> Any:
    """One that knows the words, put beside the model."""
    transformers = pytest.importorskip("transformers")
    known = SPECIAL + words
    try:
        made = transformers.BertTokenizerFast(vocab={word: k for k, word in enumerate(known)})
    except TypeError:  # before transformers 5
        (folder / "vocab.txt").write_text("\n".join(known))
        made = transformers.BertTokenizerFast(vocab_file=str(folder / "vocab.txt"))
    made.save_pretrained(folder)
    return made


def taught(
    folder: Path, pictures: list[UInt8[np.ndarray, "h w 3"]], texts: list[str], steps: int = 80
) -> None:
    """Teach the saved model which of the texts goes with each picture: the first with the first, and so on."""
    clip = Clip.load(folder)
    read = tokenizer(folder, sorted({word for text in texts for word in text.split()}))
    asked = read(texts, padding=True, return_tensors="pt")
    seen = torch.stack([clip.pixels(picture)[0] for picture in pictures])
    optimiser = torch.optim.Adam(clip.model.parameters(), 1e-2)
    clip.model.train()
    for _ in range(steps):
        images = clip.model.visual_projection(clip.model.vision_model(seen).pooler_output)
        words = clip.model.text_model(asked["input_ids"], asked["attention_mask"]).pooler_output
        words = clip.model.text_projection(words)
        alike = functional.normalize(images, dim=1) @ functional.normalize(words, dim=1).T
        loss = functional.cross_entropy(10 * alike, torch.arange(len(pictures)))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    clip.model.save_pretrained(folder)
