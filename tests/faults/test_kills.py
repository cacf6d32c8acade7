"""Commands that are killed at any moment, and run again: what comes out equals an unkilled run's."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata import Events

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kills as POSIX does")
MOMENTS = 40


def start(*words: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "nvsdata", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)


def finish(*words: object) -> float:
    """Seconds that a command takes, left to itself."""
    began = time.monotonic()
    process = start(*words)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err.decode()
    return time.monotonic() - began


def kill_after(seconds: float, *words: object) -> None:
    """Run a command and kill it, alone, in the middle; its children must end by themselves."""
    process = start(*words)
    time.sleep(seconds)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    deadline = time.monotonic() + 20
    while left := in_session(process.pid):
        assert time.monotonic() < deadline, f"processes outlive the one that started them: {left}"
        time.sleep(0.02)


def in_session(leader: int) -> list[int]:
    """The processes of a session, but zombies."""
    found = subprocess.run(["ps", "-eo", "pid=,sid=,stat="], capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in found.splitlines()]
    return [int(pid) for pid, session, state in rows if int(session) == leader and not state.startswith("Z")]


def content(folder: Path) -> dict[str, object]:
    """What a folder of recordings holds, hidden files included; the manifest's lines but for times."""
    found: dict[str, object] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".h5":
            events = nvsdata.read(path)
            found[name] = (events.start, events.end, *(column.tobytes() for column in events.columns))
        elif path.is_file() and path.name != "manifest.jsonl":
            found[name] = path.read_bytes()
    return found


@pytest.fixture
def videos(tmp_path):
    for i in range(4):
        write_video(tmp_path / f"videos/{'ab'[i % 2]}/{i}.avi", moving_square(300, (160, 120), i))
    return tmp_path / "videos"


def converted(videos, out, jobs, moments, seed):
    words = ("convert-videos", videos, "--jobs", jobs, "--out")
    seconds = finish(*words, out / "unkilled")
    expected = content(out / "unkilled")
    assert len(expected) == 4
    moment = random.Random(seed)
    for n in range(moments):
        target = out / str(n)
        kill_after(moment.uniform(0, seconds), *words, target)
        finish(*words, target)
        assert content(target) == expected, f"killed at moment {n}"


def test_convert_videos(videos, tmp_path):
    converted(videos, tmp_path / "out", 2, 1, 0)


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
def test_convert_videos_at_many_moments(videos, tmp_path, jobs):
    converted(videos, tmp_path / "out", jobs, MOMENTS, jobs)


@pytest.fixture
def recording(tmp_path):
    rng = np.random.default_rng(0)
    n = 1_500_000
    t, x, y = np.sort(rng.integers(0, 10**7, n)), rng.integers(0, 240, n), rng.integers(0, 180, n)
    nvsdata.write(Events(t, x, y, rng.integers(0, 2, n), (240, 180)), tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".h5", ".txt", ".aedat", ".aedat3", ".npy", ".dat"])
def test_convert_at_many_moments(recording, tmp_path, suffix):
    target = tmp_path / f"b{suffix}"
    seconds = finish("convert", recording, target)
    expected = target.read_bytes()
    target.unlink()
    moment = random.Random(0)
    for _ in range(MOMENTS):
        kill_after(moment.uniform(0.3 * seconds, seconds), "convert", recording, target)
        # whole, or not there
        assert not target.exists() or target.read_bytes() == expected
        finish("convert", recording, target, "--overwrite")
        assert target.read_bytes() == expected
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5", target.name]
        target.unlink()


COMMANDS = {"pack": (), "precompute": ("--transform", "Compose([Window(0, 200000), RadiusGraph()])")}


def packed(folder, out, jobs, moments, seed, command="pack"):
    words = (command, folder, "--dataset", "folder", *COMMANDS[command], "--jobs", jobs, "--out")
    seconds = finish(*words, out / "unkilled.h5")
    expected = (out / "unkilled.h5").read_bytes()
    moment = random.Random(seed)
    for n in range(moments):
        target = out / f"{n}.h5"
        kill_after(moment.uniform(0.2 * seconds, seconds), *words, target)
        if not target.exists():
            finish(*words, target)
        assert target.read_bytes() == expected, f"killed at moment {n}"
        target.unlink()
        assert sorted(path.name for path in out.iterdir()) == ["unkilled.h5"]


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(1)
    for i in range(120):
        path = tmp_path / f"folder/{'ab'[i % 2]}/{i}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        n = int(rng.integers(1_000, 60_000))
        t, x, y = np.sort(rng.integers(0, 10**6, n)), rng.integers(0, 34, n), rng.integers(0, 34, n)
        nvsdata.write(Events(t, x, y, rng.integers(0, 2, n), (34, 34)), path)
        # a cache leaves out recordings that changed a moment ago
        os.utime(path, (1, 1))
    (tmp_path / "out").mkdir()
    return tmp_path / "folder"


@pytest.mark.long
@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("command", COMMANDS)
def test_pack_at_many_moments(folder, tmp_path, jobs, command):
    packed(folder, tmp_path / "out", jobs, MOMENTS, jobs, command)


@pytest.mark.long
def test_tune_at_many_moments(videos, tmp_path):
    video = next(videos.rglob("0.avi"))
    real = tmp_path / "real.h5"
    nvsdata.write(nvsdata.PIX2NVS(threshold=0.3).emulate(video), real)
    words = ("tune", "--real", real, "--video", video, "--trials", 12, "--seconds", 1, "--out")
    seconds = finish(*words, tmp_path / "unkilled")
    expected = {path.name: path.read_bytes() for path in (tmp_path / "unkilled").iterdir()}
    moment = random.Random(0)
    for n in range(MOMENTS):
        out = tmp_path / f"killed-{n}"
        kill_after(moment.uniform(0.2 * seconds, seconds), *words, out)
        finish(*words, out)
        assert {path.name: path.read_bytes() for path in out.iterdir()} == expected, f"killed at moment {n}"


FILLING = """
import sys
import nvsdata
from nvsdata import EventFolder
from nvsdata import transforms as T
from nvsdata import collate
from torch.utils.data import DataLoader

folder, place = sys.argv[1:]
pipeline = T.Compose([T.Window(0, 60_000), T.RadiusGraph(radius=3, max_degree=8)])
data = nvsdata.cache(EventFolder(folder, transform=pipeline, sensor_size=(34, 34)), place)
for graph, _ in DataLoader(data, batch_size=4, num_workers=2, collate_fn=collate):
    print(graph.num_edges, flush=True)
"""


def filled(folder: Path, place: Path) -> bytes:
    command = [sys.executable, "-c", FILLING, str(folder), str(place)]
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=120).stdout


@pytest.mark.long
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
def test_a_cache_that_is_being_filled(folder, tmp_path, sign):
    began = time.monotonic()
    expected = filled(folder, tmp_path / "unkilled")
    seconds = time.monotonic() - began
    samples = {path.name: path.read_bytes() for path in (tmp_path / "unkilled").rglob("*.pt")}
    moment = random.Random(int(sign))
    for n in range(MOMENTS // 2):
        place = tmp_path / f"killed-{n}"
        process = subprocess.Popen(
            [sys.executable, "-c", FILLING, str(folder), str(place)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        time.sleep(moment.uniform(0.4 * seconds, seconds))
        process.send_signal(sign)
        process.communicate(timeout=60)
        deadline = time.monotonic() + 30
        while in_session(process.pid):
            assert time.monotonic() < deadline, "a worker outlives the process that started it"
            time.sleep(0.02)
        for path in place.rglob("*.pt"):
            assert path.read_bytes() == samples[path.name], f"killed at moment {n}"
        assert filled(folder, place) == expected, f"killed at moment {n}"
        left = [path for path in place.rglob("*") if path.is_file() and path.name.startswith(".")]
        assert not left, f"killed at moment {n}"
