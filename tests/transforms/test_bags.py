"""Bags of events against the authors' definition: frequency of events times log(segments / (segments with it + 1))."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

from nvsdata import Events
from nvsdata import transforms as T


@given(ev=events(max_size=120, width=5, height=4), count=st.integers(1, 40))
def test_frequencies_in_complete_segments(ev, count):
    found = T.BagOfEvents(count)(ev)
    places = list(zip(ev.x.tolist(), ev.y.tolist(), strict=True))
    segments = [places[i : i + count] for i in range(0, len(places) - count + 1, count)]
    width, height = ev.sensor_size
    expected = [[[segment.count((x, y)) / count for x in range(width)] for y in range(height)] for segment in segments]
    assert found.shape == (len(segments), height, width)
    assert found.dtype == torch.float32
    if segments:
        torch.testing.assert_close(found, torch.tensor(expected))


@given(parts=st.lists(events(max_size=100, width=5, height=4), min_size=1, max_size=4))
def test_weights(parts):
    parts = [Events(*ev.columns, (5, 4)) for ev in parts]
    bags = [T.BagOfEvents(10)(ev) for ev in parts]
    segments = torch.cat(bags)
    if not len(segments):
        with pytest.raises(ValueError, match="bags without any segment"):
            T.bag_weights(iter(bags))
        return
    found = T.bag_weights(iter(bags))
    for y in range(4):
        for x in range(5):
            n = sum(1 for segment in segments if segment[y, x] > 0)
            assert math.isclose(found[y, x], math.log(len(segments) / (n + 1)), abs_tol=1e-6)


def test_what_makes_no_sense():
    for bad in (0, 1.5, -3):
        with pytest.raises(ValueError, match="count"):
            T.BagOfEvents(bad)
    with pytest.raises(ValueError, match=r"bags of different sensors: \[4, 5\] and \[5, 4\]"):
        T.bag_weights([torch.ones(1, 4, 5), torch.ones(1, 5, 4)])
    with pytest.raises(ValueError, match="bags without any segment"):
        T.bag_weights([])
