"""The camera of a batch in front of its monitor, found again after it was disconnected."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from nvsdata.common.progress import say_above_bar
from nvsdata.recording.camera import Camera, CameraError, host_time
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.status import Status
from nvsdata.rig.watch import Watch

RETRY = 1_000_000  # µs between attempts to find a disconnected camera
MISSED = 60_000_000  # µs without a camera after which the alarm runs


@dataclass(frozen=True)
class Rig:
    """A camera in front of a monitor.

    Args:
        find: Opens the camera; called again after the camera was disconnected.
        monitor: Monitor that plays the videos.
        settings: Settings of the camera.
    """

    find: Callable[[], Camera]
    monitor: Monitor
    settings: CameraSettings


class Cameras:
    """Holder of the camera, which is found again after it was disconnected."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._camera: Camera | None = None
        self._had_one = False
        self._watched: tuple[Watch, Status] | None = None

    def watched_by(self, watch: Watch, status: Status) -> None:
        """Set the objects that are notified if the camera is disconnected."""
        self._watched = watch, status

    def get(self) -> Camera:
        """Return the camera; wait for it if it was connected before. ValueError for settings that it doesn't have."""
        reason, since = "", host_time()
        while self._camera is None:
            try:
                self._camera = self._rig.find()
                self._camera.configure(self._rig.settings)
                self._had_one = True
            except CameraError as error:
                self.drop()
                if not self._had_one:
                    raise
                if str(error) != reason:
                    reason = str(error)
                    say_above_bar(f"{reason}: waiting for it")
                if self._watched is not None:
                    watch, status = self._watched
                    status.set(state="waiting for the camera")
                    if host_time() - since > MISSED:
                        watch.alarm(f"the camera has been gone for {MISSED / 60e6:.0f} minutes: {reason}")
                        since = float("inf")
                self._rig.monitor.wait(host_time() + RETRY)
        return self._camera

    def drop(self) -> None:
        """Close the camera because of a fault."""
        if self._camera is not None:
            with suppress(OSError):
                self._camera.close()
            self._camera = None

    def __enter__(self) -> Cameras:
        return self

    def __exit__(self, *_: object) -> None:
        self.drop()
