"""The screen found by a simulated camera, and what measures it."""

import json
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest

from nvsdata import Events
from nvsdata.cli import main
from nvsdata.common.locks import OutputInUse, locked
from nvsdata.plots.drawing import ON
from nvsdata.recording.live_view import sharpness
from nvsdata.recording.simulated.scenes import CORNERS
from nvsdata.rig import calibrate, session
from nvsdata.rig.calibration import ZOOM, _picture, corners_of, lines_of, rectangles, spectrum_of
from nvsdata.rig.clock_fit import NoSync


def test_the_screen_is_found(tmp_path, quick, monkeypatch, capsys):
    monkeypatch.setattr(calibrate, "WATCHED", 500_000)
    out = tmp_path / "c"
    assert main(["record", "--calibrate", "--simulate", "--seconds", "0.3", "--out", str(out)]) == 0
    output = capsys.readouterr().out
    found = json.loads((out / "calibration.json").read_text())
    assert np.abs(np.array(found["corners"]) - CORNERS).max() < 1
    x, y, width, height = found["roi"]
    assert f"--region {x} {y} {width} {height}" in output
    assert x <= 10 <= 11 < x + width
    assert "no flicker found" in output
    assert json.loads((out / "settings.json").read_text())["region"] == found["roi"]
    for name in ("corners.png", "flicker.png"):
        assert cv2.imread(str(out / name)) is not None


def test_figures_are_looked_for_and_written_by_one_process_alone(tmp_path, monkeypatch, capsys):
    out = tmp_path / "c"
    out.mkdir()
    (out / "calibration.json").write_text("{}")
    command = ["record", "--calibrate", "--simulate", "--out", str(out)]
    with locked(out):
        assert main(command) == 1
    assert "is being written by process" in capsys.readouterr().err

    def written(*_):
        with pytest.raises(OutputInUse), locked(out):
            pass
        raise OSError("it was locked")

    monkeypatch.setattr("nvsdata.recording.session.Davis", MagicMock())
    monkeypatch.setattr(session, "Monitor", MagicMock())
    monkeypatch.setattr(session, "calibrate", MagicMock())
    monkeypatch.setattr(session, "replace", MagicMock())
    monkeypatch.setattr(session, "write_calibration", written)
    assert main([*command, "--overwrite"]) == 1
    assert "it was locked" in capsys.readouterr().err


def drawn(corners):
    """Which pixels see a screen of these corners, and its upper left quarter: shares of flashes, [180, 240]."""
    corners = np.array(corners, np.float64)
    middle = corners.mean(0)
    quarter = [corners[0], (corners[0] + corners[1]) / 2, middle, (corners[0] + corners[3]) / 2]
    return tuple(
        cv2.fillPoly(np.zeros((180, 240)), [np.rint(places).astype(np.int32)], 0.9) for places in (corners, quarter)
    )


@pytest.mark.parametrize("turn", range(4))
def test_corners_begin_with_the_screens_own_upper_left(turn):
    corners = np.roll(CORNERS, turn, 0)
    found = corners_of(*drawn(corners))
    assert np.abs(found - corners).max() < 1.5


def test_noise_is_no_screen():
    with pytest.raises(NoSync, match="too few pixels see the screen"):
        corners_of(np.random.default_rng(0).random((180, 240)) * 0.6, np.zeros((180, 240)))


def test_rectangles_around_and_within():
    corners = np.array([(10.4, 20.2), (200.0, 12.0), (198.0, 150.0), (12.0, 160.0)])
    outer, inner, cover = rectangles(corners, (240, 180))
    assert outer == (10, 12, 191, 149)
    assert inner == (12, 21, 187, 130)
    assert cover == pytest.approx(cv2.contourArea(corners.astype(np.float32)) / 43_200)
    assert rectangles(corners + np.array([60, 0]), (240, 180))[0] == (70, 12, 170, 149)


@pytest.mark.parametrize("frequency", [60.0, 100.0, 237.0])
def test_flicker_is_a_line_of_the_spectrum(frequency):
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 4_000_000, 100_000))
    blinking = t[rng.random(t.size) < 0.5 + 0.2 * np.sin(2 * np.pi * frequency * t / 1e6)]
    for times, expected in ((blinking, [frequency]), (t, [])):
        n = times.size
        events = Events(times, np.zeros(n, int), np.zeros(n, int), np.zeros(n, int), (240, 180))
        lines = lines_of(*spectrum_of(events, 0, 4_000_000), (60.0, 100.0, 120.0))
        assert list(lines) == pytest.approx(expected, abs=0.3)


def test_a_sharp_edge_is_sharper_than_a_blurred_one():
    rng = np.random.default_rng(0)

    def edge(width):
        y = rng.integers(0, 180, 4_000)
        x = np.clip(120 + rng.normal(0, width, y.size), 0, 239).astype(int)
        return Events(np.zeros(y.size, int), x, y, x > 120, (240, 180))

    assert sharpness(edge(0.5)) > 1.5 * sharpness(edge(5))
    assert sharpness(Events([], [], [], [], (240, 180))) == 0


def test_the_picture_marks_the_screens_own_upper_left():
    corners = np.array([[20.0, 30.0], [200.0, 25.0], [210.0, 150.0], [15.0, 160.0]])
    found = MagicMock(corners=corners, response=np.zeros((180, 240)), roi=(5, 10, 220, 160), crop=(30, 40, 100, 90))
    picture = _picture(found)
    # a disc there, and no more than the line's own width elsewhere
    reds = [
        int((picture[y - 8 : y + 9, x - 8 : x + 9] == ON).all(2).sum())
        for x, y in ((corners + 0.5) * ZOOM).round().astype(int).tolist()
    ]
    assert reds[0] > 90
    assert max(reds[1:]) < 60


def test_aiming_keeps_no_events(tmp_path, quick, monkeypatch):
    """It may take an hour, at 16 MB/s."""
    monkeypatch.setattr(calibrate, "WATCHED", 300_000)
    joined, real = [], calibrate.concatenate
    monkeypatch.setattr(calibrate, "concatenate", lambda parts: joined.append(real(parts)) or joined[-1])
    out = tmp_path / "c"
    assert main(["record", "--calibrate", "--simulate", "--seconds", "1.5", "--out", str(out)]) == 0
    (columns,) = joined
    # nothing from before the pattern but the block that came when aiming ended
    assert columns.t[0] > 1_200_000
    assert columns.t[-1] - columns.t[0] < 6_000_000
