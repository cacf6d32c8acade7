"""Benchmarks of emulating events from frames."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from itertools import count, islice, product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from nvsdata import formats, metrics
from nvsdata.benchmarks.case import Case, Options, PreparedCase
from nvsdata.benchmarks.inputs import frame_event_pairs, video
from nvsdata.data.events import Events
from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.video.frames import VideoFrame
from nvsdata.video.upsample import upsample_frames

SIZE = 640, 480
PERIOD = 40_000  # µs between frames
CYCLE = 8  # different frames, which repeat
DEFAULT = PIX2NVS()
SETTINGS = {
    "default": DEFAULT,
    "B = 2": PIX2NVS(inhibition=2),
    "B = 3": PIX2NVS(inhibition=3),
    "average": PIX2NVS(difference="average"),
    "minimum": PIX2NVS(difference="minimum"),
    "CE": PIX2NVS(mode="CE", threshold=2.0),
    "LICE": PIX2NVS(mode="LICE"),
    "only where it fired": PIX2NVS(new=False),
    "no moving average": PIX2NVS(exp=False),
    "unequal thresholds": PIX2NVS(mismatch=0.1),
    "float64": PIX2NVS(t_log=40.0),
    "DVS": DVS(),
    "DVS, flow": DVS(upsample="flow"),
    "DVS, leak": DVS(leak=0.1),
    "DVS, cutoff": DVS(cutoff=100.0),
}
TO_SENSOR = "1 - repeatability within 3.5 pixels, mean of both directions, to the sensor's own events"


def cases(options: Options) -> list[Case]:
    """Return the cases: videos; settings, compared with a real sensor; still parts; processes; larger inputs."""
    each = _videos, _exact, _sensors, _active, _jobs, _growing
    return [case for some in each for case in some(options)]


def _videos(options: Options) -> Iterator[Case]:
    case = partial(Case, "emulate", "a video to HDF5")
    yield case(partial(_converted, options), default=True)
    yield case(partial(_decoded, options), library="OpenCV, decoding alone", package="opencv-contrib-python-headless")


def _exact(options: Options) -> Iterator[Case]:
    kind = "fraction of pixels and polarities with a wrong number of events, relative to the equations in float64"
    case = partial(Case, "emulate", "moving frames of 320x240 to events", error_kind=kind)
    yield case(partial(_compared_with_equations, True), default=True)
    yield case(partial(_compared_with_equations, False), library="NumPy, the equations in float64", package="numpy")


def _sensors(options: Options) -> Iterator[Case]:
    """Yield cases of settings, compared with events of a real sensor if the data folder has such pairs."""
    for path, name in product(frame_event_pairs(options.data) if options.data else [], SETTINGS):
        yield Case(
            *("emulate", f"frames of {path.stem} to events", partial(_compared_with_sensor, path, name)),
            settings={"settings": name},
            axis="settings",
            default=name == "default",
            error_kind=TO_SENSOR,
        )


def _active(options: Options) -> Iterator[Case]:
    for name, fraction in product(SETTINGS, (0.0, 0.001, 0.01, 0.1, 1.0)):
        yield Case(
            *("emulate", f"a frame of 640x480 that changes in part: {name}", partial(_part_moves, name, fraction)),
            settings={"fraction that changes": fraction},
            axis="fraction that changes",
        )


def _jobs(options: Options) -> Iterator[Case]:
    """Yield cases of a folder of videos, by the number of processes."""
    for jobs in (1, 2):
        yield Case(
            *("emulate", "a folder of clips like those of UCF101", partial(_folder, options, jobs)),
            settings={"jobs": jobs},
            axis="jobs",
        )


def _growing(options: Options) -> Iterator[Case]:
    for scale in (1, 2, 4, 8):
        size = (80 * scale, 60 * scale)
        make = partial(_part_moves, "default", 1.0, size)
        yield Case("emulate", "frames of growing size", make, size={"pixels": size[0] * size[1]}, axis="pixels")
    for frames in (25, 50, 100, 200, *(() if options.quick else (400, 800))):
        make = partial(_long, frames)
        yield Case("emulate", "videos of growing length", make, size={"frames": frames}, axis="frames", alone=True)


def clip(options: Options) -> Path:
    """Return the video of the data folder, or a synthetic one: a disk that moves over a textured background."""
    given = video(options)
    path = options.scratch / "moving.avi"
    if given is None and not path.exists():
        ground = texture((272, 640, 3))
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (640, 272))
        for n in range(100 if options.quick else 250):
            frame = ground.copy()
            cv2.circle(frame, (20 + 2 * n, 130 + round(60 * np.sin(n / 20))), 14, (250, 250, 250), -1)
            writer.write(frame)
        writer.release()
    return given or path


def texture(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """Return smoothed noise with gray levels 5 to 250, uint8.

    Args:
        shape: Shape of the array.
        seed: Seed of the random numbers (default 0).
    """
    noise = cv2.GaussianBlur(np.random.default_rng(seed).random(shape, np.float32), (0, 0), 2)
    return np.interp(noise, (noise.min(), noise.max()), (5, 250)).astype(np.uint8)


def _converted(options: Options) -> PreparedCase:
    path, target = clip(options), options.scratch / "emulated.h5"
    # as the command sets it: the threads that decode, emulate and write must get Python's lock within a frame's time
    sys.setswitchinterval(0.0005)
    return PreparedCase(
        lambda: formats.write(PIX2NVS().stream(path), target), before=lambda: target.unlink(missing_ok=True)
    )


def _decoded(options: Options) -> PreparedCase:
    path = clip(options)

    def run() -> None:
        capture = cv2.VideoCapture(str(path))
        # no colors, as for emulation
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        while capture.read()[0]:
            pass

    return PreparedCase(run)


def _compared_with_sensor(path: Path, name: str) -> PreparedCase:
    data = np.load(path)
    stills, times = data["frames"][:20], data["frame_times"][:20]
    frames = [VideoFrame(int(time - times[0]), still) for time, still in zip(times, stills, strict=True)]
    during = (data["t"] >= times[0]) & (data["t"] < times[-1])
    t, x, y, p = (data[key][during] for key in "txyp")
    real = Events(t, x, y, p, stills.shape[2:0:-1])
    fps = 1e6 * (len(frames) - 1) / frames[-1].time

    def error(found: Events) -> float:
        both = (metrics.epsilon_repeatability(*sides, fps=fps) for sides in ((found, real), (real, found)))
        return 1 - float(np.mean([float(one) for one in both]))

    return PreparedCase(partial(SETTINGS[name].emulate, frames), error)


def _part_moves(name: str, fraction: float, size: tuple[int, int] = SIZE) -> PreparedCase:
    """Prepare single frames in which only a centered square, with this fraction of the pixels, changes."""
    width, height = size
    ground = texture((height + CYCLE, width))
    side = fraction**0.5
    top, left = (round(length * (1 - side) / 2) for length in (height, width))
    rows, columns = (slice(at, at + round(length * side)) for at, length in ((top, height), (left, width)))
    stills = []
    for n in range(CYCLE):
        still = ground[:height].copy()
        still[rows, columns] = ground[n:][rows, columns]
        stills.append(still)
    settings, number = SETTINGS[name], count(1)
    state = settings.begin(VideoFrame(0, stills[0]))
    last = [VideoFrame(0, stills[0])]

    def run() -> int:
        n = next(number)
        # a new array each time, as from a decoder
        last.append(VideoFrame(PERIOD * n, stills[n % CYCLE]))
        more = upsample_frames(iter(last), getattr(settings, "upsample", "none"))
        found = sum(len(state.step(frame).events()) for frame in islice(more, 1, None))
        del last[0]
        return found

    # the moving average settles where nothing changes
    for _ in range(20):
        run()
    return PreparedCase(run, counters=lambda found: {"events": found})


def _folder(options: Options, jobs: int) -> PreparedCase:
    clips, out = options.scratch / "clips", options.scratch / "converted"
    if not clips.exists():
        ground = texture((240 + 180, 320 + 40, 3))
        for i in range(8 if options.quick else 40):
            (clips / "ab"[i % 2]).mkdir(parents=True, exist_ok=True)
            fourcc = cv2.VideoWriter.fourcc(*"XVID")
            writer = cv2.VideoWriter(str(clips / "ab"[i % 2] / f"{i}.avi"), fourcc, 25, (320, 240))
            for n in range(180):
                writer.write(np.ascontiguousarray(ground[n : n + 240, i : i + 320]))
            writer.release()
    command = [sys.executable, "-m", "nvsdata", "convert-videos", str(clips), "--out", str(out), "--jobs", str(jobs)]
    return PreparedCase(
        lambda: subprocess.run(command, check=True, capture_output=True),
        before=lambda: shutil.rmtree(out, ignore_errors=True),
    )


def _compared_with_equations(ours: bool) -> PreparedCase:
    stills = _passing(20)

    def emulated() -> list[Events]:
        return list(PIX2NVS().stream(stills))[1:]

    def counted(pieces: list[Events]) -> np.ndarray:
        """Count the events of each frame, [frames, polarity, row, column]."""
        found = np.zeros((len(pieces), 2, 240, 320), int)
        for counts, events in zip(found, pieces, strict=True):
            np.add.at(counts, (events.p, events.y, events.x), 1)
        return found

    expected = by_equations(stills)

    def error(found: Any) -> float:
        differ = (counted(found) if ours else found) != expected
        return float(differ.sum() / np.count_nonzero(expected))

    return PreparedCase(emulated if ours else partial(by_equations, stills), error)


def by_equations(frames: list[VideoFrame], settings: PIX2NVS = DEFAULT) -> np.ndarray:
    """Compute the numbers of events of gray frames in float64, by the equations of the default settings.

    Args:
        frames: Gray frames.
        settings: Settings whose threshold, max_events and alpha are used.

    Returns:
        Numbers of events [frames - 1, polarity, H, W].
    """
    with np.errstate(divide="ignore"):
        levels = [np.where(frame.pixels > 0, np.log(frame.pixels.astype(float)), 0) for frame in frames]
    reference, found = levels[0], []
    for level in levels[1:]:
        difference = level - reference
        count = np.minimum(np.floor(np.abs(difference) / settings.threshold), settings.max_events).astype(int)
        found.append(np.stack([np.where(difference < 0, count, 0), np.where(difference > 0, count, 0)]))
        reference = reference + settings.alpha * (level - reference)
    return np.array(found)


def _passing(frames: int) -> list[VideoFrame]:
    """Return frames of a camera that moves over a texture."""
    ground = texture((240, 320 + 2 * frames))
    return [VideoFrame(PERIOD * n, np.ascontiguousarray(ground[:, 2 * n : 2 * n + 320])) for n in range(frames)]


def _long(frames: int) -> PreparedCase:
    stills = _passing(frames)

    def run() -> int:
        return sum(len(piece) for piece in PIX2NVS().stream(stills))

    return PreparedCase(run, counters=lambda found: {"events": found})
