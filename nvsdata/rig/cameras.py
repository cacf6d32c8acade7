"""Access to the camera of a batch, which is opened again after a disconnection."""

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
        find: Function that opens the camera; it is called again after a disconnection.
        monitor: Monitor that plays the videos.
        settings: Settings of the camera.
    """

    find: Callable[[], Camera]
    monitor: Monitor
    settings: CameraSettings


class Cameras:
    """Access to the camera, which is opened again after a disconnection."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._camera: Camera | None = None
        self._had_one = False
        self._watched: tuple[Watch, Status] | None = None

    def watched_by(self, watch: Watch, status: Status) -> None:
        """Set the objects that are notified if the camera is disconnected."""
        self._watched = watch, status

    def get(self) -> Camera:
        """Return the camera; wait for it if it was connected before.

        Raises:
            CameraError: The camera can't be opened for the first time.
            ValueError: The camera doesn't have these settings.
        """
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
                    say_above_bar(f"{reason}: waiting for the camera")
                if self._watched is not None:
                    watch, status = self._watched
                    status.set(state="waiting for the camera")
                    if host_time() - since > MISSED:
                        watch.alarm(f"the camera has been disconnected for {MISSED / 60e6:.0f} minutes: {reason}")
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
