"""Triton's kernels run on a GPU where there is one, else on the CPU by Triton's interpreter."""

import pytest
import torch

from nvsdata.kernels import triton


@pytest.fixture
def device():
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@pytest.fixture
def on_triton(monkeypatch):
    """A function that makes all networks use Triton from then on, on the CPU, too."""
    from nvsdata.models import clusters, spline_sum

    def use():
        for module in (clusters, spline_sum):
            monkeypatch.setattr(module, "has_kernels", lambda x: False)
        monkeypatch.setattr(triton, "usable", lambda x: True)

    return use
