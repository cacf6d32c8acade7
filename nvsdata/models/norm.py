"""Batch normalization for very small batches, short training runs and several processes."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from nvsdata.models.distributed import all_reduce_sum, process_count


class BatchNorm(nn.modules.batchnorm._BatchNorm):
    """Batch normalization (thesis, eq. 4.7) of nodes [N, C], or of maps [B, C, ...] over all axes but the channels.

    With fewer than two values per channel there is no variance. The layer then uses the running statistics and doesn't
    update them. The first 1 / `momentum` batches have equal weights in the running statistics, so the initial values
    have no effect. Processes that train together (torch.distributed) use the statistics of the entire batch.

    Args:
        num_features: Number of channels C.
        eps: Value added to the variance (default 1e-5).
        momentum: Smallest weight of a new batch in the running statistics (default 0.1).
        affine: Must be True (default): the layer has learned scales and offsets.
        track_running_stats: Must be True (default): the layer has running statistics.

    Example:
        >>> import torch
        >>> from nvsdata import models
        >>> models.BatchNorm(2)(torch.tensor([[0.0, 1.0], [2.0, 5.0]])).detach().round()
        tensor([[-1., -1.],
                [ 1.,  1.]])
    """

    num_batches_tracked: torch.Tensor

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Normalize `x` [N, C, ...]."""
        if not self.training:
            return self._by_running(x)
        here = x.numel() // self.num_features
        if torch.compiler.is_compiling():
            # the number of nodes isn't known while torch traces
            torch._check(here >= 2)  # type: ignore[no-untyped-call]
        count = here if process_count() == 1 else int(all_reduce_sum(torch.tensor(float(here), device=x.device)))
        if count < 2:
            return self._by_running(x)
        self.num_batches_tracked += 1
        assert self.running_mean is not None
        assert self.running_var is not None
        # a tensor: for a Python number, the host would wait for the device at each layer of each step
        factor = self.num_batches_tracked.to(self.running_mean.dtype).reciprocal().clamp(min=self.momentum or 0.0)
        if process_count() > 1:
            return self._shared(x, count, factor)
        mean, variance = torch.zeros_like(self.running_mean), torch.zeros_like(self.running_var)
        out = functional.batch_norm(x, mean, variance, self.weight, self.bias, True, 1.0, self.eps)
        self._learn(mean, variance, factor)
        return out

    def _by_running(self, x: torch.Tensor) -> torch.Tensor:
        """Normalize by the running statistics."""
        if torch.compiler.is_compiling():
            # PyTorch's function checks that there are nodes, which isn't known while torch traces
            assert self.running_mean is not None
            assert self.running_var is not None
            return self._scaled(x - self._of_channels(self.running_mean, x), self.running_var)
        return functional.batch_norm(
            x, self.running_mean, self.running_var, self.weight, self.bias, False, 0.0, self.eps
        )

    def _learn(self, mean: torch.Tensor, variance: torch.Tensor, factor: torch.Tensor) -> None:
        """Move the running statistics towards those of a batch."""
        assert self.running_mean is not None
        assert self.running_var is not None
        with torch.no_grad():
            self.running_mean.lerp_(mean, factor)
            self.running_var.lerp_(variance, factor)

    def _shared(self, x: torch.Tensor, count: int, factor: torch.Tensor) -> torch.Tensor:
        """Normalize by the statistics over the values of all processes."""
        over = [0, *range(2, x.ndim)]
        mean = all_reduce_sum(x.sum(over)) / count
        centered = x - self._of_channels(mean, x)
        variance = all_reduce_sum(centered.square().sum(over)) / count
        self._learn(mean, variance * (count / (count - 1)), factor)
        return self._scaled(centered, variance)

    def _scaled(self, centered: torch.Tensor, variance: torch.Tensor) -> torch.Tensor:
        """Divide values [N, C, ...] of mean 0 by their standard deviation, then apply weight and bias."""
        scale = self._of_channels(self.weight * (variance + self.eps).rsqrt(), centered)
        return centered * scale + self._of_channels(self.bias, centered)

    @staticmethod
    def _of_channels(values: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return values [C] in the shape that broadcasts with `x` [N, C, ...]."""
        return values.view([1, -1] + [1] * (x.ndim - 2))

    def _check_input_dim(self, x: torch.Tensor) -> None:
        pass
