"""Options of a simulated camera and monitor; most of them are faults."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from threading import Timer
from typing import Any

from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.scenes import PIXELS, Outlines, Watched
from nvsdata.recording.simulated.usb_backend import Backend

AWAY = 2.0  # s for which the camera stays unplugged


@dataclass(frozen=True)
class Simulation:
    """Faults of a simulated camera and screen.

    Args:
        drift: Error of the camera's clock in ppm (default 0).
        noise: Noise events in Hz per pixel (default 0.5).
        late: Fraction of the images that the screen shows a refresh later than the log states (default 0).
        lossy: Probability that the camera drops the events of a simulated time slice (default 0).
        wired: 1 for a photodiode at the camera's external input (default 0).
        unplugged: Time in s after the first use at which the camera is disconnected for two seconds (default 0: never).
        stalled: Time in s after the first use at which the camera stops sending, until it is opened again (default 0:
            never).
        seed: Seed of all random numbers (default 0).
    """

    drift: float = 0.0
    noise: float = 0.5
    late: float = 0.0
    lossy: float = 0.0
    wired: float = 0.0
    unplugged: float = 0.0
    stalled: float = 0.0
    seed: float = 0.0

    @classmethod
    def of(cls, text: str) -> Simulation:
        """Parse a text of the form NAME=NUMBER,NAME=NUMBER...; raise ValueError for other texts."""
        known = [field.name for field in fields(cls)]
        given: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            with suppress(ValueError):
                given[name] = float(value)
            if name not in known or name not in given:
                raise ValueError(f"--simulate takes NAME=NUMBER of {', '.join(known)}, not {part!r}")
        return cls(**given)

    def watched(self, kind: type[SimulatedDavis] = SimulatedDavis) -> tuple[Backend, Callable[..., Any]]:
        """Return a backend with a camera in front of a monitor, and the function for `on_change` of `Monitor`."""
        scene = Watched(
            replace(PIXELS, noise_rate=self.noise, seed=int(self.seed)),
            late=self.late,
            wired=bool(self.wired),
            seed=int(self.seed),
        )
        return self._backend(kind(scene=scene)), scene.show

    def alone(self) -> Backend:
        """Return a backend with a camera in front of a moving square."""
        return self._backend(SimulatedDavis(scene=Outlines(noise=self.noise * 240 * 180)))

    def _backend(self, camera: SimulatedDavis) -> Backend:
        camera.speed, camera.lossy = 1 + self.drift * 1e-6, self.lossy
        started = False

        def before(camera: SimulatedDavis, call: str) -> None:
            nonlocal started
            if call == "open":
                camera.stalled = False
            if call == "open" and not started:
                started = True
                self._plan(camera)

        return Backend(camera, before=before)

    def _plan(self, camera: SimulatedDavis) -> None:
        happenings = [(self.unplugged, "unplugged", True), (self.stalled, "stalled", True)]
        happenings += [(self.unplugged + AWAY, "unplugged", False)] if self.unplugged else []
        for seconds, name, value in happenings:
            if seconds:
                timer = Timer(seconds, setattr, (camera, name, value))
                timer.daemon = True
                timer.start()
