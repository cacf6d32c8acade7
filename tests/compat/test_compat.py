"""Events as other libraries have them, and back; other libraries' transforms beside ours."""

import numpy as np
import pytest
import torch
from hypothesis import given
from strategies import events as any_events

import nvsdata
from nvsdata import Events, compat
from nvsdata import transforms as T


@given(any_events())
def test_there_and_back(events):
    size = events.sensor_size
    assert compat.from_metavision(compat.to_metavision(events), size) == events
    assert compat.from_tonic(compat.to_tonic(events), (*size, 2)) == events
    assert compat.from_dict(compat.to_dict(events), size) == events
    assert compat.from_dict(events.torch(), size) == events


def test_types_are_those_of_the_others():
    events = Events([5, 7], [1, 2], [3, 4], [0, 1], (8, 6))
    cd = compat.to_metavision(events)
    assert cd.dtype.descr == [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")]
    assert cd.tolist() == [(1, 3, 0, 5), (2, 4, 1, 7)]
    array = compat.to_tonic(events)
    assert array.dtype.names == ("x", "y", "t", "p")
    assert array.tolist() == [(1, 3, 5, False), (2, 4, 7, True)]
    with pytest.raises(ValueError, match="the events have no p, t; their keys are x, y"):
        compat.from_dict({"x": [1], "y": [2]})


def test_files_of_numpy(tmp_path):
    events = nvsdata.example().window(0, 20_000)
    np.savez(tmp_path / "a.npz", **compat.to_dict(events))
    assert compat.from_dict(np.load(tmp_path / "a.npz"), events.sensor_size) == events


def test_event_stores():
    pytest.importorskip("dv_processing")
    events = nvsdata.example().window(0, 20_000)
    store = compat.to_event_store(events)
    assert store.size() == len(events)
    assert compat.from_event_store(store, events.sensor_size) == events
    assert len(compat.from_event_store(compat.to_event_store(Events.empty((5, 5))))) == 0


def test_event_stores_without_dv(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "dv_processing", None)
    with pytest.raises(ImportError, match="pip install dv-processing"):
        compat.to_event_store(Events.empty((5, 5)))


class TimesTwo:
    """As tonic's transforms: an array of events in, one out."""

    def __call__(self, array):
        out = array.copy()
        out["t"] *= 2
        return out[out["p"]]


def test_transforms_of_others_in_our_pipelines():
    events = nvsdata.example()
    pipeline = T.Compose([T.Window(0, 50_000), compat.FromTonic(TimesTwo()), T.ToFrames(4)])
    on = T.Window(0, 50_000)(events)
    assert int(pipeline(events).sum()) == int((on.p == 1).sum())
    doubled = compat.FromTonic(TimesTwo())(on)
    assert doubled.t[-1] > 90_000
    assert doubled.sensor_size == events.sensor_size
    assert compat.FromTonic(lambda array: np.zeros((2, 3)))(events).shape == (2, 3)


def test_our_transforms_in_others_pipelines():
    events = nvsdata.example().window(0, 50_000)
    array = compat.to_tonic(events)
    frames = compat.ForTonic(T.ToFrames(4), (240, 180, 2))(array)
    # an array doesn't say for how long the camera looked: from its first event to its last
    assert torch.equal(frames, T.ToFrames(4)(compat.from_tonic(array, (240, 180))))
    kept = compat.ForTonic(T.BackgroundActivity(5_000), (240, 180, 2))(array)
    assert kept.dtype == array.dtype
    assert compat.from_tonic(kept, (240, 180)) == T.BackgroundActivity(5_000)(events)


def test_tonics_own_transforms():
    tonic = pytest.importorskip("tonic")
    events = nvsdata.example().window(0, 50_000)
    size = (240, 180, 2)
    theirs = compat.FromTonic(tonic.transforms.ToFrame(sensor_size=size, n_time_bins=1))(events)
    # tonic leaves out the events of the last µs
    assert int(theirs.sum()) == int((events.t < events.t[-1]).sum())
    denoised = compat.FromTonic(tonic.transforms.Denoise(filter_time=5_000))(events)
    assert 0 < len(denoised) < len(events)
    both = tonic.transforms.Compose(
        [tonic.transforms.Denoise(filter_time=5_000), compat.ForTonic(T.VoxelGrid(3), size)]
    )
    assert both(compat.to_tonic(events)).shape == (3, 180, 240)
