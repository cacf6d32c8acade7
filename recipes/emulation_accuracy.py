"""Compare emulators with a real sensor, on pairs of frames and events that it recorded together.

    python recipes/emulation_accuracy.py slider_depth.npz street.aedat4 --out accuracy
    python recipes/emulation_accuracy.py street.aedat4 --v2e ../v2e      # with a checkout of v2e and its dependencies

A pair is a recording with frames, or an .npz file with frames uint8 [F, H, W], frame_times, t (µs), x, y and p.
Emulators are fitted and tuned on the first half of the frames (at least 3), and compared with the events of the second
half.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import nvsdata
from nvsdata import Events, metrics, plots
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import claimed, put
from nvsdata.common.text import aligned
from nvsdata.emulation import DVS, PIX2NVS, fit
from nvsdata.emulation.correlation import correlation, pixel_index
from nvsdata.emulation.fitting import event_intervals
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.search import search
from nvsdata.plots.sheets import side_by_side
from nvsdata.training import run
from nvsdata.video.frames import VideoFrame, frames_of

FLOW = DVS(upsample="flow")
DECILES = np.arange(0.1, 0.95, 0.1)
Emulate = Callable[[list[VideoFrame]], Events]


@dataclass(frozen=True)
class Row:
    """Comparison of an emulator with the sensor, on the part of a pair that wasn't used for fitting.

    Args:
        emulator: Name of the emulator.
        inverse: 1 - epsilon-repeatability from emulated to real events.
        chamfer: Chamfer distance from emulated to real events.
        emd: Earth mover's distance.
        inverse_back: 1 - epsilon-repeatability from real to emulated events.
        chamfer_back: Chamfer distance from real to emulated events.
        score: Score of `inverse`, `chamfer` and `emd` among the emulators of a pair.
        off: Number of OFF events relative to that of the sensor.
        on: Number of ON events relative to that of the sensor.
        correlation: Correlation of the numbers of events per pixel.
        intervals: Mean difference of the deciles of log10 of the intervals between events of a pixel.
        first: Median time in ms between the first events of a pixel and polarity after a frame.
        speed: Computing time in s per s of video.
    """

    emulator: str
    inverse: float
    chamfer: float
    emd: float
    inverse_back: float
    chamfer_back: float
    score: float
    off: float
    on: float
    correlation: float
    intervals: float
    first: float
    speed: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path, nargs="+", metavar="PAIR", help="recordings with frames, or .npz files")
    parser.add_argument(
        "--out", type=Path, default=Path("accuracy"), help="folder for tables and images (default accuracy)"
    )
    parser.add_argument(
        "--trials", type=at_least_1, default=100, help="trials of the search for settings of PIX2NVS (default 100)"
    )
    parser.add_argument(
        "--v2e",
        type=Path,
        metavar="DIR",
        help="compare with v2e, too, in this checkout of https://github.com/SensorsINI/v2e",
    )
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    with claimed(args.out):
        for path in args.pairs:
            rows = compare_emulators(path, args)
            text = f"{path.name}\n{table(rows)}\n"
            print(text, flush=True)
            put(args.out / f"{path.stem}.txt", text.encode())
            put(args.out / f"{path.stem}.json", json.dumps([asdict(row) for row in rows], indent=1).encode())


def compare_emulators(path: Path, args: argparse.Namespace) -> list[Row]:
    """Return a row for each emulator; write an image of the fitted one next to the sensor."""
    frames, events = read_pair(path)
    seen = max(len(frames) // 2, 3)
    if len(frames) <= seen:
        raise ValueError(f"{path}: {len(frames)} frames, at least {seen + 1} are needed to fit and to test")
    fitted = fit(frames[:seen], events, base=FLOW, noise=False)
    noisy = fit(frames[:seen], events, base=FLOW, delay=fitted.delay)
    train, known = part(frames[:seen], events, fitted.delay)
    test, real = part(frames[seen - 1 :], events, fitted.delay)
    journal = args.out / f"{path.stem}-trials.jsonl"
    tuned = search(
        TuningPair(known, train), trials=args.trials, journal=journal, note={"pair": str(path)}
    ).best.settings
    emulators: dict[str, Emulate] = {
        "PIX2NVS": PIX2NVS().emulate,
        "PIX2NVS, tuned": tuned.emulate,
        "textbook pixel": textbook(train, known).emulate,
        "DVS": DVS().emulate,
        "DVS, fitted": fitted.settings.emulate,
        "DVS, fitted with noise": noisy.settings.emulate,
        **({"v2e": v2e(args.v2e)} if args.v2e else {}),
    }
    print(
        f"{path.name}: events lag frames by {fitted.delay} µs; {fitted.settings}; unidentified: {fitted.unidentified}"
    )
    plots.save_png(side_by_side(fitted.settings.emulate(test), real, 1e6 / test[1].time), args.out / f"{path.stem}.png")
    rows = [measure(name, emulate, test, real) for name, emulate in emulators.items()]
    scores = metrics.score([(row.inverse, row.chamfer, row.emd) for row in rows])
    return [replace(row, score=float(score)) for row, score in zip(rows, scores, strict=True)]


def read_pair(path: Path) -> tuple[list[VideoFrame], Events]:
    """Read frames and events with times in the same clock."""
    if path.suffix != ".npz":
        recording = nvsdata.open(path)
        return list(frames_of(recording)), recording.read()
    with np.load(path) as data:
        frames = [VideoFrame(int(t), still) for t, still in zip(data["frame_times"], data["frames"], strict=True)]
        height, width = data["frames"].shape[1:]
        return frames, Events(data["t"], data["x"], data["y"], data["p"], (width, height))


def part(frames: list[VideoFrame], events: Events, delay: int) -> tuple[list[VideoFrame], Events]:
    """Return frames and the events between them, with times that begin at 0."""
    start, last = frames[0].time, frames[-1].time - frames[0].time
    inside = slice(*np.searchsorted(events.t, (start + delay, start + delay + last)))
    t, x, y, p = (column[inside] for column in events.columns)
    between = Events(t - start - delay, x, y, p, events.sensor_size, start=0, end=last)
    return [frame._replace(time=frame.time - start) for frame in frames], between


def textbook(frames: list[VideoFrame], real: Events) -> DVS:
    """Return a DVS with one threshold for both polarities and as many events as the sensor."""
    low, high = 0.01, 3.0
    while high / low > 1.001:
        middle = (low * high) ** 0.5
        fires_more = len(DVS(on=middle, off=middle).emulate(frames)) > len(real)
        low, high = (middle, high) if fires_more else (low, middle)
    return DVS(on=low, off=low)


def v2e(folder: Path) -> Emulate:
    """Return v2e's emulator with default settings: thresholds 0.2 +- 0.03, leak rate 0.1 Hz."""
    sys.path.insert(0, str(folder.resolve()))
    from v2ecore.emulator import EventEmulator

    def emulate(frames: list[VideoFrame]) -> Events:
        height, width = frames[0].pixels.shape[:2]
        emulator = EventEmulator(device="cpu", output_width=width, output_height=height)
        found = [emulator.generate_events(frame.pixels.astype(np.float32), frame.time / 1e6) for frame in frames]
        rows = np.concatenate([some for some in found if some is not None and len(some)])
        t, x, y, p = rows[np.argsort(rows[:, 0], kind="stable")].T
        return Events(np.rint(t * 1e6).astype(np.int64), x.astype(int), y.astype(int), p > 0, (width, height))

    return emulate


def measure(name: str, emulate: Emulate, frames: list[VideoFrame], real: Events) -> Row:
    """Return the row of an emulator; its time is the shortest of three, because the first call may compile."""
    times = []
    for _ in range(3):
        started = time.perf_counter()
        found = emulate(frames)
        times.append(time.perf_counter() - started)
    seconds = frames[-1].time / 1e6
    compared = metrics.compare(found, real, (len(frames) - 1) / seconds)
    inverse, chamfer, emd = compared.values
    ours, theirs = (np.bincount(events.p, minlength=2) for events in (found, real))
    off, on = ours / np.maximum(theirs, 1)
    return Row(
        name, inverse, chamfer, emd, 1 - compared.repeatability_back.value, compared.chamfer_back.value, 0.0, off, on,
        correlation(found, real), interval_difference(found, real), first_event_difference(found, real, frames),
        min(times) / seconds,
    )  # fmt: skip


def interval_difference(ours: Events, real: Events) -> float:
    """Return the mean difference of the deciles of log10 of the intervals within pixels."""
    deciles = []
    for events in (ours, real):
        gaps = event_intervals(events)
        deciles.append(np.quantile(np.log10(np.maximum(gaps, 1)), DECILES) if gaps.size else np.full(9, np.nan))
    return float(np.abs(deciles[0] - deciles[1]).mean())


def first_event_difference(ours: Events, real: Events, frames: list[VideoFrame]) -> float:
    """Return the median ms between the first events of a pixel and polarity after a frame, where both have one."""
    edges = [frame.time for frame in frames]
    keys, times = zip(*(first_events(events, edges) for events in (ours, real)), strict=True)
    _, i, j = np.intersect1d(*keys, return_indices=True)
    return float(np.median(np.abs(times[0][i] - times[1][j]))) / 1e3 if i.size else float("nan")


def first_events(events: Events, edges: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return a key of each pixel, polarity and frame with events, and the time of its first event."""
    key = (np.searchsorted(edges, events.t, side="right") * 2 + events.p) * np.prod(events.sensor_size) + pixel_index(
        events
    )
    found, where = np.unique(key, return_index=True)
    return found, events.t[where]


def table(rows: list[Row]) -> str:
    """Return the rows as a table."""
    head = ("", "Inv. e-rep", "Chamfer", "EMD", "back: inv.", "Chamfer", "Score", "OFF", "ON", "r", "intervals")
    lines: list[tuple[str, ...]] = [(*head, "first ms", "s/s")]
    lines += [(row.emulator, *_figures(row)) for row in rows]
    return aligned(lines)


def _figures(row: Row) -> Iterator[str]:
    return map("{:.3f}".format, list(asdict(row).values())[1:])


if __name__ == "__main__":
    run(main, "run the command again to continue")
