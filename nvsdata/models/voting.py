"""The vote of several windows of a recording."""

from __future__ import annotations

import torch


def vote(scores: torch.Tensor, axis: int = 0) -> torch.Tensor:
    """Combine the windows of a recording: probabilities in proportion to the geometric mean of theirs.

    - `scores`: [..., num_classes], a network's for each window
    - `axis`: along which the windows lie (default 0)

    Returns probabilities, without that axis.
    """
    return scores.log_softmax(-1).mean(axis).softmax(-1)
