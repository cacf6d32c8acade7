"""Measurements of a screen, compared with values computed by hand or by slow code."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from nvsdata import Events
from nvsdata.plots.drawing import OFF, ON
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.rig import calibration
from nvsdata.rig.calibration import (
    ScreenCalibration,
    _picture,
    _quadrilateral,
    calibration_summary,
    corners_of,
    lines_of,
    rectangles,
    response,
    spectrum_of,
    write_calibration,
)
from nvsdata.rig.clock_fit import ClockFit, NoSync

FOUND = ScreenCalibration(
    np.array([[0.0, 0.5], [1.0, 0.25]]),
    np.array([[10.04, 20.06], [200.0, 12.0], [198.456, 150.0], [12.0, 160.0]]),
    (10, 12, 191, 149),
    (12, 21, 187, 130),
    0.61234567,
    np.arange(0.0, 500.0, 0.5),
    np.arange(0.0, 500.0, 0.5) / 100,
    {},
)


def test_the_share_of_the_flashes_that_each_pixel_saw():
    """A flash is seen from 1 ms before to 25 ms after it is due, by events of its direction."""
    rows = [
        (9_999, 0, 0, 1),
        (10_000, 1, 0, 1),
        (11_000, 4, 2, 1),
        (11_001, 4, 2, 1),
        (12_000, 2, 0, 0),
        (35_999, 3, 0, 1),
        (36_000, 0, 1, 1),
        (111_500, 4, 2, 0),
        (111_501, 0, 1, 1),
    ]
    events = Events(*zip(*rows, strict=True), (5, 3))
    seen = response(events, ClockFit(1_000.0, 0.0, 0.0, 2, 2), [10_000.0, 110_000.4], [True, False])
    assert seen.tolist() == [[0, 0.5, 0, 0.5, 0], [0] * 5, [0, 0, 0, 0, 1]]
    assert not response(events, ClockFit(0.0, 0.0, 0.0, 0, 0), [], []).any()


def screen(x, y, width, height, share=1.0):
    shown = np.zeros((180, 240))
    shown[y : y + height, x : x + width] = share
    return shown


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_corners_of_an_upright_screen(share):
    seen = screen(30, 40, 120, 80, share)
    # smaller ones beside it are none, nor are single pixels
    seen[40:80, 200:230] = 1
    seen[10, 10] = seen[170, 230] = 1
    found = corners_of(seen, screen(30, 40, 60, 40, share))
    assert found == pytest.approx(np.array([[30, 40], [149, 40], [149, 119], [30, 119]]), abs=0.05)
    turned = corners_of(seen, screen(90, 80, 60, 40))
    assert turned == pytest.approx(np.roll(found, -2, 0))


@pytest.mark.parametrize(("height", "share", "enough"), [(36, 1, True), (35, 1, False), (100, 0.499, False)])
def test_a_screen_covers_a_fiftieth_of_the_sensor(height, share, enough):
    seen = screen(50, 60, 24, height, share)
    if enough:
        assert corners_of(seen, seen)[2] == pytest.approx((73, 95), abs=0.05)
        return
    with pytest.raises(NoSync, match="too few pixels see the screen: aim the camera"):
        corners_of(seen, seen)


def test_a_quarter_that_nobody_sees():
    for quarter in (screen(30, 40, 60, 40, 0.499), screen(200, 40, 30, 40)):
        with pytest.raises(NoSync, match="no pixel sees the upper left quarter"):
            corners_of(screen(30, 40, 120, 80), quarter)


def test_corners_are_where_the_sides_meet():
    """Though the screen's own are cut off."""
    corners = np.array([(20.0, 30.0), (220.0, 15.0), (210.0, 165.0), (30.0, 150.0)])
    sides = np.roll(corners, -1, 0) - corners
    cut = np.concatenate([(corners + 0.06 * sides), np.roll(corners, -1, 0) - 0.06 * sides], 1).reshape(-1, 2)
    seen = cv2.fillPoly(np.zeros((180, 240)), [np.rint(cut).astype(np.int32)], 1)
    found = corners_of(seen, seen * (np.arange(240) < 100) * (np.arange(180) < 80)[:, None])
    assert found == pytest.approx(corners, abs=1.2)


def test_a_screen_too_small_for_lines_has_the_corners_of_its_pixels(monkeypatch):
    monkeypatch.setattr(calibration, "LEAST", 0.0)
    found = corners_of(screen(50, 60, 8, 7), screen(50, 60, 3, 3))
    assert found.tolist() == [[50, 60], [57, 60], [57, 66], [50, 66]]


def test_a_hull_of_four_corners_keeps_them():
    corners = [[0, 0], [100, 10], [100, 40], [0, 50]]
    assert _quadrilateral(np.array(corners, np.int32)[:, None]).tolist() == corners


def test_four_corners_of_what_has_others():
    triangle = np.array([[[0, 0]], [[40, 0]], [[0, 30]]], np.int32)
    found = _quadrilateral(triangle)
    sides = np.linalg.norm(np.roll(found, -1, 0) - found, axis=1)
    assert sides.prod() == pytest.approx(1_200.0**2)
    x, y = found.T
    # clockwise as seen, where y grows downward: the smallest rectangle has twice the triangle's area
    assert (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() == pytest.approx(2 * 1_200)
    octagon = np.array(
        [[[60, 5]], [[5, 5]], [[0, 10]], [[0, 40]], [[5, 45]], [[60, 45]], [[65, 40]], [[65, 10]]], np.int32
    )
    assert _quadrilateral(octagon).shape == (4, 2)


@pytest.mark.parametrize(
    ("corners", "outer", "inner"),
    [
        # whole pixels stay, others go outward or inward
        ([(3, 4), (10, 4), (10, 9), (3, 9)], (3, 4, 8, 6), (3, 4, 8, 6)),
        ([(3.5, 4.5), (10.5, 4.5), (10.5, 9.5), (3.5, 9.5)], (3, 4, 9, 7), (4, 5, 7, 5)),
        ([(-5.5, -3.2), (245, -1), (250, 190), (-2, 185)], (0, 0, 240, 180), (0, 0, 240, 180)),
        ([(-9, 4), (-4, 4), (-4, 9), (-9, 9)], (0, 4, 1, 6), (0, 4, 1, 6)),
        ([(300, 200), (310, 200), (310, 220), (300, 220)], (239, 179, 1, 1), (239, 179, 1, 1)),
        ([(10.2, 7.2), (10.4, 7.4), (10.6, 7.6), (10.8, 7.8)], (10, 7, 2, 2), (11, 8, 1, 1)),
        ([(1, 2), (20, 8), (16, 40), (5, 30)], (1, 2, 20, 39), (5, 8, 12, 23)),
    ],
)
def test_whole_pixels_around_and_within(corners, outer, inner):
    assert rectangles(np.array(corners, np.float64), (240, 180))[:2] == (outer, inner)


def test_the_share_of_the_sensor_that_a_screen_fills():
    corners = np.array([(10.0, 20.0), (130.0, 20.0), (130.0, 110.0), (10.0, 110.0)])
    assert rectangles(corners, (240, 180))[2] == pytest.approx(0.25)
    assert rectangles(3 * corners, (240, 180))[2] == 1


def test_the_spectrum_is_that_of_counts_under_a_window():
    """By a discrete Fourier transform in loops; events before and after count in the first bin and the last."""
    t = np.array([990, 1_000, 1_499, 1_500, 1_700, 3_200, 3_300, 4_999, 5_000, 5_999, 6_000, 9_000])
    n = t.size
    events = Events(t, np.zeros(n, int), np.zeros(n, int), np.zeros(n, int), (2, 2))
    counts = [3, 2, 0, 0, 2, 0, 0, 1, 1, 3]
    window = [0.5 - 0.5 * np.cos(2 * np.pi * k / 9) for k in range(10)]
    amplitudes = [
        abs(
            sum(
                (c - 1.2) * w * np.exp(-2j * np.pi * f * k / 10)
                for k, (c, w) in enumerate(zip(counts, window, strict=True))
            )
        )
        for f in range(6)
    ]
    noise = (1.2 * sum(w * w for w in window)) ** 0.5
    frequencies, spectrum = spectrum_of(events, 1_000, 5_000)
    assert frequencies.tolist() == [0, 200, 400, 600, 800, 1_000]
    assert spectrum == pytest.approx(np.array(amplitudes) / noise)
    assert not spectrum_of(Events([], [], [], [], (2, 2)), 0, 5_000)[1].any()


def peaks(floor=1.0, **heights):
    frequencies = np.arange(0, 500, 0.25)
    spectrum = np.full(frequencies.size, floor)
    for place, height in heights.items():
        spectrum[int(4 * float(place[1:].replace("_", ".")))] = height
    return frequencies, spectrum


@pytest.mark.parametrize(
    ("spectrum", "expected", "lines"),
    [
        (peaks(), (60.0,), {}),
        (peaks(f300=12.0), (), {}),
        (peaks(f300=12.1), (), {300.0: 12.1}),
        (peaks(f300=12.1), (60.0, 100.0), {300.0: 12.1}),
        # within 1 Hz of where it is expected
        (peaks(f300=50.0, f59=13.0), (60.0,), {59.0: 13.0, 300.0: 50.0}),
        (peaks(f300=50.0, f61=13.0), (60.0,), {61.0: 13.0, 300.0: 50.0}),
        (peaks(f300=50.0, f58_75=13.0), (60.0,), {300.0: 50.0}),
        (peaks(f300=50.0, f61_25=13.0), (60.0,), {300.0: 50.0}),
        (peaks(f300=50.0, f60=13.0, f60_5=14.04), (60.0,), {60.5: 14.0, 300.0: 50.0}),
        # times the noise, which is no less than 1
        (peaks(2.0, f300=24.0), (), {}),
        (peaks(2.0, f300=25.0), (), {300.0: 12.5}),
        (peaks(0.1, f300=11.0), (), {}),
        # slow changes are no flicker
        (peaks(f19_75=99.0, f300=20.0), (), {300.0: 20.0}),
        (peaks(f20=99.0, f300=20.0), (), {20.0: 99.0}),
        (peaks(f300=20.0), (700.0,), {300.0: 20.0}),
    ],
)
def test_which_lines_rise_above_the_noise(spectrum, expected, lines):
    found = lines_of(*spectrum, expected)
    assert list(found.items()) == list(lines.items())


def test_the_noise_is_that_of_what_counts_as_flicker():
    frequencies = np.arange(0, 60, 1.0)
    assert lines_of(frequencies, np.where(frequencies < 20, 50.0, np.where(frequencies == 40, 24.5, 2.0)), ()) == {
        40.0: 12.2
    }


BEGIN = (
    "screen corners, clockwise from the upper left: (10.0, 20.1), (200.0, 12.0), (198.5, 150.0), "
    "(12.0, 160.0); the screen fills 61% of the sensor\n"
    "region of interest: --region {}; largest upright crop: (12, 21, 187, 130)\n"
)


@pytest.mark.parametrize(
    ("roi", "flicker", "result"),
    [
        ((10, 12, 191, 149), {}, "no flicker found"),
        (
            (1, 1, 238, 178),
            {60.0: 13.5, 120.25: 40.0},
            "flicker: 60 Hz (13.5 times the noise), 120.25 Hz (40 times the noise): choose another refresh rate, or a "
            "monitor without flicker",
        ),
        (
            (0, 1, 239, 179),
            {},
            "the screen reaches the edge of the view (left, bottom): move the camera back, or use another lens\n"
            "no flicker found",
        ),
        (
            (1, 0, 239, 179),
            {},
            "the screen reaches the edge of the view (top, right): move the camera back, or use another lens\n"
            "no flicker found",
        ),
    ],
)
def test_a_calibration_in_a_few_lines(roi, flicker, result):
    found = replace(FOUND, roi=roi, flicker=flicker)
    assert calibration_summary(found, (240, 180)) == BEGIN.format(" ".join(map(str, roi))) + result


def test_what_a_calibration_writes(tmp_path, monkeypatch):
    drawn = []

    def curves(*given, **how):
        drawn.append((given, how))
        return np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr(calibration, "curves", curves)
    out = tmp_path / "deep/c"
    write_calibration(replace(FOUND, flicker={60.0: 13.5}), CameraSettings(region=FOUND.roi), (240, 180), out)
    assert sorted(path.name for path in out.iterdir()) == [
        "calibration.json",
        "corners.png",
        "flicker.png",
        "settings.json",
    ]
    assert json.loads((out / "calibration.json").read_text()) == {
        "sensor_size": [240, 180],
        "corners": [[10.04, 20.06], [200.0, 12.0], [198.46, 150.0], [12.0, 160.0]],
        "roi": [10, 12, 191, 149],
        "crop": [12, 21, 187, 130],
        "cover": 0.6123,
        "flicker": {"60.0": 13.5},
    }
    assert json.loads((out / "settings.json").read_text())["region"] == [10, 12, 191, 149]
    ((lines, _, axis), how) = drawn[0]
    ((_, shown),) = lines
    # from 20 to 400 Hz, by halves
    assert shown == pytest.approx((np.arange(40, 801) / 200).tolist())
    assert (axis, how) == ("Hz", {"highest": 12.0, "ends": (20.0, 400.0)})
    write_calibration(replace(FOUND, spectrum=FOUND.spectrum * 10), CameraSettings(), (240, 180), out)
    assert drawn[1][1]["highest"] == pytest.approx(40.0)


def test_the_picture_has_the_response_the_region_and_the_crop():
    seen = np.zeros((60, 80))
    seen[50, 70], seen[51, 70] = 1.0, 0.5
    corners = np.array([[20.0, 10.0], [30.0, 10.0], [30.0, 20.0], [20.0, 20.0]])
    found = replace(FOUND, response=seen, corners=corners, roi=(5, 3, 70, 40), crop=(8, 6, 60, 30))
    picture = _picture(found)
    assert picture.shape == (180, 240, 3)
    assert (picture[150:153, 210:213] == 255).all()
    assert (picture[153:156, 210:213] == 127).all()
    for (x, y, width, height), color in (((5, 3, 70, 40), OFF), ((8, 6, 60, 30), (60, 200, 60))):
        left, top, right, bottom = 3 * x, 3 * y, 3 * (x + width) - 1, 3 * (y + height) - 1
        ring = np.zeros((180, 240), bool)
        ring[top : bottom + 1, left : right + 1] = True
        ring[top + 1 : bottom, left + 1 : right] = False
        assert ((picture == color).all(2) == ring).all()
    # the corners' quadrilateral, at the middle of their pixels
    red = np.argwhere((picture == ON).all(2))
    assert red.min(0).tolist() == pytest.approx([32 - 6, 62 - 6], abs=1)
    assert red.max(0).tolist() == pytest.approx([62, 92], abs=1)
