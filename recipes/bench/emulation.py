"""Speed and accuracy of PIX2NVS and of the metrics.

    python recipes/bench/emulation.py --video bikes.mp4 --out emulation.json

Times are medians over rounds in which ours and the reference take turns. Recordings are written
to --scratch (default: the system's temporary folder) and flushed before each round, so that one
round's writing doesn't slow the next. POT is measured if it is installed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from racing import race
from scipy.spatial import cKDTree

import nvsdata
from nvsdata import PIX2NVS
from nvsdata.emulation.emulator import Emulator
from nvsdata.kernels.distances import nearest
from nvsdata.kernels.earth_mover import least_work
from nvsdata.video.frames import Frame

Row = dict[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--video", type=Path, required=True)
    parser.add_argument("--scratch", type=Path, help="folder for recordings")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(dir=args.scratch) as home:
        place = Path(home)
        parts = (
            lambda: converting("the video", args.video, place),
            lambda: converting("a clip in which under 2% of the pixels fire", sparse_clip(place / "sparse.avi"), place),
            lambda: emulating(args.video),
            lambda: still_scene(),
            lambda: jobs(args.video, place),
            lambda: memory(args.video, place),
            lambda: nearest_spikes(),
            lambda: transport(),
        )
        for row in (row for part in parts for row in part()):
            print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)
            rows.append(row)
    if args.out:
        args.out.write_text(json.dumps(rows, indent=1))


def decode(video: Path) -> int:
    """Decode by OpenCV alone; returns the number of frames."""
    capture, count = cv2.VideoCapture(str(video)), 0
    while capture.read()[0]:
        count += 1
    return count


def converting(name: str, video: Path, home: Path) -> list[Row]:
    """Convert to HDF5, flushed to the disk as always, compared with bare decoding."""
    target = home / "events.h5"

    def convert() -> None:
        nvsdata.write(PIX2NVS().stream(video), target)

    def settle() -> None:
        target.unlink(missing_ok=True)
        os.sync()

    times = race({"decode": lambda: decode(video), "convert": convert}, before=settle)
    convert()
    events, frames = nvsdata.read(target), decode(video)
    per_pixel = len(set_pixels(events)) / frames / (events.sensor_size[0] * events.sensor_size[1])
    return [
        {"what": f"convert {name}", "events": len(events), "MB": round(target.stat().st_size / 1e6, 1)}
        | {"share_of_pixels_that_fire": round(per_pixel, 4)}
        | {f"{key}_s": round(value, 3) for key, value in times.items()}
        | {"ratio": round(times["convert"] / times["decode"], 2)}
    ]


def set_pixels(events: nvsdata.Events) -> np.ndarray:
    """Distinct pairs of pixel and 40 ms frame."""
    frame = np.maximum(events.t - 1, 0) // 40_000
    return np.unique((frame << 32) | (events.y.astype(np.int64) << 16) | events.x)


def sparse_clip(path: Path) -> Path:
    """Write a video of a small object that moves over a still, textured background."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(30, 220, (272, 640, 3), dtype=np.uint8), (0, 0), 2)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25, (640, 272))
    for n in range(250):
        frame = ground.copy()
        cv2.circle(frame, (20 + 2 * n, 130 + round(60 * np.sin(n / 20))), 14, (250, 250, 250), -1)
        writer.write(frame)
    writer.release()
    return path


def emulating(video: Path) -> list[Row]:
    """From frames in memory, as the file gives them, to events: on one core, and with overlapping stages."""
    frames = decoded(video, color=False)
    pixels = frames[0].pixels.size * (len(frames) - 1)

    def stream() -> None:
        for _ in PIX2NVS().stream(frames):
            pass

    times = race({"one_core": one_core(frames), "stream": stream})
    return [{"what": "emulate the video"} | {f"{k}_ns_a_pixel": round(v / pixels * 1e9, 2) for k, v in times.items()}]


def one_core(frames: list[Frame]) -> Callable[[], None]:
    """A function that emulates the frames step by step."""

    def steps() -> None:
        emulator = Emulator(PIX2NVS(), frames[0])
        for frame in frames[1:]:
            emulator.step(frame).events()

    return steps


def decoded(video: Path, color: bool = True) -> list[Frame]:
    """All frames of a video."""
    from nvsdata.video.frames import frames_of

    return list(frames_of(video, color=color))


def still_scene() -> list[Row]:
    """Frames of 640x480 in which everything moves, a small object moves, and nothing moves."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (520, 680, 3), dtype=np.uint8), (0, 0), 2)
    ground = np.interp(ground, (ground.min(), ground.max()), (5, 250)).astype(np.uint8)
    moving = [Frame(40_000 * n, np.ascontiguousarray(ground[n : n + 480, n : n + 640])) for n in range(30)]
    still = [Frame(40_000 * n, moving[0].pixels.copy()) for n in range(30)]
    object_ = [Frame(f.time, f.pixels.copy()) for f in still]
    for n, frame in enumerate(object_):
        frame.pixels[200:216, 100 + 4 * n : 116 + 4 * n] = 250

    times = race(
        {
            "all_moves": one_core(moving),
            "object_moves": one_core(object_),
            "still": one_core(still),
            "start": one_core(moving[:1]),
        }
    )
    costs = {k: (v - times["start"]) / 29 for k, v in times.items() if k != "start"}
    return [
        {"what": "a frame of 640x480"}
        | {f"{k}_ms": round(v * 1e3, 3) for k, v in costs.items()}
        | {f"{k}_times_cheaper": round(costs["all_moves"] / v, 1) for k, v in costs.items() if k != "all_moves"}
    ]


def jobs(video: Path, home: Path) -> list[Row]:
    """40 clips cut from the video, with length, size and codec of UCF101's clips, by one process and by two."""
    clips = home / "clips"
    frames = decoded(video)
    frames += frames[::-1]
    for i in range(40):
        (clips / "ab"[i % 2]).mkdir(parents=True, exist_ok=True)
        path = clips / "ab"[i % 2] / f"{i}.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"XVID"), 25, (320, 240))
        for frame in frames[i : i + 180]:
            writer.write(cv2.resize(frame.pixels, (320, 240)))
        writer.release()
    spent = {}
    for count in (1, 2):
        os.sync()
        out = home / f"j{count}"
        command = [sys.executable, "-m", "nvsdata", "convert-videos", str(clips), "--out", str(out)]
        start = time.perf_counter()
        subprocess.run([*command, "--jobs", str(count)], check=True, capture_output=True)
        spent[count] = time.perf_counter() - start
        shutil.rmtree(out)
    return [
        {"what": "40 clips of 180 frames"}
        | {f"jobs_{k}_s": round(v, 2) for k, v in spent.items()}
        | {"ratio": round(spent[1] / spent[2], 2)}
    ]


def memory(video: Path, home: Path) -> list[Row]:
    """Peak resident memory of converting the video once, and of four times as many frames, each in a process."""
    script = (
        "import sys, itertools, nvsdata\n"
        "from nvsdata.video.frames import frames_of\n"
        "times = int(sys.argv[2])\n"
        "frames = itertools.chain.from_iterable(frames_of(sys.argv[1], color=False) for _ in range(times))\n"
        "nvsdata.write(nvsdata.PIX2NVS().stream(frames, 25), sys.argv[3])\n"
        "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))\n"
    )
    peaks = {}
    for times in (1, 4):
        command = [sys.executable, "-c", script, str(video), str(times), str(home / "m.h5")]
        peaks[times] = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout) / 1024
    return [{"what": "peak memory", "once_MB": round(peaks[1]), "four_times_MB": round(peaks[4])}]


def nearest_spikes() -> list[Row]:
    """Chamfer distance and repeatability of a frame, 60,000 spikes per side, compared with cKDTree's query alone."""
    rng = np.random.default_rng(0)
    height, width = 272, 640

    def side() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        where = np.sort(rng.choice(width * height, 60_000, replace=False))
        return where % width, where // width, rng.choice([-3, -2, -1, 1, 2, 3], where.size)

    a, b = side(), side()
    scale = np.array([1, 1, 3**0.5])
    tree, points = cKDTree(np.stack(b, 1) * scale), np.stack(a, 1) * scale
    signs = [(x, y, np.sign(p)) for x, y, p in (a, b)]
    found: dict[str, Any] = {}

    def ours() -> None:
        found["ours"] = np.sqrt(nearest(*a, *b, (height, width), 3.0, np.inf))

    def within() -> None:
        nearest(*signs[0], *signs[1], (height, width), 1e7, 3.5**2)

    def theirs() -> None:
        found["tree"] = tree.query(points)[0]

    times = race({"chamfer": ours, "repeatability": within, "tree_query": theirs})
    error = float(np.abs(found["ours"] - found["tree"]).max())
    return [
        {"what": "nearest of 60,000 spikes to each of 60,000"}
        | {f"{k}_ms": round(v * 1e3, 2) for k, v in times.items()}
        | {f"{k}_ratio": round(times["tree_query"] / times[k], 1) for k in ("chamfer", "repeatability")}
        | {"greatest_difference": error}
    ]


def transport() -> list[Row]:
    """EMD of a block, compared with POT, which gets its matrix of distances."""
    rng = np.random.default_rng(0)
    rows = []
    for n, m in ((300, 350), (1000, 1100)):
        sides = []
        for count in (n, m):
            where = rng.choice(160 * 68, count, replace=False)
            sides.append(((where % 160).astype(float), (where // 160).astype(float), rng.integers(1, 4, count)))
        (ax, ay, am), (bx, by, bm) = sides
        values: dict[str, float] = {}

        def ours(sides: Any = sides, values: dict[str, float] = values) -> None:
            values["ours"] = least_work(*sides[0], *sides[1])

        runs = {"ours": ours}
        with suppress(ImportError):
            import ot

            a, b, costs = am.astype(float), bm.astype(float), np.hypot(ax[:, None] - bx, ay[:, None] - by)
            surplus = a.sum() - b.sum()
            if surplus > 0:
                b, costs = np.append(b, surplus), np.pad(costs, ((0, 0), (0, 1)))
            elif surplus < 0:
                a, costs = np.append(a, -surplus), np.pad(costs, ((0, 1), (0, 0)))

            def pot(a: Any = a, b: Any = b, costs: Any = costs, values: dict[str, float] = values) -> None:
                values["pot"] = float(ot.emd2(a, b, costs, numItermax=10**7))

            runs["pot"] = pot
        times = race(runs)
        row: Row = {"what": f"EMD of {n} x {m} spikes"} | {f"{k}_ms": round(v * 1e3, 2) for k, v in times.items()}
        if "pot" in times:
            row |= {"ratio": round(times["pot"] / times["ours"], 2), "difference": values["ours"] - values["pot"]}
        rows.append(row)
    return rows


if __name__ == "__main__":
    main()
