"""The devices that code by torch is tested on: the CPU, and a GPU where there is one."""

import pytest
import torch

GPU = pytest.param(
    torch.device("cuda"),
    id="cuda",
    marks=[
        pytest.mark.gpu,
        pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA GPU"),
    ],
)
DEVICES = [pytest.param(torch.device("cpu"), id="cpu"), GPU]
