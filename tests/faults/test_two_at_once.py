"""Two commands with one output: one does it, the other says in a line that it is being done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata import Events
from nvsdata.cli import main

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")


def refused_while_running(capfd, lock, *words):
    """Run a command; stop it when it holds its lock, and run it a second time meanwhile, in this process."""
    words = [*map(str, words)]
    command = [sys.executable, "-m", "nvsdata", *words]
    first = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    # signed once it is held
    while not lock.exists() or not lock.stat().st_size:
        assert first.poll() is None, first.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.001)
    first.send_signal(signal.SIGSTOP)
    capfd.readouterr()
    try:
        code = main(words)
        out, output = capfd.readouterr()
    finally:
        first.send_signal(signal.SIGCONT)
    _, err = first.communicate(timeout=120)
    assert first.returncode == 0, err
    assert code == 1
    assert out == ""
    assert output.count("\n") == 1
    assert f"is being written by process {first.pid} on" in output
    assert not lock.exists()


@pytest.fixture
def videos(tmp_path):
    for i in range(3):
        write_video(tmp_path / f"videos/{i}.avi", moving_square(30, (64, 48), i))
    return tmp_path / "videos"


def test_convert_videos(videos, tmp_path, capfd):
    refused_while_running(capfd, tmp_path / "out/.nvsdata.lock", "convert-videos", videos, "--out", tmp_path / "out")
    for video in videos.iterdir():
        assert len(nvsdata.read(tmp_path / f"out/{video.stem}.h5")) == len(nvsdata.PIX2NVS().emulate(video))
    assert not list((tmp_path / "out").glob(".*"))


def test_tune(videos, tmp_path, capfd):
    video = videos / "0.avi"
    nvsdata.write(nvsdata.PIX2NVS(threshold=0.3).emulate(video), tmp_path / "real.h5")
    words = ("tune", "--real", tmp_path / "real.h5", "--video", video, "--trials", 8)
    refused_while_running(capfd, tmp_path / "out/.nvsdata.lock", *words, "--out", tmp_path / "out")
    assert len((tmp_path / "out/trials.jsonl").read_text().splitlines()) == 9


def test_pack(tmp_path, capfd):
    rng = np.random.default_rng(1)
    for i in range(30):
        path = tmp_path / f"folder/{'ab'[i % 2]}/{i}.h5"
        path.parent.mkdir(parents=True, exist_ok=True)
        t, x, y = np.sort(rng.integers(0, 10**6, 400)), rng.integers(0, 34, 400), rng.integers(0, 34, 400)
        nvsdata.write(Events(t, x, y, rng.integers(0, 2, 400), (34, 34)), path)
    store = tmp_path / "out.h5"
    refused_while_running(
        capfd, tmp_path / ".out.h5.lock", "pack", tmp_path / "folder", "--dataset", "folder", "--out", store
    )
    packed, plain = (nvsdata.EventFolder(root, "all") for root in (store, tmp_path / "folder"))
    assert len(packed) == 30
    for index in range(30):
        assert packed[index][0] == plain[index][0]
