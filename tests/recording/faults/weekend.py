"""The lab of `test_weekend.py`: a batch before a simulated camera, and what happens to both; a program of its own.

    python weekend.py FOLDER [--resume]

What happens while a video is recorded follows from its name, NUMBER-KIND.avi; `attempts.jsonl` in the folder tells of
each take what became of it, beside what the simulated camera knows of it.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Timer
from types import SimpleNamespace

import lab
import numpy as np
import pygame
import usb.core
from disks import file_limit

import nvsdata
from nvsdata.cli import main
from nvsdata.data.events import Events
from nvsdata.recording import capture
from nvsdata.recording.camera import host_time
from nvsdata.recording.davis import driver
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.options import Simulation
from nvsdata.recording.simulated.scenes import PIXELS, Watched
from nvsdata.recording.simulated.usb_backend import Backend
from nvsdata.rig import cameras, playback, take, watch
from nvsdata.rig.monitor import Monitor
from nvsdata.rig.sync import ScreenRecording, synced

REFRESH = 1e6 / 59.94  # µs; the display says 60 Hz
DRIFT = 150.0  # ppm, at most
AWAY = 1.5  # s for which a camera is unplugged


class Weekend:
    """What is being recorded, since when, and for which time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = folder / "attempts.jsonl"
        known = self.log.read_text().splitlines() if self.log.exists() else []
        self.takes = Counter(json.loads(line)["video"] for line in known if '"begun"' in line)
        self.video = self.kind = ""
        self.number, self.start = 0, None
        self.done: set[str] = set()
        self.dark = self.fading = False

    def write(self, **result: object) -> None:
        with self.log.open("a") as file:
            file.write(json.dumps({"video": self.video, "take": self.takes[self.video], **result}) + "\n")

    def begin(self, video: Path) -> None:
        self.video, self.start = video.name, None
        number, _, self.kind = video.stem.partition("-")
        self.number = int(number)
        self.write(begun=True)
        self.takes[self.video] += 1
        self.done = set()
        # the light goes out once, until somebody comes because of the alarm
        self.dark = (self.kind == "dark" or self.dark) and not (self.folder / "alarm").exists()
        if self.kind == "full" and self.first:
            shutil.disk_usage = lambda place: SimpleNamespace(free=0)

    @property
    def first(self) -> bool:
        return self.takes[self.video] == 1

    def now(self, kind: str, after: int = 100_000) -> bool:
        """Whether something is to happen now: in the first take, once, `after` µs from the video's start on."""
        if self.kind != kind or not self.first or kind in self.done:
            return False
        if self.start is None or host_time() < self.start + after:
            return False
        self.done.add(kind)
        return True

    def within(self, first: int, last: int) -> bool:
        """Whether it is between two times (µs) from the video's start."""
        return self.start is not None and first <= host_time() - self.start < last


@dataclass
class Sight(Watched):
    """The screen, and what else there is to be seen."""

    weekend: Weekend | None = None

    def events(self, start: int, stop: int) -> Events:
        seen, lab_ = super().events(start, stop), self.weekend
        kind, columns = lab_.kind, seen.columns
        if lab_.dark:
            kind = "away"
        if kind == "hand":
            columns = columns.take(columns.x < 120)
        elif kind == "faint":
            columns = columns.take(np.random.default_rng(start).random(len(seen)) < 0.005)
        elif kind == "away":
            columns = self.others("dark", columns.first(0), start, stop)
        elif kind == "bump":
            columns = columns._replace(x=columns.x + np.int16(12)).take(columns.x < 228)
        elif kind == "gap" and lab_.start is not None:
            since = columns.t - lab_.start
            columns = columns.take((since < 250_000) | (since > 450_000))
        elif kind in ("noise", "walker"):
            columns = self.others(kind, columns, start, stop)
        order = np.argsort(columns.t, kind="stable")
        return Events.trusted(columns.take(order), seen.sensor_size, start)

    def others(self, kind, columns, start, stop):
        rng, width, height = np.random.default_rng(start), *self.size()
        if kind in ("noise", "dark"):
            count = rng.poisson((50 if kind == "noise" else 0.5) * width * height * (stop - start) / 1e6)
            x, y = rng.integers(0, width, count), rng.integers(0, height, count)
        else:
            # somebody walks by, from left to right, once the video has begun
            begun = self.weekend.start
            count = 0 if begun is None else rng.poisson(300_000 * (stop - start) / 1e6)
            x = (rng.integers(0, 30, count) + (0 if begun is None else (start - begun) / 5_000)).astype(int) % width
            y = rng.integers(0, height, count)
        t, p = rng.integers(start, max(stop, start + 1), count), rng.integers(0, 2, count)
        more = type(columns)(t, x.astype(np.int16), y.astype(np.int16), p.astype(np.uint8))
        return type(columns)(*(np.concatenate(pair) for pair in zip(columns, more, strict=True)))

    def size(self) -> tuple[int, int]:
        return self._picture.shape[1], self._picture.shape[0]

    def pulses(self, start: int, stop: int) -> list[int]:
        self.wired = self.weekend.kind in ("wired", "triggers")
        found = super().pulses(start, stop)
        if self.weekend.kind == "triggers":
            found += range(-(-start // 20_000) * 20_000, stop, 20_000)
        return sorted(found)


@dataclass
class Camera(SimulatedDavis):
    """Keeps what it sends, in its own time, and has the faults of the day."""

    weekend: Weekend | None = None

    def _begin(self) -> None:
        # a clock of its own for each video
        self.speed = 1 + DRIFT * 1e-6 * np.random.default_rng(self.weekend.number).uniform(-1, 1)
        super()._begin()
        self.zero = self._began
        self.sent: list[tuple[np.ndarray, ...]] = []

    def _words(self, t, seen, pulses, now):
        day = self.weekend
        if day.now("reset"):
            words = super()._words(t, seen, pulses, now)
            self._begin()
            return np.append(words, 1).astype("<u2")
        self.sent.append((t, seen.x, seen.y, seen.p))
        return super()._words(t, seen, pulses, now)

    def _see(self, now: int, least: int = 1) -> bool:
        day = self.weekend
        early = day.kind == "early" and day.fading
        self.lossy = 1.0 if early or (day.kind == "drops" and day.first and day.within(100_000, 200_000)) else 0.0
        return super()._see(now, least)


class Plugs(Backend):
    """The camera's USB, as it fails."""

    weekend: Weekend
    unreadable = False

    def fails(self, camera: Camera, call: str) -> None:
        day = self.weekend
        if call == "open":
            camera.stalled = False
        if call == "read":
            if day.now("unplug") or day.now("serial"):
                self.unreadable = day.kind == "serial"
                camera.unplugged = True
                Timer(AWAY, setattr, (camera, "unplugged", False)).start()
            camera.stalled |= day.now("stall")
            self.host_fails(day)
        if call == "control" and day.start is not None:
            if day.now("late"):
                raise usb.core.USBTimeoutError("Operation timed out", -7, 110)
            if day.kind == "hang" and day.first and day.within(-200_000, 2_000_000):
                raise usb.core.USBTimeoutError("Operation timed out", -7, 110)

    def host_fails(self, day: Weekend) -> None:
        """The computer sleeps, somebody presses Ctrl-C, the process is killed."""
        if day.now("sleep"):
            subprocess.Popen(["sh", "-c", f"sleep 2; kill -CONT {os.getpid()}"])
            os.kill(os.getpid(), signal.SIGSTOP)
        if day.now("interrupt"):
            os.kill(os.getpid(), signal.SIGINT)
        if day.now("kill"):
            os.kill(os.getpid(), signal.SIGKILL)

    def ctrl_transfer(self, dev_handle, bmRequestType, bRequest, wValue, wIndex, data, timeout):
        if self.unreadable and (bmRequestType, bRequest) == (0x80, 6) and wValue >> 8 == 3:
            self.unreadable = False
            raise usb.core.USBError("Pipe error", -9, 32)
        return super().ctrl_transfer(dev_handle, bmRequestType, bRequest, wValue, wIndex, data, timeout)


class Wire(driver.SyncStream):
    """Requests that fail now and then, with what they would have brought."""

    weekend: Weekend

    def read(self, timeout: int) -> bytes:
        data = super().read(timeout)
        if self.weekend.now("usb"):
            self.faults += 1
            return b""
        return data


def flip_of(flip):
    """`flip` of a display that holds pictures back until its refresh."""

    def flipped() -> None:
        flip()
        due = (host_time() // REFRESH + 1) * REFRESH
        while (left := due - host_time()) > 0:
            time.sleep(max(left - 300, 0) / 1e6)

    return flipped


def told_of(one: ScreenRecording, line: dict, events: Events, camera: Camera) -> dict:
    """A recording beside what the camera knows: µs of its start, ppm of its clock, and whether each event is there."""
    fit, done = synced(one).line, one.performance
    span = round(fit.camera(done.start)), round(fit.camera(done.stop))
    t, x, y, p = (np.concatenate(column) for column in zip(*camera.sent, strict=True))
    kept = (t >= span[0]) & (t < span[1])
    same = len(events) == np.count_nonzero(kept) and all(
        np.array_equal(a, b[kept]) for a, b in ((events.t + span[0], t), (events.x, x), (events.y, y), (events.p, p))
    )
    return {
        "start": fit.camera(done.start) - (done.start - camera.zero) * camera.speed,
        "drift": (1 + fit.drift - camera.speed) * 1e6,
        "same": bool(same),
        "events": len(events),
        "by": line["sync"]["by"],
        "dropped": [line["dropped"], line["dropped_in_all"]],
    }


def patched(day: Weekend, camera: Camera) -> None:
    """Put the lab before, behind and around the batch."""
    lab.hurry()
    take.MOST_WRONG, watch.PAUSED, cameras.RETRY = 50.0, 1_000_000, 300_000
    record, cut, play, fade = take.record_screen, take.trim, playback._play, Monitor.fade
    usage = shutil.disk_usage

    def recorded(camera_, rig, video, *how, **more):
        day.begin(video)
        try:
            return record(camera_, rig, video, *how, **more)
        except BaseException as error:
            day.write(failed=str(error) or type(error).__name__)
            raise
        finally:
            shutil.disk_usage = usage

    def cut_and_told(one, video, inspector):
        if day.kind == "killcut" and day.first:
            Timer(np.random.default_rng(day.number).uniform(0, 0.3), os.kill, (os.getpid(), signal.SIGKILL)).start()
        try:
            if day.kind == "fullcut" and day.first:
                with file_limit(2_048):
                    return cut(one, video, inspector)
            line = cut(one, video, inspector)
        except BaseException as error:
            day.write(failed=str(error) or type(error).__name__)
            raise
        day.write(**told_of(one, line, nvsdata.read(video.target), camera))
        return line

    def played(monitor, done, *frames):
        day.start = done.start
        return play(monitor, done, *frames)

    def faded(*how, **more):
        day.fading = True
        fade(*how, **more)
        day.fading = False

    take.record_screen, take.trim, playback._play, Monitor.fade = recorded, cut_and_told, played, faded
    pygame.display.flip = flip_of(pygame.display.flip)
    pygame.display.get_desktop_refresh_rates = lambda: [60]
    driver.SyncStream, Wire.weekend = Wire, day
    backend = Plugs(camera)
    backend.weekend, backend.before = day, backend.fails
    Simulation.watched = lambda self: (backend, camera.scene.show)
    capture.RESET_WAIT = 1.0


def run(folder: Path, *more: str) -> int:
    """The batch: as a user would start it."""
    day = Weekend(folder)
    camera = Camera(scene=Sight(replace(PIXELS), weekend=day), weekend=day)
    patched(day, camera)
    alarm = f"echo $NVSDATA_ALARM >> {folder / 'alarm'}"
    out = ["--out", str(folder / "out"), "--on-alarm", alarm, "--note", "nobody there"]
    return main(["record", "--simulate", "--monitor", str(folder / "in"), *out, *more])


if __name__ == "__main__":
    sys.exit(run(Path(sys.argv[1]), *sys.argv[2:]))
