"""Trained networks in use: what they say of recordings."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard, overload

import torch
from torch import nn
from tqdm import tqdm

from nvsdata import formats
from nvsdata.data.batching import collate
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.transforms.draws import of_voter

One = str | os.PathLike[str] | Recording | Events
"""A recording: its path, opened, or decoded."""


@dataclass(frozen=True)
class Trained:
    """A network from a file, in evaluation mode, and what was kept with it.

    `transform` makes the network's input of a recording; None if none was kept. `data` is what it was trained on:
    dataset, split, fold, seed and the split's hash, as the recipes keep them.
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
        """Name of the most probable class of a recording, or a list of names of several; see `predict_proba`.

        A network without class names gives their numbers. ValueError also for scores that are NaN.
        """
        given = [recordings] if _is_one(recordings) else recordings
        found = self.predict_proba(given, windows=windows)
        if bad := int(found.isnan().any(1).sum()):
            raise ValueError(f"the network gives NaN for {bad} of {len(found)} recordings")
        names = [self.classes[best] if self.classes else str(best) for best in found.argmax(1).tolist()]
        return names[0] if _is_one(recordings) else names

    @torch.no_grad()
    def predict_proba(self, recordings: One | Iterable[One], *, windows: int = 5) -> torch.Tensor:
        """Class probabilities [num_classes] of a recording, its path or its events; [N, num_classes] of several.

        `windows` voters look at the recording, at places spread evenly over it, and add up their
        log-probabilities, as at the end of a training. Whatever else `transform` draws depends on the voter's number
        alone, so the answer is the same at every call, alone or among others; torch's generators are left as they are.
        Several recordings show a progress bar if they take longer than a second.

        ValueError if the file keeps no transform, or for less than one window.
        """
        if self.transform is None:
            raise ValueError("no transform was saved with this network: make its input yourself, and call .model")
        if windows < 1:
            raise ValueError(f"windows must be at least 1, not {windows}")
        if _is_one(recordings):
            return self._voted(recordings, windows)
        bar = tqdm(recordings, "recordings", delay=1, disable=None)
        found = [self._voted(recording, windows) for recording in bar]
        return torch.stack(found) if found else torch.empty(0, len(self.classes))

    def _voted(self, recording: One, windows: int) -> torch.Tensor:
        opened = formats.open(recording) if isinstance(recording, str | os.PathLike) else recording
        samples = []
        for number in range(windows):
            with of_voter(number, windows):
                samples.append((self.transform(opened), 0))
        batch, _ = collate(samples)
        device = next(self.model.parameters()).device
        probabilities: torch.Tensor = self.model(batch.to(device)).log_softmax(1).mean(0).softmax(0)
        return probabilities


def _is_one(recordings: One | Iterable[One]) -> TypeGuard[One]:
    return isinstance(recordings, str | os.PathLike | Recording | Events)
