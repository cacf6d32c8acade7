"""A lab that isn't there: a simulated camera before the monitor, and what may happen to it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from threading import Timer
from typing import Any

from nvsdata.recording.simulated.camera import Camera
from nvsdata.recording.simulated.scenes import PIXELS, Outlines, Watched
from nvsdata.recording.simulated.usb_backend import Backend

AWAY = 2.0  # s that a camera stays unplugged


@dataclass(frozen=True)
class Simulation:
    """What the simulated camera suffers.

    `drift` of its clock in ppm, `noise` in Hz a pixel, `late` the share of pictures that the screen shows a refresh
    later than the computer thinks, `lossy` the share of its packets that the camera drops, `wired` 1 for a photodiode
    at its external input; `unplugged` and `stalled`, s after the first use at which it is unplugged for two seconds,
    or sends nothing any more until it is opened again. `seed` of what is random.
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
        """Settings as NAME=NUMBER, separated by commas. ValueError for others."""
        known = [field.name for field in fields(cls)]
        given: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            name, _, value = part.partition("=")
            with suppress(ValueError):
                given[name] = float(value)
            if name not in known or name not in given:
                raise ValueError(f"--simulate takes NAME=NUMBER of {', '.join(known)}, not {part!r}")
        return cls(**given)

    def watched(self, kind: type[Camera] = Camera) -> tuple[Backend, Callable[..., Any]]:
        """A camera before a monitor, and what the monitor has to tell."""
        scene = Watched(
            replace(PIXELS, noise_rate=self.noise, seed=int(self.seed)),
            late=self.late,
            wired=bool(self.wired),
            seed=int(self.seed),
        )
        return self._backend(kind(scene=scene)), scene.look

    def alone(self) -> Backend:
        """A camera before a moving square."""
        return self._backend(Camera(scene=Outlines(noise=self.noise * 240 * 180)))

    def _backend(self, camera: Camera) -> Backend:
        camera.speed, camera.lossy = 1 + self.drift * 1e-6, self.lossy
        started = False

        def before(camera: Camera, call: str) -> None:
            nonlocal started
            if call == "open":
                camera.stalled = False
            if call == "open" and not started:
                started = True
                self._plan(camera)

        return Backend(camera, before=before)

    def _plan(self, camera: Camera) -> None:
        happenings = [(self.unplugged, "unplugged", True), (self.stalled, "stalled", True)]
        happenings += [(self.unplugged + AWAY, "unplugged", False)] if self.unplugged else []
        for seconds, name, value in happenings:
            if seconds:
                timer = Timer(seconds, setattr, (camera, name, value))
                timer.daemon = True
                timer.start()
