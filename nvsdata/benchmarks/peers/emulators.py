"""Emulators of other libraries, without noise and with the given thresholds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from nvsdata.data.events import Events
from nvsdata.video.frames import VideoFrame

Emulator = Callable[[Sequence[VideoFrame], float, float], Callable[[], Any]]


def _v2e(frames: Sequence[VideoFrame], on: float, off: float) -> Callable[[], Any]:
    """Return the emulation of v2e without interpolated frames, whose network's weights aren't in its package."""
    from v2ecore.emulator import EventEmulator

    def run() -> np.ndarray:
        made = EventEmulator(
            *(on, off),
            sigma_thres=0.0,
            cutoff_hz=0.0,
            leak_rate_hz=0.0,
            shot_noise_rate_hz=0.0,
            device="cpu",
        )
        found = [made.generate_events(frame.pixels, frame.time / 1e6) for frame in frames]
        return np.concatenate([events for events in found if events is not None])

    return run


def _eventcv(frames: Sequence[VideoFrame], on: float, off: float) -> Callable[[], Any]:
    import eventcv

    # it converts frames from sRGB to light, which the gray levels are for the others
    gray, rate = _srgb(np.stack([frame.pixels for frame in frames])), 1e6 / (frames[1].time - frames[0].time)
    thresholds = {"pos_thres": on, "neg_thres": off, "sigma_thres": 0.0}
    noise = {"cutoff_hz": 0.0, "leak_rate_hz": 0.0, "shot_noise_rate_hz": 0.0, "refractory_us": 0}
    return lambda: eventcv.simulate(gray, fps=rate, **thresholds, **noise)


def _srgb(light: np.ndarray) -> np.ndarray:
    """Return the sRGB values, float32 of 0 to 1, of light from 0 to 255."""
    light = light / 255
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055).astype(np.float32)


def _evlib(frames: Sequence[VideoFrame], on: float, off: float) -> Callable[[], Any]:
    from evlib.simulation import ESIMConfig, ESIMSimulator

    config = ESIMConfig(on, off, refractory_period_ms=0.0, device="cpu")

    def run() -> list[Any]:
        made = ESIMSimulator(config)
        return [made.process_frame(frame.pixels, frame.time / 1e6) for frame in frames]

    return run


def events_of(found: Any, size: tuple[int, int]) -> Events:
    """Return the events that an emulator made, sorted by time."""
    if hasattr(found, "numpy"):
        x, y, t, p = found.numpy().T
        seconds = t / 1e6
    elif isinstance(found, list):
        x, y, seconds, p = np.concatenate([np.stack(columns) for columns in found], 1)
    else:
        seconds, x, y, p = found.T
    t = np.rint(seconds * 1e6).astype(np.int64)
    order = np.argsort(t, kind="stable")
    return Events(t[order], x[order].astype(np.int16), y[order].astype(np.int16), p[order] > 0, size)


EMULATORS: dict[str, Emulator] = {"v2e": _v2e, "eventcv": _eventcv, "evlib": _evlib}
