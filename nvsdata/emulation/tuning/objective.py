"""What tuning minimizes: distances of emulated events to a real recording of the same video; a table of trials."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import fields
from functools import cache, partial
from itertools import takewhile

import numpy as np

from nvsdata.common.tables import aligned
from nvsdata.data.events import Events
from nvsdata.data.recording import Recording
from nvsdata.emulation.protocol import EventEmulator
from nvsdata.emulation.settings import Settings
from nvsdata.emulation.tuning.search import Search
from nvsdata.metrics.distance import compare
from nvsdata.video.frames import Frame, Video, frames_of

# of Table 3.3: settings and their headings
SHOWN = {"t_log": "T_log", "inhibition": "B", "max_events": "M_max", "threshold": "T_map", "new": "new", "exp": "exp"}
SHOWN |= {"alpha": "alpha"}
MEASURED = ("Inv. e-rep", "Chamfer", "EMD", "Score")


class Pair:
    """A real recording and the frames of the video it shows, scaled to its sensor; calling it measures settings.

    The frame rate of the comparison is the video's. The frames are kept in memory.

    - `real`: events of a camera that saw the video
    - `video`: as `PIX2NVS.stream` takes it
    - `fps`: frames per second, whatever the video says (default: as it says)
    - `seconds`: compare the first seconds only (default: all)
    - `offset`: µs that are added to the recording's times, which count from its start (default 0)

    ValueError if fewer than two frames fall within the time.
    """

    def __init__(
        self,
        real: Events | Recording,
        video: Video,
        *,
        fps: float | None = None,
        seconds: float | None = None,
        offset: int = 0,
    ) -> None:
        end = np.inf if seconds is None else seconds * 1e6
        size = real.sensor_size

        def load(color: bool) -> list[Frame]:
            return list(takewhile(lambda f: f.time <= end, frames_of(video, fps=fps, size=size, color=color)))

        self.frames = load(color=False)
        # only hue, which few settings ask for, needs a file's colors; arrays have them already
        of_file = isinstance(video, str | os.PathLike)
        self._colored: Callable[[], list[Frame]] = cache(partial(load, True)) if of_file else lambda: self.frames
        if len(self.frames) < 2:
            raise ValueError(f"{video}: {len(self.frames)} frames in the time that counts, at least 2 are needed")
        last = self.frames[-1].time
        self.fps = (len(self.frames) - 1) * 1e6 / last
        self.offset = offset
        cut = real.read if isinstance(real, Recording) else real.window
        self.real = cut(real.start, real.start + max(last - offset, 1))

    def emulate(self, settings: EventEmulator) -> Events:
        """Events of the video by these settings."""
        return settings.emulate(self._colored() if getattr(settings, "hue", False) else self.frames)

    def __call__(self, settings: EventEmulator) -> tuple[float, float, float]:
        """Distances of these settings: 1 - repeatability, Chamfer, EMD.

        NaN if more than half of the frames with real spikes have no emulated one: the distances go from
        emulated spikes to real ones only, so settings that hardly ever fire would win.
        """
        found = compare(self.emulate(settings), self.real, self.fps, offset=self.offset)
        real = found.emd.frames.size - found.emd.empty_real
        return found.values if 2 * found.emd.used >= max(real, 1) else (math.nan, math.nan, math.nan)


def table(search: Search, rows: int = 5) -> str:
    """`rows` trials at most, from the worst to the best at even steps of rank, in the columns of Table 3.3, or those
    of another emulator's settings."""
    scores = search.scores
    ranked = [i for i in np.argsort(-scores, kind="stable") if np.isfinite(scores[i])]
    chosen = [ranked[round(i)] for i in np.linspace(0, len(ranked) - 1, min(rows, len(ranked)))]
    kind = search.best.settings
    shown = SHOWN if isinstance(kind, Settings) else {field.name: field.name for field in fields(kind)}
    lines: list[tuple[str, ...]] = [(*shown.values(), *MEASURED)]
    for i in chosen:
        trial = search.trials[i]
        values = [_short(getattr(trial.settings, name)) for name in shown]
        lines.append((*values, *(f"{value:.3f}" for value in (*trial.distances, scores[i]))))
    return aligned(lines)


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
