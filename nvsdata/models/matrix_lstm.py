"""Event tensors by a recurrent cell at each pixel (Matrix-LSTM)."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn.utils.rnn import PackedSequence

from nvsdata.common.validation import whole
from nvsdata.data.ragged import EventBatch


class MatrixLSTM(nn.Module):
    """LSTMs with shared weights, each of which reads the events of one pixel in order (Cannici et al. 2020).

    The input for an event is its polarity, ±1, and the time since the previous event of the pixel, as a fraction of the
    sample's duration (0 for the first one). The LSTM's output after the last event is the pixel's features. Pixels
    without events are 0 and need no computation. There is no gradient with respect to times.

    The authors' configurations differ: they scale the delays of a pixel by its largest one, or use times from 0 to 1,
    and they keep the earliest events of a pixel with more than the maximum.

    The network takes an `EventBatch` (`nvsdata.collate(samples, events="columns")`) of B samples of one sensor size. It
    returns [B, bins C, H, W] in the data type of its weights.

    Args:
        hidden: C, units of the LSTM (default 8).
        bins: Number of parts of equal duration into which a sample is divided; each is read separately (default 1).
        most: Maximum number of events per pixel and part; if there are more, the latest ones are read (default 512, as
            in the authors' code).

    Raises:
        ValueError: For settings that aren't positive whole numbers, and for samples of several sensor sizes.

    Example:
        >>> import nvsdata
        >>> from nvsdata import models
        >>> samples = [(nvsdata.Events([0, 9], [1, 2], [0, 1], [1, 0], (4, 3)), 0)]
        >>> batch, _ = nvsdata.collate(samples, events="columns")
        >>> models.MatrixLSTM(hidden=8)(batch).shape
        torch.Size([1, 8, 3, 4])
    """

    def __init__(self, hidden: int = 8, bins: int = 1, most: int = 512) -> None:
        super().__init__()
        for name, value in (("hidden", hidden), ("bins", bins), ("most", most)):
            whole(name, value, 1)
        self.hidden, self.bins, self.most = int(hidden), int(bins), int(most)
        self.lstm = nn.LSTM(2, self.hidden)

    def extra_repr(self) -> str:
        """Return the settings for repr()."""
        return f"bins={self.bins}, most={self.most}"

    def forward(self, events: EventBatch) -> torch.Tensor:
        """Return the tensors of a batch, [B, bins C, H, W]."""
        width, height = events.sensor_size
        place, delay, polarity = self._in_order(events, width, height)
        weight = next(self.lstm.parameters())
        # a sum over nothing, so that a batch without events has gradients, too
        out = weight.new_zeros(len(events) * self.bins * height * width, self.hidden) + weight[:0].sum()
        if len(place):
            pixels, first, counts = _runs(place)
            step = torch.arange(len(place), device=place.device) - first.repeat_interleave(counts)
            # the longest first, as a PackedSequence requires
            longest = counts.argsort(descending=True, stable=True)
            rank = torch.empty_like(longest)
            rank[longest] = torch.arange(len(longest), device=place.device)
            order = (step * len(pixels) + rank.repeat_interleave(counts)).argsort()
            given = torch.stack((polarity, delay), 1)[order].to(weight.dtype)
            steps = torch.bincount(step).cpu()
            _, (last, _) = self.lstm(PackedSequence(given, steps))
            out = out.index_copy(0, pixels[longest], last[0])
        shape = len(events), self.bins, height, width, self.hidden
        return out.view(shape).permute(0, 1, 4, 2, 3).flatten(1, 2)

    def _in_order(self, events: EventBatch, width: int, height: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return position in the result, delay and polarity of at most `most` events of each pixel, sorted by pixel."""
        batch = events.batch
        start, duration = events.starts[batch], events.durations[batch].clamp_min(1)
        part = ((events.t - start) * self.bins // duration).clamp_max(self.bins - 1)
        row = (batch * self.bins + part) * height + events.y
        place, order = (row * width + events.x).sort(stable=True)
        t = events.t[order]
        first = torch.ones_like(place, dtype=torch.bool)
        first[1:] = place[1:] != place[:-1]
        delay = torch.zeros_like(t)
        delay[1:] = t[1:] - t[:-1]
        share = delay.masked_fill(first, 0).double() / duration[order]
        polarity = 2 * events.p[order].double() - 1
        _, begin, counts = _runs(place)
        from_end = (begin + counts).repeat_interleave(counts) - torch.arange(len(place), device=place.device)
        kept = from_end <= self.most
        return place[kept], share[kept], polarity[kept]


def _runs(place: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the unique values of a sorted tensor, their first positions and their counts."""
    values, counts = torch.unique_consecutive(place, return_counts=True)
    return values, counts.cumsum(0) - counts, counts
