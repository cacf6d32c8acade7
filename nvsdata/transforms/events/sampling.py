"""Fewer events: non-uniform grid sampling, and random dropping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from nvsdata.common.validation import not_negative, probability, whole
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording, as_events
from nvsdata.kernels.represent.sample import nonuniform_sample as kernel
from nvsdata.transforms.apply import change_all
from nvsdata.transforms.defaults import BETA
from nvsdata.transforms.rng import generator, randint, uniform


@dataclass(frozen=True)
class NonUniformSample:
    """Non-uniform grid sampling (thesis 4.2.1): one random event from each box of at most `k` events.

    The space-time box of the events is split at the median of its widest side, weighted like the distance in the
    graph (eq. 4.2), until no box holds more than k events.

    - `k`: most events in a box (default 8); 1 keeps all events
    - `alpha`: weight of squared pixels (default 1.0)
    - `beta`: weight of squared µs (default (0.5e-5)²; see `RadiusGraph`)

    Takes `Events` or a `Recording`, gives `Events`. ValueError for settings out of range.
    """

    k: int = 8
    alpha: float = 1.0
    beta: float = BETA

    def __post_init__(self) -> None:
        whole("k", self.k, 1)
        not_negative("alpha", self.alpha)
        not_negative("beta", self.beta)

    def __call__(self, sample: Events | Recording) -> Events:
        return nonuniform_sample(sample, self.k, alpha=self.alpha, beta=self.beta)


@dataclass(frozen=True)
class DropEvents:
    """Drop each event with the same probability, which is drawn for each sample from [0, `most`).

    - `most`: largest probability (default 0.3)

    Takes `Events`, a `Recording` or a list of them, with one probability; gives `Events`. ValueError unless `most` lies
    between 0 and 1.
    """

    most: float = 0.3

    def __post_init__(self) -> None:
        probability("most", self.most)

    def __call__(self, sample: Any) -> Any:
        share = uniform(0, self.most)
        return change_all(sample, lambda events: drop(events, share))


def nonuniform_sample(sample: Events | Recording, k: int = 8, *, alpha: float = 1.0, beta: float = BETA) -> Events:
    """One random event from each box of at most `k`; see `NonUniformSample`."""
    events = as_events(sample)
    if k == 1:
        return events
    chosen = kernel(events.t, events.x, events.y, k, math.sqrt(alpha), math.sqrt(beta), randint(2**62))
    # the indices are sorted, so the events are sorted, too
    return events.of(events.columns.take(chosen))


def drop(sample: Events | Recording, share: float) -> Events:
    """Drop each event with probability `share`, independently; ValueError unless it lies between 0 and 1."""
    probability("share", share)
    events = as_events(sample)
    return events[(torch.rand(len(events), generator=generator()) >= share).numpy()]
