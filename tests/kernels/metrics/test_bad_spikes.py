"""Arrays of wrong sizes, and places outside the frame: errors, never a crash."""

import numpy as np
import pytest

from nvsdata.kernels.metrics.distances import cancel, least_work, nearest_spikes, spikes, sum_polarity

ONE = np.ones(1, np.int64)


@pytest.mark.parametrize("bad", [-1, 20, 2**62, -(2**63)])
@pytest.mark.parametrize("column", [0, 1, 3, 4])
def test_spikes_outside_the_frame(bad, column):
    columns = [ONE] * 6
    columns[column] = bad * ONE
    with pytest.raises(IndexError):
        nearest_spikes(*columns, (20, 20), 1.0, np.inf)


def test_spikes_of_other_sizes():
    with pytest.raises(ValueError, match="differ"):
        nearest_spikes(ONE, ONE, ONE, ONE, ONE[:0], ONE, (20, 20), 1.0, np.inf)
    for shape in ((-1, 20), (20, 2**31)):
        with pytest.raises(ValueError, match="a frame can't have the size"):
            nearest_spikes(*[ONE] * 6, shape, 1.0, np.inf)
    with pytest.raises(ValueError, match="differ"):
        cancel(ONE, ONE, ONE, np.ones(2, np.int64))


@pytest.mark.parametrize(("x", "y"), [(-1, 0), (5, 0), (0, -1), (0, 3), (32767, 32767)])
def test_events_outside_the_frame(x, y):
    x, y = np.array([x], np.int16), np.array([y], np.int16)
    with pytest.raises(IndexError):
        sum_polarity(x, y, np.ones(1, np.uint8), np.zeros((3, 5), np.int32), np.empty(1, np.int64))


def test_events_without_a_place():
    x = np.zeros(2, np.int16)
    with pytest.raises(ValueError, match="differ"):
        sum_polarity(x, x, np.ones(2, np.uint8), np.zeros((3, 5), np.int32), np.empty(1, np.int64))
    with pytest.raises(IndexError):
        spikes(np.zeros((3, 5), np.int32), np.array([15]), 1)


@pytest.mark.parametrize("mass", [0, -1, 2**62, 2**63 - 1, -(2**63)])
def test_masses_that_cannot_be_moved(mass):
    one = np.ones(1)
    for masses in ((mass * ONE, ONE), (ONE, mass * ONE)):
        with pytest.raises(ValueError, match="positive"):
            least_work(one, one, masses[0], one, one, masses[1])


def test_points_that_are_not_there():
    one = np.ones(1)
    with pytest.raises(ValueError, match="no points"):
        least_work(one[:0], one[:0], ONE[:0], one, one, ONE)
    with pytest.raises(ValueError, match="differ"):
        least_work(one, one[:0], ONE, one, one, ONE)


def test_places_that_are_no_numbers_end():
    places = np.array([np.nan, np.inf, -np.inf, 1.0])
    assert isinstance(least_work(places, places, np.ones(4, int), places[::-1], places, np.ones(4, int)), float)
