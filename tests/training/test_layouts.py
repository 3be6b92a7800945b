"""Edited images in the type that a sample's images had."""

import numpy as np
import pytest
import torch

from rpaug.training.matching import Layout


@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("tensor", [False, True])
def test_whole_numbers_are_rounded_not_cut_off(tensor: bool, first: bool) -> None:
    shape = (2, 3, 4, 5) if first else (2, 4, 5, 3)
    like = torch.zeros(shape, dtype=torch.uint8) if tensor else np.zeros(shape, np.uint8)
    layout = Layout.of("image", like, 3)
    images = np.full((2, 4, 5, 3), 7.6, np.float32)
    made = layout.back(images, like)
    assert made.dtype == like.dtype
    assert tuple(made.shape) == shape
    assert np.asarray(made).tolist() == np.full(shape, 8).tolist()
