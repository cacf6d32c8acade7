import numpy as np
import pytest

from nvsdata import Events
from nvsdata import transforms as T
from nvsdata.training.actions import Actions
from nvsdata.training.objects import Objects


def events(duration):
    t = np.arange(0, duration, 10)
    return Events(t, t % 7, t % 5, t % 2, (8, 8))


def test_only_the_length_changes():
    pipeline = Objects("cifar10-dvs").pipeline(training=False, within=(0.2, 0.4))
    assert T.window_length(pipeline) == 30_000
    other = T.with_window_length(pipeline, 7_500)
    assert repr(other) == repr(pipeline).replace("30000", "7500")
    assert T.with_window_length(other, 30_000) == pipeline


def test_the_last_window_is_what_the_network_sees():
    pipeline = Actions(duration=500_000, graphs=16).pipeline(training=False)
    assert T.window_length(pipeline) == 33_333
    other = T.with_window_length(pipeline, 10_000)
    assert other.transforms[0] == T.RandomWindow(500_000)
    assert other.transforms[1] == T.RandomWindows(16, 10_000)


def test_a_longest_window_fits():
    assert T.longest_window(T.RandomWindow(10), events(1000)) == 991
    assert T.longest_window(T.RandomWindows(4, 10), events(1000)) == 991 // 4
    # in what is cut out of the recording first
    within = T.Compose([T.RandomWindow(400), T.RandomWindows(4, 10)])
    assert T.longest_window(within, events(1000)) <= 100
    assert T.longest_window(T.RandomWindows(4, 10), events(10)) == 1


@pytest.mark.parametrize("pipeline", [T.Compose([T.RadiusGraph()]), T.Window(0, 10), T.Points(8)])
def test_without_windows_there_is_no_length(pipeline):
    assert T.window_length(pipeline) is None
    with pytest.raises(ValueError, match="RandomWindow or RandomWindows is needed, not"):
        T.with_window_length(pipeline, 10)
    with pytest.raises(ValueError, match="RandomWindow or RandomWindows is needed, not"):
        T.longest_window(pipeline, events(10))
