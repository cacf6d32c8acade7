"""AEDAT 4 (iniVation DV), by the package `aedat` (extra `aedat4`): packets compressed by LZ4 or ZSTD.

Only the first stream of events is read. The packets of a file are read one after the other, so a
window decodes the whole file.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nvsdata.errors import FormatError
from nvsdata.events import Columns, empty_columns
from nvsdata.events import Recording as BaseRecording


class Recording(BaseRecording):
    """An AEDAT 4 file."""

    format = "aedat4"

    def __init__(self, path: str, sensor_size: tuple[int, int] | None, head: bytes, strict: bool) -> None:
        super().__init__(path, sensor_size, strict)
        stream = next((s for s in self._decoder().id_to_stream().values() if s["type"] == "events"), None)
        if stream is None:
            raise FormatError(path, None, "AEDAT 4 without a stream of events")
        self._size = self._size or (stream["width"], stream["height"])

    def _decoder(self) -> Any:
        try:
            import aedat
        except ImportError as error:
            raise ImportError(
                f"{self.path}: reading AEDAT 4 needs the package aedat: pip install 'nvsdata[aedat4]'"
            ) from error
        try:
            return aedat.Decoder(self.path)
        except BaseException as error:
            raise self._fault(error) from error

    def _fault(self, error: BaseException) -> BaseException:
        """What to raise: the package panics on damage, which Python sees as no Exception."""
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            return error
        return FormatError(self.path, None, f"damaged AEDAT 4: {error}")

    def _decode(self) -> Columns:
        parts = []
        try:
            for packet in self._decoder():
                if "events" in packet:
                    parts.append(packet["events"])
        except BaseException as error:
            fault = self._fault(error)
            if self.strict or not isinstance(fault, FormatError):
                raise fault from error
            self._repair("packets from the first damaged one on, cut off", 1)
        if not parts:
            return empty_columns()
        events = np.concatenate(parts)
        width, height = self.sensor_size
        x, y = events["x"].astype(np.int64), events["y"].astype(np.int64)
        bad = (x >= width) | (y >= height)
        if bad.any() and self.strict:
            reason = f"event {int(np.argmax(bad))}: coordinates outside the sensor of {width}x{height}"
            raise FormatError(self.path, None, reason)
        return Columns(
            events["t"].astype(np.int64), x.astype(np.int16), y.astype(np.int16), events["on"].astype(np.uint8)
        )
