"""Batch normalisation that survives tiny batches."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional


class BatchNorm(nn.BatchNorm1d):
    """Batch normalisation over nodes (thesis eq. 4.7).

    With fewer than two nodes in a batch there is no variance: then the running statistics serve,
    and stay as they are.
    """

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Normalise `x` [N, C]."""
        if self.training and x.shape[0] < 2:
            return functional.batch_norm(x, self.running_mean, self.running_var, self.weight, self.bias, eps=self.eps)
        return super().forward(x)
