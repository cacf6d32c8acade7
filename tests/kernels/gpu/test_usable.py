import sys
import warnings

import pytest
import torch

from nvsdata.kernels import triton

works = triton.works.__wrapped__  # without its cache


def test_tensors_on_the_cpu_are_left_to_other_kernels():
    assert not triton.usable(torch.ones(1))


def test_without_triton_torch_is_used(monkeypatch):
    monkeypatch.setitem(sys.modules, "nvsdata.kernels.triton.pool", None)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not works(torch.device("cuda"))


@pytest.mark.skipif(torch.cuda.is_available(), reason="Triton works there")
def test_triton_that_cannot_run_is_reported():
    pytest.importorskip("triton.language")
    with pytest.warns(UserWarning, match="torch is used instead of Triton, which can't run on cuda"):
        assert not works(torch.device("cuda"))


def test_only_single_and_double_precision_without_autocast(monkeypatch):
    monkeypatch.setattr(triton, "works", lambda device: True)
    assert triton.usable(torch.ones(1))
    assert triton.usable(torch.ones(1, dtype=torch.float64))
    assert not triton.usable(torch.ones(1, dtype=torch.float16))
    with monkeypatch.context() as within:
        within.setattr(torch, "is_autocast_enabled", lambda kind: kind == "cuda")
        assert not triton.usable(torch.ones(1))
    torch.use_deterministic_algorithms(True)
    try:
        assert not triton.usable(torch.ones(1))
    finally:
        torch.use_deterministic_algorithms(False)
