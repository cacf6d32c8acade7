"""The recording to try things on."""

import numpy as np

import nvsdata
from nvsdata.emulation.example import FINE, SIZE, _fill, example_frames


def test_shapes_move_over_the_sensor_and_are_the_same_each_time():
    events = nvsdata.example()
    assert events == nvsdata.example(0) != nvsdata.example(1)
    assert events.sensor_size == SIZE
    assert 50_000 < len(events) < 80_000
    assert (events.start, events.end) == (0, 500_000)
    # the disc goes from left to right: bright, so ON in front of it
    found = []
    for start in (20_000, 240_000, 460_000):
        part = events.window(start, start + 20_000)
        disc = part.y < 80
        found.append(np.median(part.x[disc & (part.p == 1)]))
    assert found == sorted(found)
    assert found[2] - found[0] > 80


def test_frames_are_drawn_between_pixels():
    frames = list(example_frames())
    assert len(frames) == 126
    assert all(frame.shape == (180, 240) and frame.dtype == np.uint8 for frame in frames)
    # levels between that of the ground and that of the disc
    assert {60, 190} < set(np.unique(frames[3][:100]).tolist())
    assert len(np.unique(frames[3][:100])) > 2


def test_a_polygon_is_filled_at_the_points_inside_it():
    canvas = np.zeros((FINE * 5, FINE * 6), np.int16)
    _fill(canvas, np.array([(1, 1), (4, 1), (4, 3), (1, 3)]), 7)
    assert (canvas[FINE : 3 * FINE, FINE : 4 * FINE] == 7).all()
    assert (canvas == 7).sum() == 6 * FINE**2
