"""Online classification of a camera's events, in a thread parallel to the recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Condition, Thread
from typing import Any, Protocol

from nvsdata.data.events import Events
from nvsdata.recording.camera import host_time
from nvsdata.recording.capture import RecordingReport


class OnlineModel(Protocol):
    """Protocol of a classifier that takes events and returns decisions, such as `models.OnlineClassifier`."""

    stream: Any

    def feed(self, events: Events) -> None: ...
    def decide(self, now: int) -> dict[str, Any]: ...


class OnlineInference(Thread):
    """Thread that classifies a camera's events as they arrive, and never delays the recording.

    Use it in a `with` block, and pass `add` to `record` as `watch`. `error` is the error that ended the decisions, None
    if there was none. If the thread is late by more than the classifier's window, it skips events and resumes with the
    newest window. With a causal graph, skipped events are then missing as neighbors of the oldest events in the window.

    Args:
        decider: Classifier that is fed the events.
        tell: Called with each decision, to which three fields are added: `behind` (µs since the last event), `skipped`
            (number of the camera's blocks since the previous decision that had no decision of their own) and `missed`
            (number of events since then that weren't fed).
        ended: Called with the error that ended the decisions; the recording continues.
    """

    def __init__(
        self,
        decider: OnlineModel,
        tell: Callable[[dict[str, Any]], None],
        ended: Callable[[Exception], None] = lambda error: None,
    ) -> None:
        super().__init__(name="nvsdata-decisions", daemon=True)
        self.error: Exception | None = None
        self._decider, self._tell, self._ended = decider, tell, ended
        self._waiting: deque[Events] = deque()
        self._change = Condition()
        self._zero, self._over = 0.0, False
        self._missed = self._reported = 0

    def add(self, report: RecordingReport, events: Events) -> None:
        """Add the next events of a camera whose time began at the host time `report.zero`."""
        if not len(events) or self.error is not None:
            return
        window = self._decider.stream.window
        with self._change:
            self._zero = report.zero
            self._waiting.append(events)
            # events that are too old for any decision are dropped
            while window is not None and self._waiting[0].t[-1] <= events.t[-1] - window:
                self._missed += len(self._waiting.popleft())
            self._change.notify()

    def run(self) -> None:
        try:
            while blocks := self._take():
                for events in blocks:
                    self._decider.feed(events)
                last = int(blocks[-1].t[-1])
                line = self._decider.decide(last)
                late = max(round(host_time() - self._zero - last), 0)
                missed, self._reported = self._missed - self._reported, self._missed
                self._tell(line | {"behind": late, "skipped": len(blocks) - 1, "missed": missed})
        except Exception as error:  # a failure of the network must not end the recording
            self.error = error
            self._ended(error)

    def _take(self) -> list[Events]:
        """Return all waiting blocks, at least one, or an empty list at the end."""
        with self._change:
            self._change.wait_for(lambda: bool(self._waiting) or self._over)
            blocks = list(self._waiting)
            self._waiting.clear()
        return blocks

    def __enter__(self) -> OnlineInference:
        self.start()
        return self

    def __exit__(self, *_: Any) -> None:
        with self._change:
            self._over = True
            self._change.notify()
        self.join()
