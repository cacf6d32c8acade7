"""Recording in a separate thread, while the main thread draws."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread
from typing import Any

from nvsdata.data.events import Events
from nvsdata.recording.camera import Camera
from nvsdata.recording.capture import RecordingReport, record


class Recorder(Thread):
    """Thread that runs `record`, while the main thread draws; see `record` for the parameters.

    `begun` is set when the first block of the stream has been decoded, `ended` when the recording has ended.
    """

    def __init__(
        self,
        camera: Camera,
        path: Path | None,
        settings: Any,
        *,
        seconds: float | None = None,
        watch: Callable[[RecordingReport, Events], None] = lambda report, events: None,
        journaled: bool = True,
    ) -> None:
        super().__init__(name="nvsdata-recorder", daemon=True)
        self.camera, self.path, self.settings = camera, path, settings
        self.report = RecordingReport(path)
        self.begun, self.ended = Event(), Event()
        self._watch, self._stop_now = watch, Event()
        self._how: dict[str, Any] = {"seconds": seconds, "journaled": journaled}
        self._error: BaseException | None = None

    def run(self) -> None:
        try:
            self.report = record(
                self.camera, self.path, self.settings, stop=self._stop_now, watch=self._seen, **self._how
            )
        except BaseException as error:
            self._error = error
        finally:
            self.ended.set()
            self.begun.set()

    def _seen(self, report: RecordingReport, events: Events) -> None:
        self._watch(report, events)
        self.begun.set()

    def check(self) -> None:
        """Raise the error that ended the recording, if there is one."""
        if self.ended.is_set() and (error := self._error or self.report.failure):
            raise error

    def finish(self) -> RecordingReport:
        """End the recording, and wait until its file is complete; raise the error of `record`, if there is one."""
        self._stop_now.set()
        self.join()
        if self._error is not None:
            raise self._error
        return self.report
