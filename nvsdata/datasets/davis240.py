"""What the datasets share that Bi et al. recorded from a monitor with a DAVIS240C."""

from __future__ import annotations

from nvsdata.data.recording import Recording
from nvsdata.data.views import FlippedY
from nvsdata.datasets.base import EventDataset


def google_drive(file: str) -> str:
    """Address of a file that its authors have on Google Drive, without the page that asks about viruses."""
    return f"https://drive.usercontent.google.com/download?id={file}&export=download&confirm=t"


class CountedFromBottom(EventDataset):
    """A dataset whose .mat files count y from the bottom of the sensor."""

    def _view(self, recording: Recording) -> Recording:
        return FlippedY(recording) if recording.format == "matlab" else recording
