"""Fewer events: non-uniform grid sampling, and events dropped at random."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from nvsdata.common.validation import not_negative, positive, probability
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.sample import nonuniform_sample as kernel
from nvsdata.transforms.defaults import BETA
from nvsdata.transforms.draws import generator, randint, uniform


@dataclass(frozen=True)
class NonUniformSample:
    """Non-uniform grid sampling (thesis 4.2.1): one random event from each box of at most `k` events.

    The space-time box of the events is split at the median of its widest side, weighted as the
    graph's distance is (`alpha`, `beta`, eq. 4.2), until no box holds more than k.
    """

    k: int = 8
    alpha: float = 1.0
    beta: float = BETA

    def __post_init__(self) -> None:
        positive("k", self.k)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)

    def __call__(self, sample: Events | Recording) -> Events:
        return nonuniform_sample(sample, self.k, alpha=self.alpha, beta=self.beta)


@dataclass(frozen=True)
class DropEvents:
    """Drop each event with one probability, drawn for the sample from [0, `most`)."""

    most: float = 0.3

    def __post_init__(self) -> None:
        probability("most", self.most)

    def __call__(self, sample: Events | Recording) -> Events:
        return drop(sample, uniform(0, self.most))


def nonuniform_sample(sample: Events | Recording, k: int = 8, *, alpha: float = 1.0, beta: float = BETA) -> Events:
    """One random event from each box of at most `k`; see `NonUniformSample`."""
    events = as_events(sample)
    if k == 1:
        return events
    chosen = kernel(events.t, events.x, events.y, k, math.sqrt(alpha), math.sqrt(beta), randint(2**62))
    # the indices are sorted, so the events are
    return events.of(events.columns.take(chosen))


def drop(sample: Events | Recording, share: float) -> Events:
    """Keep each event with probability 1 - `share`, independently."""
    probability("share", share)
    events = as_events(sample)
    return events[(torch.rand(len(events), generator=generator()) >= share).numpy()]
