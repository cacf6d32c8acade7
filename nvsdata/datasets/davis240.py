"""What the datasets share that Bi et al. recorded from a monitor with a DAVIS240C."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nvsdata.data.events import Columns, Events, Recording
from nvsdata.data.views import Mapped
from nvsdata.datasets.base import EventDataset


def google_drive(file: str) -> str:
    """Address of a file that its authors have on Google Drive, without the page that asks about viruses."""
    return f"https://drive.usercontent.google.com/download?id={file}&export=download&confirm=t"


class Upright(EventDataset):
    """A dataset whose .mat files count y from the bottom; it is turned where they are read."""

    def _view(self, recording: Recording) -> Recording:
        if recording.format != "matlab":
            return recording
        # a packed store turns them while it reads them
        turned: Callable[[], Recording] | None = getattr(recording, "upright", None)
        return Mapped(recording, upright) if turned is None else turned()


def upright(events: Events) -> Events:
    """Events whose y was counted from the bottom of the sensor, counted from the top."""
    y = np.subtract(np.int16(events.sensor_size[1] - 1), events.y)
    return events.of(Columns(events.t, events.x, y, events.p))
