"""Batch normalisation that survives tiny batches and short trainings."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional


class BatchNorm(nn.BatchNorm1d):
    """Batch normalisation over nodes (thesis eq. 4.7).

    With fewer than two nodes in a batch there is no variance: then the running statistics serve,
    and stay as they are. The first batches count equally in the running statistics, until
    `momentum` takes over: so they don't remember the values they were set to at the start.
    """

    num_batches_tracked: torch.Tensor

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Normalise `x` [N, C]."""
        learn = self.training and x.shape[0] > 1
        factor = 0.0
        if learn:
            self.num_batches_tracked += 1
            factor = max(self.momentum or 0.0, 1 / int(self.num_batches_tracked))
        return functional.batch_norm(
            x, self.running_mean, self.running_var, self.weight, self.bias, learn, factor, self.eps
        )
