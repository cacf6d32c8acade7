"""Batch normalization for very small batches, short trainings and several processes."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from nvsdata.models.distributed import all_reduce_sum, processes


class BatchNorm(nn.modules.batchnorm._BatchNorm):
    """Batch normalization (thesis eq. 4.7) of nodes [N, C], or of maps [B, C, ...] over all axes but the channels.

    With fewer than two values per channel there is no variance; then the running statistics are used, and not
    updated. The first batches have equal weights in the running statistics, until `momentum` takes over, so their
    initial values are forgotten. Processes that train together (torch.distributed) share the statistics of the
    whole batch.

    - `num_features`: number of channels C
    - other parameters: those of torch.nn.BatchNorm1d
    """

    num_batches_tracked: torch.Tensor

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Normalize `x` [N, C, ...]."""
        if not self.training:
            return self._normalized(x, learn=False)
        here = x.numel() // self.num_features
        count = here if processes() == 1 else int(all_reduce_sum(torch.tensor(float(here), device=x.device)))
        if count < 2:
            return self._normalized(x, learn=False)
        self.num_batches_tracked += 1
        factor = max(self.momentum or 0.0, 1 / int(self.num_batches_tracked))
        return self._normalized(x, learn=True, factor=factor) if processes() == 1 else self._shared(x, count, factor)

    def _normalized(self, x: torch.Tensor, *, learn: bool, factor: float = 0.0) -> torch.Tensor:
        return functional.batch_norm(
            x, self.running_mean, self.running_var, self.weight, self.bias, learn, factor, self.eps
        )

    def _shared(self, x: torch.Tensor, count: int, factor: float) -> torch.Tensor:
        """Normalize by the statistics over the values of all processes."""
        over, shape = [0, *range(2, x.ndim)], [1, -1] + [1] * (x.ndim - 2)
        mean = all_reduce_sum(x.sum(over)) / count
        centered = x - mean.view(shape)
        variance = all_reduce_sum(centered.square().sum(over)) / count
        assert self.running_mean is not None
        assert self.running_var is not None
        with torch.no_grad():
            self.running_mean.lerp_(mean, factor)
            self.running_var.lerp_(variance * (count / (count - 1)), factor)
        scale = (self.weight * (variance + self.eps).rsqrt()).view(shape)
        return centered * scale + self.bias.view(shape)

    def _check_input_dim(self, x: torch.Tensor) -> None:
        pass
