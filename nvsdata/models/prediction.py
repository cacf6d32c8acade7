"""Trained networks in use: their predictions for recordings."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard, cast, overload

import torch
from torch import nn

from nvsdata import formats
from nvsdata.common.progress import bar
from nvsdata.common.validation import at_least
from nvsdata.data.batching import collate
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.models.voting import vote
from nvsdata.transforms.rng import deterministic_rng

One = str | os.PathLike[str] | Recording | Events
"""A recording: its path, an opened `Recording`, or decoded `Events`."""


@dataclass(frozen=True)
class Trained:
    """A network from a file, in evaluation mode, and what was saved with it.

    - `model`: the network
    - `classes`: names, in the order of the scores; empty if none were saved
    - `transform`: makes the network's input from a recording; None if none was saved
    - `metrics`: such as the accuracy
    - `data`: what it was trained on: dataset, split, fold, seed and the split's hash, as the recipes save them
    """

    model: nn.Module
    classes: tuple[str, ...]
    transform: Any
    metrics: Mapping[str, Any]
    data: Mapping[str, Any]

    @overload
    def predict(self, recordings: One, *, windows: int = 5) -> str: ...  # type: ignore[overload-overlap]
    @overload
    def predict(self, recordings: Iterable[One], *, windows: int = 5) -> list[str]: ...
    def predict(self, recordings: One | Iterable[One], *, windows: int = 5) -> str | list[str]:
        """Name of the most probable class of a recording, or a list of names for several recordings.

        - `recordings`, `windows`: see `predict_proba`

        Without class names, their numbers are returned as strings. ValueError as for `predict_proba`, and for
        scores that are NaN.
        """
        given = [recordings] if _is_one(recordings) else recordings
        found = self.predict_proba(given, windows=windows)
        if bad := int(found.isnan().any(1).sum()):
            raise ValueError(f"the network gives NaN for {bad} of {len(found)} recordings")
        names = [self.classes[best] if self.classes else str(best) for best in found.argmax(1).tolist()]
        return names[0] if _is_one(recordings) else names

    @torch.no_grad()
    def predict_proba(self, recordings: One | Iterable[One], *, windows: int = 5) -> torch.Tensor:
        """Class probabilities of a recording, [num_classes], or of N recordings, [N, num_classes].

        - `recordings`: a path, `Recording` or `Events`, or several of them. A file that doesn't state its sensor is
          opened by `nvsdata.open(path, sensor_size=...)`
        - `windows`: number of voters (default 5), at places spread evenly over the recording, whose log-probabilities
          are averaged, as at the end of a training

        Other random numbers of `transform` depend only on the voter's number, so the result is the same at every
        call, for a recording alone or among others; torch's generators are left as they are. Several recordings show
        a progress bar if they take longer than a second.

        ValueError if no transform was saved, or for less than one window.
        """
        if self.transform is None:
            raise ValueError("no transform was saved with this network: make its input yourself, and call .model")
        at_least("windows", windows, 1)
        if _is_one(recordings):
            return self._voted(recordings, windows)
        found = [self._voted(one, windows) for one in bar(cast("Iterable[One]", recordings), "recordings", delay=1)]
        return torch.stack(found) if found else torch.empty(0, len(self.classes))

    def _voted(self, recording: One, windows: int) -> torch.Tensor:
        opened = formats.open(recording) if isinstance(recording, str | os.PathLike) else recording
        samples = []
        for number in range(windows):
            with deterministic_rng(number, windows):
                samples.append((self.transform(opened), 0))
        batch, _ = collate(samples)
        device = next(self.model.parameters()).device
        probabilities: torch.Tensor = vote(self.model(batch.to(device)))
        return probabilities


def _is_one(recordings: One | Iterable[One]) -> TypeGuard[One]:
    return isinstance(recordings, str | os.PathLike | Recording | Events)
