"""Predictions of trained networks for recordings, by voting over windows."""

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
from nvsdata.transforms.rng import deterministic_rng

One = str | os.PathLike[str] | Recording | Events
"""A recording: its path, an opened `Recording`, or decoded `Events`."""


@dataclass(frozen=True)
class Trained:
    """Trained network from a file, in evaluation mode, and the metadata that was saved with it.

    Args:
        model: The network.
        classes: Class names, in the order of the scores; empty if none were saved.
        transform: Transform from a recording to the network's input; None if none was saved.
        metrics: Results such as the accuracy.
        data: Description of the training data: the recipes save dataset, split, fold, seed and the hash of the split.

    Example:
        >>> from nvsdata import Events, models, transforms as T
        >>> pipeline = T.Compose([T.RandomWindow(30_000), T.RadiusGraph()])
        >>> trained = models.Trained(models.rgcnn("n-mnist").eval(), tuple("0123456789"), pipeline, {}, {})
        >>> trained.predict_proba(Events([0, 900], [3, 4], [5, 5], [1, 0], (34, 34))).shape
        torch.Size([10])
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
        """Return the name of the most probable class of a recording, or a list of names for several recordings.

        Args:
            recordings: A path, `Recording` or `Events`, or several of them; see `predict_proba`.
            windows: Number of windows that vote (default 5).

        Returns:
            The name or names. Without class names, the class numbers as strings.

        Raises:
            ValueError: As for `predict_proba`, and for scores that are NaN.
        """
        given = [recordings] if _is_one(recordings) else recordings
        found = self.predict_proba(given, windows=windows)
        if bad := int(found.isnan().any(1).sum()):
            raise ValueError(f"the network's scores are NaN for {bad} of {len(found)} recordings")
        names = [self.classes[best] if self.classes else str(best) for best in found.argmax(1).tolist()]
        return names[0] if _is_one(recordings) else names

    @torch.no_grad()
    def predict_proba(self, recordings: One | Iterable[One], *, windows: int = 5) -> torch.Tensor:
        """Return class probabilities of a recording, [num_classes], or of N recordings, [N, num_classes].

        Random numbers of `transform` depend only on the number of the window. So the result is the same at every call,
        for a recording alone or among others; torch's generators aren't changed. Several recordings show a progress bar
        if they take longer than a second.

        Args:
            recordings: A path, `Recording` or `Events`, or several of them. Open a file that doesn't state its sensor
                by `nvsdata.open(path, sensor_size=...)`.
            windows: Number of windows that vote (default 5). They are spread evenly over the recording, and their
                log-probabilities are averaged, as at the end of a training.

        Returns:
            Probabilities, float32 [num_classes] or [N, num_classes].

        Raises:
            ValueError: If no transform was saved, or for less than one window.
        """
        if self.transform is None:
            raise ValueError("no transform was saved with this network: pass its input to .model")
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


def vote(scores: torch.Tensor, axis: int = 0) -> torch.Tensor:
    """Combine the scores of several windows of a recording.

    Args:
        scores: Class scores (logits) of each window, [..., num_classes].
        axis: Axis of the windows (default 0).

    Returns:
        Probabilities, without the axis of the windows: the normalized geometric mean of the windows' probabilities.
    """
    return scores.log_softmax(-1).mean(axis).softmax(-1)


def _is_one(recordings: One | Iterable[One]) -> TypeGuard[One]:
    return isinstance(recordings, str | os.PathLike | Recording | Events)
