"""Benchmarks of emulating events of a known motion, compared with an ideal sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.peers.emulators import EMULATORS as PEERS
from nvsdata.benchmarks.peers.emulators import events_of
from nvsdata.data.events import Events
from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.emulation.correlation import pixel_index
from nvsdata.video.frames import VideoFrame

SIZE, SPEED, DURATION = (128, 96), 60.0, 0.4  # pixels, pixels/s, s
FINE = 100  # µs between the frames of the ideal sensor, which are float64
ON, OFF = 0.2, 0.194
EMULATORS = {
    "PIX2NVS": PIX2NVS(threshold=ON),
    "DVS": DVS(on=ON, off=OFF),
    "DVS, linear": DVS(on=ON, off=OFF, upsample="linear"),
    "DVS, flow": DVS(on=ON, off=OFF, upsample="flow"),
}
KIND = "median ms between a pixel's k-th ON or OFF event and the ideal sensor's"


def cases(options: Options) -> list[Case]:
    """Return a case for each emulator and frame rate, and those of other libraries."""
    return [*_by_rate(options), *_peers()]


def _by_rate(options: Options) -> Iterator[Case]:
    rates = (10, 30, 100) if options.quick else (10, 30, 100, 300, 1_000)
    for name, rate in product(EMULATORS, rates):
        yield Case(
            *("motion", f"a known motion to events, by frame rate: {name}", partial(_ready, name, rate)),
            settings={"frames per second": rate},
            axis="frames per second",
            default=rate == 30,
            error_kind=KIND,
        )


def _peers() -> Iterator[Case]:
    """Yield cases of a motion at 100 frames per second, which most emulators take for a smooth one."""
    case = partial(Case, "motion", "a known motion to events, 100 frames per second", error_kind=KIND)
    for name in EMULATORS:
        yield case(partial(_ready, name, 100), settings={"emulator": name}, default=name == "DVS")
    for library in PEERS:
        yield case(partial(_peer, library, 100), library=library)


def _ready(name: str, rate: int) -> PreparedCase:
    return _compared(partial(EMULATORS[name].emulate, _frames(rate)), rate)


def _peer(library: str, rate: int) -> PreparedCase:
    return _compared(PEERS[library](_frames(rate), ON, OFF), rate)


def _frames(rate: int) -> list[VideoFrame]:
    return [VideoFrame(time, np.rint(scene(time)).astype(np.uint8)) for time in _times(1e6 / rate)]


def _compared(run: Callable[[], Any], rate: int) -> PreparedCase:
    exact = ideal().window(0, _times(1e6 / rate)[-1] + 1)
    return PreparedCase(
        run,
        lambda found: time_difference(_events(found), exact) / 1e3,
        counters=lambda found: {"percent of the ideal number of events": round(100 * len(_events(found)) / len(exact))},
    )


def _events(found: Any) -> Events:
    return found if isinstance(found, Events) else events_of(found, SIZE)


def _times(gap: float) -> list[int]:
    return [round(n * gap) for n in range(int(DURATION * 1e6 / gap + 1e-9) + 1)]


@cache
def ideal() -> Events:
    """Return the events of an ideal sensor: the scene at 10,000 frames per second in float64."""
    return DVS(on=ON, off=OFF).emulate([VideoFrame(time, scene(time)) for time in _times(FINE)])


def scene(time: int) -> np.ndarray:
    """Render the scene: a drifting texture, and a disk in front of it that moves in another direction.

    Args:
        time: Time in µs.

    Returns:
        Gray levels, float64 [96, 128].
    """
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    far = SPEED * time / 1e6
    u, v = x - far, y - 0.35 * far
    waves = np.sin(u / 5) + np.sin(u / 3.1 + v / 6.7 + 1) + np.sin(v / 4.3 - u / 9) + np.sin((u + v) / 2.6)
    outside = 1 / (1 + np.exp(2 * (12 - np.hypot(x - 20 - 0.65 * far, y - 70 + 0.6 * far))))
    return np.asarray(60 + outside * (50 + 95 * waves / 4))


def time_difference(found: Events, exact: Events) -> float:
    """Return the median difference in µs between the k-th ON or OFF events of the same pixel.

    Events without a counterpart are ignored. If no event has a counterpart, the result is infinite.
    """
    (ours, when), (theirs, then) = _ranked(found), _ranked(exact)
    _, i, j = np.intersect1d(ours, theirs, assume_unique=True, return_indices=True)
    return float(np.median(np.abs(when[i] - then[j]))) if i.size else np.inf


def _ranked(events: Events) -> tuple[np.ndarray, np.ndarray]:
    """Return for each event a key (its pixel, polarity, and rank among the events of both) and its time in µs."""
    place = pixel_index(events) * 2 + events.p
    order = np.lexsort((events.t, place))
    place = place[order]
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    rank = np.arange(place.size) - np.repeat(begins, np.diff(np.append(begins, place.size)))
    return place * (1 << 32) + rank, events.t[order]
