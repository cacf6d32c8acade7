"""Measure the throughput of recording: of the stream decoder, and from a simulated camera to a file.

    python recipes/bench/recording.py --stream real_everything.bin --seconds 60 --out recording.json

The simulated camera replays a prepared stream at --rate events/s, in reads of up to 64 KiB. Data that overflows its
FIFO of 4 MB is dropped and counted, and so is data for which the recorder has no buffer. No USB bus is involved.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import tempfile
import time
from pathlib import Path
from threading import Event, Timer
from typing import Any

import numpy as np

import nvsdata
from nvsdata.kernels.recording.davis_stream import encode
from nvsdata.recording.capture import record
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.davis.stream import DavisDecoder
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.usb_backend import Backend

PERIOD = 1 << 15  # µs between wraps of the camera's clock
FIFO = 1 << 22  # capacity in bytes
Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stream", type=Path, help="file with the byte stream of a DAVIS240, for the decoder")
    parser.add_argument("--rate", type=float, default=12e6, help="events/s (default 12 million)")
    parser.add_argument("--seconds", type=float, default=60, help="duration of the recording in s (default 60)")
    parser.add_argument("--folder", type=Path, help="folder for the recording (default: the system's temporary folder)")
    parser.add_argument("--out", type=Path, help="JSON file for the results")
    args = parser.parse_args()
    rows = [decoding(args.stream, piece) for piece in (1 << 16, 1 << 20)] if args.stream else []
    rows += [recording(rate, seconds, args.folder) for rate, seconds in ((1e6, 5.0), (args.rate, args.seconds))]
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1))


def decoding(path: Path, piece: int) -> Row:
    """Measure the events/s of the decoder on one core; the stream is decoded twenty times."""
    data = memoryview(path.read_bytes())
    decoder, events, spent = DavisDecoder(240, 180), 0, []
    for _ in range(20):
        start = time.perf_counter()
        found = sum(len(decoder.feed(data[a : a + piece])) for a in range(0, len(data), piece))
        spent.append((time.perf_counter() - start) / found)
        events += found
    middle = float(np.median(spent))
    return {"what": f"decode, pieces of {piece >> 10} KiB", "million events/s": round(1 / middle / 1e6, 1), "aim": 60}


class Replay(SimulatedDavis):
    """Simulated camera that sends the same data every 32.768 ms, ending with a wrap of the clock."""

    def __init__(self, rate: float) -> None:
        super().__init__(speed=0)
        count = round(rate * PERIOD / 1e6)
        rng = np.random.default_rng(0)
        t = np.sort(rng.integers(0, PERIOD, count))
        words = np.empty(4 * count + 8, "<u2")
        # events of the same time are in the same row, as the sensor reads them
        y = rng.integers(0, 180, PERIOD)[t]
        used = encode(t, rng.integers(0, 240, count), y, rng.integers(0, 2, count), np.array([0, -1, -1]), words)
        words[used] = 0x7001
        self.data = words[: used + 1].tobytes()
        self.per_second = len(self.data) * 1e6 / PERIOD
        self.began: float | None = None
        self.sent = self.overrun = 0

    def bulk(self, buffer: Any) -> int:
        if not self._streams() or self._fifo:
            return super().bulk(buffer)
        self.began = self.began or time.perf_counter()
        made = int((time.perf_counter() - self.began) * self.per_second) // 2 * 2
        if made - self.sent > FIFO:
            self.overrun += made - self.sent - FIFO
            self.sent = made - FIFO
        count = min(len(buffer), made - self.sent)
        if count < self.per_second / 1e3:
            # a packet that isn't full is sent after one millisecond
            time.sleep(0.001)
            return 0
        at = self.sent % len(self.data)
        count = min(count, len(self.data) - at)
        memoryview(buffer)[:count] = memoryview(self.data)[at : at + count]
        self.sent += count
        return count


def recording(rate: float, seconds: float, folder: Path | None) -> Row:
    """Measure the recording of a simulated camera's events into an HDF5 file: lost data, CPU use and file size."""
    camera = Replay(rate)
    with tempfile.TemporaryDirectory(dir=folder) as place, Davis.find(backend=Backend(camera)) as davis:
        before, start = os.times(), time.perf_counter()
        stop, asked = Event(), []
        timer = Timer(seconds, lambda: (asked.append(time.perf_counter()), stop.set()))
        timer.start()
        report = record(davis, Path(place) / "a.h5", stop=stop)
        ended, after = time.perf_counter(), os.times()
        spent = ended - start
        size = (Path(place) / "a.h5").stat().st_size
        span = nvsdata.open(Path(place) / "a.h5").span
    cpu = after.user + after.system - before.user - before.system
    return {
        "what": f"record {rate / 1e6:g} million events/s for {seconds:g} s",
        "events": report.events,
        "expected": round(rate * (span[1] - span[0]) / 1e6),
        "overrun_bytes": camera.overrun,
        "lost_bytes": report.lost,
        "cores": round(cpu / spent, 2),
        "stopping_s": round(ended - asked[0], 2),
        "file_MB": round(size / 1e6),
        "peak_MB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
    }


if __name__ == "__main__":
    main()
