"""Recording from a simulated camera."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import nvsdata
from nvsdata import Events
from nvsdata.recording import capture, pipeline
from nvsdata.recording.capture import record, stopped_by_interrupt
from nvsdata.recording.davis.driver import Davis
from nvsdata.recording.simulated import camera as camera_module
from nvsdata.recording.simulated.camera import SimulatedDavis
from nvsdata.recording.simulated.scenes import Outlines
from nvsdata.recording.simulated.usb_backend import Backend


def opened(camera, before=lambda camera, call: None):
    return Davis.find(backend=Backend(camera, before=before))


@pytest.mark.parametrize("suffix", ["h5", "aedat"])
def test_a_recording_is_what_the_camera_saw(tmp_path, suffix):
    camera = SimulatedDavis(scene=Outlines(rate=50_000))
    path = tmp_path / f"a.{suffix}"
    with opened(camera) as davis:
        report = record(davis, path, seconds=0.4)
    events = nvsdata.read(path)
    assert report.whole
    assert report.events == len(events) > 10_000
    assert events.sensor_size == (240, 180)
    assert 0 <= events.t[0] < 20_000
    assert 350_000 < events.t[-1] < 400_000
    assert (np.diff(events.t) >= 0).all()
    assert not any(report.error_counts.values())
    assert report.dropped == 0


@pytest.mark.parametrize(("room", "whole"), [(None, True), (1 << 22, False)])
def test_a_busy_computer_loses_nothing_of_a_simulated_camera(tmp_path, monkeypatch, room, whole):
    """25 s pass between two reads; only a camera that keeps no more than a real one drops events."""
    away, real = [0.0], camera_module.host_time
    monkeypatch.setattr(camera_module, "host_time", lambda: real() + away[0])

    def busy(camera, call):
        if call == "read" and camera._time > 100_000:
            away[0] = 25e6

    with opened(SimulatedDavis(room=room), busy) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.4)
    assert report.whole is whole
    assert (report.dropped == 0) is whole
    if whole:
        t = nvsdata.read(tmp_path / "a.h5").t
        # 220,000 events/s, until the end
        assert np.histogram(t, 8, (0, 400_000))[0].min() > 9_000


class Dark:
    """Nothing to see."""

    lag = 0

    def events(self, start, stop):
        return Events([], [], [], [], (240, 180))

    def pulses(self, start, stop):
        return []


def test_a_dark_room_is_a_recording_without_events(tmp_path):
    with opened(SimulatedDavis(scene=Dark())) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.1)
    assert report.whole
    assert len(nvsdata.read(tmp_path / "a.h5")) == 0


def test_an_unplugged_camera_leaves_what_came(tmp_path):
    began = time.monotonic()

    def pulled(camera, call):
        if call == "read" and time.monotonic() - began > 0.7:
            camera.unplugged = True

    with opened(SimulatedDavis(), pulled) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=30)
    assert "stopped sending" in report.ended
    assert not report.whole
    assert len(nvsdata.read(tmp_path / "a.h5")) == report.events > 1000


class Remembered(Outlines):
    """Remembers the events that the pixels saw, as rows of host times."""

    def __init__(self):
        super().__init__(rate=100_000)
        self.rows = []

    def events(self, start, stop):
        seen = super().events(start, stop)
        self.rows += zip(*(column.tolist() for column in seen.columns), strict=True)
        return seen


def test_a_stalled_camera_ends_the_recording_and_keeps_what_it_sent(tmp_path, monkeypatch):
    monkeypatch.setattr(Davis, "silence", 0.2)
    began = None

    def moves(camera, call):
        nonlocal began
        began = camera._began or began
        # its time stands still otherwise, and at last; the recording begins when its clock is reset
        if call == "read" and sum(t >= (began or 0) for t, *_ in camera.scene.rows) < 4_000:
            camera.advance(10_000)

    camera = SimulatedDavis(scene=Remembered(), speed=0)
    with opened(camera, moves) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=30)
    assert "sent nothing" in report.ended
    assert not report.whole
    events = nvsdata.read(tmp_path / "a.h5")
    assert len(events) == report.events > 3_000
    # what came before the reset of its clock isn't part of the recording
    sent = sorted((t - int(began), *others) for t, *others in camera.scene.rows if t >= int(began))
    assert sorted(zip(*(column.tolist() for column in events.columns), strict=True)) == sent


def test_what_finds_no_room_is_counted(tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "ROOM", 30_000)
    with opened(SimulatedDavis(scene=Outlines(rate=2_000_000))) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=0.3)
    assert report.lost > 0
    assert not report.whole
    assert len(nvsdata.read(tmp_path / "a.h5")) == report.events


def test_ctrl_c_ends_a_recording_and_keeps_it(tmp_path):
    threading.Timer(0.6, os.kill, (os.getpid(), signal.SIGINT)).start()
    with opened(SimulatedDavis()) as davis, stopped_by_interrupt() as stop:
        began = time.monotonic()
        report = record(davis, tmp_path / "a.h5", stop=stop)
    assert report.ended == "it was stopped"
    assert time.monotonic() - began < 10
    assert len(nvsdata.read(tmp_path / "a.h5")) == report.events > 0


def test_a_full_disk_ends_the_recording_while_the_file_can_still_be_made_whole(tmp_path, monkeypatch):
    began = time.monotonic()
    real = capture.shutil.disk_usage

    def filling(place):
        return real(place)._replace(free=10**9 if time.monotonic() - began < 0.7 else 10**6)

    monkeypatch.setattr(capture.shutil, "disk_usage", filling)
    with opened(SimulatedDavis()) as davis:
        report = record(davis, tmp_path / "a.h5", seconds=30)
    assert report.ended == "the disk is full"
    assert not report.whole
    assert len(nvsdata.read(tmp_path / "a.h5")) == report.events > 0


def test_a_format_that_cannot_be_written_is_refused_before_anything_starts(tmp_path):
    with opened(SimulatedDavis()) as davis, pytest.raises(ValueError, match="can't write files"):
        record(davis, tmp_path / "a.xyz", seconds=1)


class Pulsing(Outlines):
    """Pulses the external input each 50 ms."""

    def pulses(self, start, stop):
        return [t for t in range(start - start % 50_000, stop, 50_000) if t >= start]


def test_pulses_of_the_external_input_are_in_the_report():
    with opened(SimulatedDavis(scene=Pulsing(rate=30_000))) as davis:
        report = record(davis, None, seconds=0.4)
    assert report.whole
    assert report.events > 5_000
    assert len(report.triggers) == 8
    assert np.diff(report.triggers).tolist() == pytest.approx([50_000] * 7, abs=2)
    assert report.temperature == 25.0
