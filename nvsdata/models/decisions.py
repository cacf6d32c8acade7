"""Classification of a stream of events by a trained network."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from nvsdata.data.events import Events
from nvsdata.models.incremental.streaming import stream
from nvsdata.models.prediction import Trained
from nvsdata.transforms.compose import Compose
from nvsdata.transforms.events.causal_filters import CausalFilter
from nvsdata.transforms.events.windows import RandomWindow
from nvsdata.transforms.graphs.edges import RadiusGraph
from nvsdata.transforms.graphs.features import NodeFeatures


class OnlineClassifier:
    """Trained network that classifies a stream of events, with the window, graph and sampler of its training.

    Args:
        trained: A trained network, as `models.load` returns it.
        window: Length of the window in µs (default None: as in training).

    Raises:
        ValueError: For a network or transform that can't stream (see `models.stream`), and for a network that was saved
            without its transform.

    Example:
        >>> from nvsdata import Events, models, transforms as T
        >>> pipeline = T.Compose([T.RandomWindow(30_000), T.RadiusGraph()])
        >>> trained = models.Trained(models.rgcnn("n-mnist").eval(), (), pipeline, {}, {})
        >>> classifier = models.OnlineClassifier(trained)
        >>> classifier.feed(Events([0, 900], [3, 4], [5, 5], [1, 0], (34, 34)))
        >>> classifier.decide(900)["events"]
        2
    """

    def __init__(self, trained: Trained, window: int | None = None) -> None:
        if trained.transform is None:
            raise ValueError("the network was saved without its transform: save it by models.save(..., transform=...)")
        self.stream = stream(trained.model, **_how(trained.transform, window))
        self.classes = trained.classes
        self.sensor_size: tuple[int, int] = trained.model.sensor_size  # type: ignore[assignment]
        self._work = 0.0

    def prepare(self) -> None:
        """Classify artificial events, so that torch's loading at first use doesn't delay a real decision."""
        many = np.arange(100)
        for start, count in ((0, 100), (100, 1), (101, 1), (102, 1)):
            same = np.zeros(count, int)
            self.feed(Events(start + many[:count], same, same, same, self.sensor_size))
            self.decide(0)
        self.stream.reset()

    def feed(self, events: Events) -> None:
        """Add events. Their times must not precede those of events that were fed before."""
        began = time.perf_counter()
        self.stream.feed(events)
        self._work += time.perf_counter() - began

    def decide(self, now: int) -> dict[str, Any]:
        """Classify the events in the window.

        Args:
            now: Time of the decision in µs, returned as it is.

        Returns:
            A dictionary with `time` (µs), `class` (name, or number as a string without names), `probability`, `events`
            (number of events in the window) and `work` (µs of computation since the last decision).

        Raises:
            ValueError: If the scores are NaN.
        """
        began = time.perf_counter()
        scores = self.stream.scores().softmax(0)
        if scores.isnan().any():
            raise ValueError("the network's scores are NaN")
        best = int(scores.argmax())
        found: dict[str, Any] = {"time": now, "class": self.classes[best] if self.classes else str(best)}
        found |= {"probability": round(float(scores[best]), 4), "events": len(self.stream)}
        found["work"] = round(1e6 * (self._work + time.perf_counter() - began))
        self._work = 0.0
        return found


def _how(transform: Any, window: int | None) -> dict[str, Any]:
    """Return the arguments of `stream` other than the network."""
    found: dict[str, Any] = {"window": window}
    for step in transform.transforms if isinstance(transform, Compose) else [transform]:
        if isinstance(step, RandomWindow):
            found["window"] = step.duration if window is None else window
        elif isinstance(step, RadiusGraph | NodeFeatures):
            found["graph"] = step
        elif isinstance(step, CausalFilter):
            found["sampler"] = step
        else:
            raise ValueError(f"{step} can't stream: this transform of the training needs an entire window at once")
    return found
