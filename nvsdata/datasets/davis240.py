"""Shared by the datasets that Bi et al. recorded from a monitor with a DAVIS240C."""

from __future__ import annotations

from nvsdata.data.recording import Recording
from nvsdata.data.views import FlippedY
from nvsdata.datasets.base import EventDataset


def google_drive(file: str) -> str:
    """Address of a file on Google Drive that skips the page about virus scanning."""
    return f"https://drive.usercontent.google.com/download?id={file}&export=download&confirm=t"


class CountedFromBottom(EventDataset):
    """A dataset whose .mat files count y from the bottom of the sensor."""

    def _view(self, recording: Recording) -> Recording:
        return FlippedY(recording) if recording.format == "matlab" else recording
