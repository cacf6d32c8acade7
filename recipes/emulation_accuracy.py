"""Compare emulators with a real sensor, on pairs of frames and events that it recorded together.

    python recipes/emulation_accuracy.py slider_depth.npz street.aedat4 --out accuracy
    python recipes/emulation_accuracy.py street.aedat4 --v2e ../v2e      # with a checkout of v2e and its dependencies

A pair is a recording with frames, or an .npz file with frames uint8 [F, H, W], frame_times, t (µs), x, y and p.
Emulators are fitted and tuned on the first half of the frames (at least 3), and compared with the events of the last
half; then the halves are swapped. A part is a quarter of the sensor between two frames. Figures are of all parts that
weren't used for fitting, with 95% intervals by a bootstrap over parts.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from pairs import read_arrays

import nvsdata
from nvsdata import Events, metrics, plots
from nvsdata.common.files import claimed, put
from nvsdata.common.text import aligned
from nvsdata.emulation import DVS, PIX2NVS, Fit, fit
from nvsdata.emulation.correlation import count_images, pixel_index
from nvsdata.emulation.imperfection_fit import event_intervals
from nvsdata.emulation.thresholds import match_thresholds, polarity_counts
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.search import search
from nvsdata.plots.sheets import side_by_side
from nvsdata.training import run
from nvsdata.video.frames import VideoFrame, frames_of
from nvsdata.video.upsample import upsample_frames

FITTED = "DVS, fitted"
DECILES = np.arange(0.1, 0.95, 0.1)
SAMPLES = 2_000  # of a bootstrap
HIGHER_IS_BETTER = ("correlation",)
COUNTS = ("off", "on")
Emulate = Callable[[list[VideoFrame]], Events]


@dataclass(frozen=True)
class Row:
    """Comparison of an emulator with the sensor, on the parts of a pair that weren't used for fitting.

    Args:
        emulator: Name of the emulator.
        figures: Samples of each figure by name; the first sample is all parts.

            - inverse, chamfer: 1 - epsilon-repeatability, and Chamfer distance, from emulated to real events
            - inverse_back, chamfer_back: the same from real to emulated events
            - off, on: number of events relative to that of the sensor
            - correlation: of the numbers of events per pixel
            - intervals: mean difference of the deciles of log10 of the intervals between events of a pixel
            - first: median time in ms between the first events of a pixel and polarity after a frame
    """

    emulator: str
    figures: dict[str, np.ndarray]

    def summary(self) -> dict[str, Any]:
        """Return each figure with the limits of its 95% interval."""
        ends = {name: np.nanquantile(samples[1:], (0.025, 0.975)) for name, samples in self.figures.items()}
        return {name: [float(samples[0]), *ends[name].tolist()] for name, samples in self.figures.items()}

    def worse(self, other: Row) -> list[str]:
        """Return the figures that are worse than those of another emulator, by the interval of their difference."""
        found = []
        for name, samples in self.figures.items():
            ours, theirs = samples, other.figures[name]
            if name in COUNTS:
                ours, theirs = np.abs(np.log(ours)), np.abs(np.log(theirs))
            more = theirs - ours if name in HIGHER_IS_BETTER else ours - theirs
            if np.nanquantile(more[1:], 0.025) > 0:
                found.append(name)
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path, nargs="+", metavar="PAIR", help="recordings with frames, or .npz files")
    parser.add_argument(
        "--out", type=Path, default=Path("accuracy"), help="folder for tables and images (default accuracy)"
    )
    parser.add_argument(
        "--trials",
        type=int,
        default=100,
        help="trials of the search for settings of PIX2NVS (default 100); 0 leaves it out",
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
            facts = [{"emulator": row.emulator, **row.summary()} for row in rows]
            put(args.out / f"{path.stem}.json", json.dumps(facts, indent=1).encode())


def compare_emulators(path: Path, args: argparse.Namespace) -> list[Row]:
    """Return a row for each emulator; write an image of the fitted one next to the sensor."""
    frames, events = read_pair(path)
    seen, count = max(len(frames) // 2, 3), len(frames)
    if count <= seen:
        raise ValueError(f"{path}: {count} frames, at least {seen + 1} are needed to fit and to test")
    halves = {
        "first": (slice(0, seen), slice(seen - 1, count)),
        "last": (slice(count - seen, count), slice(0, count - seen + 1)),
    }
    measured: dict[str, list[dict[str, Any]]] = {}
    for name, (known, unknown) in halves.items():
        found = fit(frames[known], events, base=DVS(upsample="flow"), noise=False)
        test, real = part(frames[unknown], events, found.delay)
        journal = args.out / f"{path.stem}-{name}-trials.jsonl"
        for emulator, emulate in emulators(frames[known], events, found, args, journal).items():
            emulated = emulate(test)
            measured.setdefault(emulator, []).extend(measure_parts(emulated, real, test))
            if emulator == FITTED:
                print(f"{path.name}, {name} half: {describe(found, emulated, real)}", flush=True)
                image = side_by_side(emulated, real, 1e6 / test[1].time)
                plots.save_png(image, args.out / f"{path.stem}-{name}.png")
    return [Row(emulator, bootstrap(parts)) for emulator, parts in measured.items()]


def describe(found: Fit, emulated: Events, real: Events) -> str:
    """Describe a fit and its numbers of events on the other half."""
    values = {name: getattr(found.settings, name) for name in ("on", "off", "dark")} | {"delay": found.delay}
    parts = ["{} {:.4g} ({:.4g} to {:.4g})".format(name, values[name], *ends) for name, ends in found.intervals.items()]
    parts += [f"no {name}: {reason}" for name, reason in found.unidentified.items()]
    off, on = polarity_counts(emulated) / np.maximum(polarity_counts(real), 1)
    return ", ".join((*parts, f"{off:.3f} times the sensor's OFF events and {on:.3f} times its ON events elsewhere"))


def emulators(
    frames: list[VideoFrame], events: Events, found: Fit, args: argparse.Namespace, journal: Path
) -> dict[str, Emulate]:
    """Return the emulators by name, fitted to frames and events; `found` is the fit of DVS without noise."""
    train, known = part(frames, events, found.delay)
    dark = found.settings.dark
    noisy = fit(frames, events, base=DVS(upsample="flow"), delay=found.delay)
    unwarped = fit(frames, events, base=DVS(), delay=found.delay, noise=False)
    settings: dict[str, Any] = {"PIX2NVS": PIX2NVS()}
    if args.trials:
        pair = TuningPair(known, train)
        settings["PIX2NVS, tuned"] = search(
            pair, trials=args.trials, journal=journal, note={"pair": journal.stem}
        ).best.settings
    settings |= {
        "DVS, not fitted": DVS(),
        "one threshold": one_threshold(train, known, DVS()),
        "one threshold, dark, flow": one_threshold(train, known, DVS(dark=dark, upsample="flow")),
        "thresholds": thresholds(train, known, DVS()),
        "thresholds, flow": thresholds(train, known, DVS(upsample="flow")),
        "thresholds, dark": unwarped.settings,
        FITTED: found.settings,
        "DVS, fitted with noise": noisy.settings,
    }
    return {name: one.emulate for name, one in settings.items()} | ({"v2e": v2e(args.v2e)} if args.v2e else {})


def read_pair(path: Path) -> tuple[list[VideoFrame], Events]:
    """Read frames and events with times in the same clock."""
    if path.suffix != ".npz":
        recording = nvsdata.open(path)
        return list(frames_of(recording)), recording.read()
    frames, times, events = read_arrays(path)
    return [VideoFrame(int(t), still) for t, still in zip(times, frames, strict=True)], events


def part(frames: list[VideoFrame], events: Events, delay: int) -> tuple[list[VideoFrame], Events]:
    """Return frames and the events between them, with times that begin at 0."""
    start, last = frames[0].time, frames[-1].time - frames[0].time
    inside = slice(*np.searchsorted(events.t, (start + delay, start + delay + last)))
    t, x, y, p = (column[inside] for column in events.columns)
    between = Events(t - start - delay, x, y, p, events.sensor_size, start=0, end=last)
    return [frame._replace(time=frame.time - start) for frame in frames], between


def thresholds(frames: list[VideoFrame], real: Events, base: DVS) -> DVS:
    """Return `base` with the thresholds that give as many events as the sensor."""
    more = list(upsample_frames(iter(frames), base.upsample))
    both = np.array([True, True])
    found, _ = match_thresholds(replace(base, upsample="none"), more, polarity_counts(real), both)
    return replace(found, upsample=base.upsample)


def one_threshold(frames: list[VideoFrame], real: Events, base: DVS) -> DVS:
    """Return `base` with one threshold for both polarities that gives as many events as the sensor."""
    more = list(upsample_frames(iter(frames), base.upsample))
    low, high = 0.01, 3.0
    while high / low > 1.001:
        middle = (low * high) ** 0.5
        fires_more = len(replace(base, on=middle, off=middle, upsample="none").emulate(more)) > len(real)
        low, high = (middle, high) if fires_more else (low, middle)
    return replace(base, on=low, off=low)


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


def measure_parts(found: Events, real: Events, frames: list[VideoFrame]) -> list[dict[str, Any]]:
    """Measure each part, a quarter of the sensor in one interval between frames; return the input of `bootstrap`."""
    width, height = real.sensor_size
    columns, rows = pairwise((0, width // 2, width)), pairwise((0, height // 2, height))
    times = pairwise(frame.time for frame in frames)
    boxes = product(times, list(columns), list(rows))
    return [measure(*(cut(events, *box) for events in (found, real))) for box in boxes]


def cut(events: Events, times: tuple[int, int], columns: tuple[int, int], rows: tuple[int, int]) -> Events:
    """Return the events of a part, with times and coordinates from 0 on."""
    t, x, y, p = (column[slice(*np.searchsorted(events.t, times))] for column in events.columns)
    kept = (x >= columns[0]) & (x < columns[1]) & (y >= rows[0]) & (y < rows[1])
    size = columns[1] - columns[0], rows[1] - rows[0]
    columns_kept = t[kept] - times[0], x[kept] - columns[0], y[kept] - rows[0], p[kept]
    return Events(*columns_kept, size, start=0, end=times[1] - times[0])


def measure(found: Events, real: Events) -> dict[str, Any]:
    """Return distances and numbers of events of a part, and the sums from which the correlation is computed."""
    a, b = (count_images(events).sum(axis=0) for events in (found, real))
    return {
        "inverse": 1 - metrics.epsilon_repeatability(found, real).value,
        "chamfer": metrics.chamfer(found, real).value,
        "inverse_back": 1 - metrics.epsilon_repeatability(real, found).value,
        "chamfer_back": metrics.chamfer(real, found).value,
        "counts": np.stack((polarity_counts(found), polarity_counts(real))),
        "sums": np.array([a.size, a.sum(), b.sum(), (a * a).sum(), (b * b).sum(), (a * b).sum()]),
        "intervals": interval_difference(found, real),
        "first": first_event_difference(found, real),
    }


def bootstrap(parts: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return bootstrap samples of the figures over all parts; the first sample contains each part once.

    Distances are means over parts, weighted by the numbers of events from which they are measured; the last two figures
    are weighted by the sensor's numbers of events.
    """
    number = len(parts)
    drawn = np.random.default_rng(0).integers(0, number, (SAMPLES, number))
    which = np.vstack((np.arange(number), drawn))

    each = np.stack([one["counts"] for one in parts])

    def mean(name: str, side: int) -> np.ndarray:
        values = np.array([one[name] for one in parts])
        # of events, so that parts with few of them count little
        weights = np.where(np.isnan(values), 0, each[:, side].sum(axis=1))
        return (np.nan_to_num(values) * weights)[which].sum(axis=1) / np.maximum(weights[which].sum(axis=1), 1)

    counts = each[which].sum(axis=1)
    off, on = (np.maximum(counts[:, 0, p], 0.5) / np.maximum(counts[:, 1, p], 0.5) for p in (0, 1))
    n, x, y, xx, yy, xy = np.stack([one["sums"] for one in parts])[which].sum(axis=1).T
    scale = np.sqrt(np.maximum((xx - x * x / n) * (yy - y * y / n), 1e-12))
    return {
        "inverse": mean("inverse", 0),
        "chamfer": mean("chamfer", 0),
        "inverse_back": mean("inverse_back", 1),
        "chamfer_back": mean("chamfer_back", 1),
        "off": off,
        "on": on,
        "correlation": (xy - x * y / n) / scale,
        "intervals": mean("intervals", 1),
        "first": mean("first", 1),
    }


def interval_difference(ours: Events, real: Events) -> float:
    """Return the mean difference of the deciles of log10 of the intervals within pixels."""
    deciles = []
    for events in (ours, real):
        gaps = event_intervals(events)
        deciles.append(np.quantile(np.log10(np.maximum(gaps, 1)), DECILES) if gaps.size else np.full(9, np.nan))
    return float(np.abs(deciles[0] - deciles[1]).mean())


def first_event_difference(ours: Events, real: Events) -> float:
    """Return the median difference in ms between first events of the same pixel and polarity, where both have one."""
    keys, times = zip(*(first_events(events) for events in (ours, real)), strict=True)
    _, i, j = np.intersect1d(*keys, return_indices=True)
    return float(np.median(np.abs(times[0][i] - times[1][j]))) / 1e3 if i.size else float("nan")


def first_events(events: Events) -> tuple[np.ndarray, np.ndarray]:
    """Return a key of each pixel and polarity with events, and the time of its first event."""
    found, where = np.unique(pixel_index(events) * 2 + events.p, return_index=True)
    return found, events.t[where]


def table(rows: list[Row]) -> str:
    """Return the rows as a table: figures with their intervals, and what is worse than with the fitted DVS."""
    fitted = next(row for row in rows if row.emulator == FITTED)
    lines: list[tuple[str, ...]] = [("", *fitted.figures, "worse than fitted in")]
    for row in rows:
        figures = ["{:.3g} ({:.3g}, {:.3g})".format(*values) for values in row.summary().values()]
        lines.append((row.emulator, *figures, ", ".join(row.worse(fitted))))
    return aligned(lines)


if __name__ == "__main__":
    run(main, "run the command again to continue")
