"""Every registered transform, given what it doesn't take, and sensors and events of unusual sizes."""

import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from test_deterministic import EXAMPLES

from nvsdata import Events, Graph, GraphBatch, metrics, models
from nvsdata import transforms as T
from nvsdata.common import memory
from nvsdata.data.events import Columns
from nvsdata.data.ragged import EventBatch
from nvsdata.data.recording import Recording
from nvsdata.transforms.events.crops import crop_events

SIDE = 32_767  # the largest sensor that events can address
EVENTS = Events([0, 5, 9_999], [0, 3, 5], [1, 0, 3], [0, 1, 1], (6, 4))
GRAPH = T.RadiusGraph()(EVENTS)
UNKNOWN = replace(GRAPH, sensor_size=None)
CALLED_WITH_MORE = T.Age | T.Patch | T.PatchMean | T.TimeBins | T.WithBoxes
EVERY = [transform for transform, _ in EXAMPLES]
CALLED = [transform for transform in EVERY if not isinstance(transform, CALLED_WITH_MORE)]
each = pytest.mark.parametrize("transform", CALLED, ids=repr)


class Memory(Recording):
    """A recording of events that are in memory."""

    def __init__(self, events):
        self.events = events

    @property
    def sensor_size(self):
        return self.events.sensor_size

    @property
    def span(self):
        return (int(self.events.t[0]), int(self.events.t[-1])) if len(self.events) else (0, 0)

    def read(self, start=None, stop=None):
        return self.events.window(start, stop)


FRAMES = torch.rand(3, 30, 40)
KINDS = {
    "Events": EVENTS,
    "Recording": Memory(EVENTS),
    "Graph": GRAPH,
    "Graph of no sensor": UNKNOWN,
    "GraphBatch": GraphBatch.from_graphs([GRAPH, GRAPH]),
    "frames": FRAMES,
    "image": FRAMES[0],
    "row": FRAMES[0, 0],
    "number": torch.tensor(1.0),
    "whole numbers": torch.zeros(3, 30, 40, dtype=torch.int64),
    "empty list": [],
    "Events in a list": [EVENTS, Memory(EVENTS)],
    "Graphs in a list": [GRAPH, GRAPH],
    "tensors in a list": [FRAMES, FRAMES],
    "numbers in a list": [1, 2],
    "None in a list": [None],
    "None": None,
    "text": "abc",
    "int": 3,
    "array": np.zeros((3, 30, 40)),
    "dict": {"t": EVENTS.t},
    "class": Events,
}


def numbers_of(result):
    """How much came out, in tensors, Events and Graphs; AssertionError for anything else, and invalid Events."""
    if isinstance(result, list | tuple):
        return sum(map(numbers_of, result))
    if isinstance(result, Events):
        Events(*result.columns, result.sensor_size, start=result.start, end=result.stated_end)
        return len(result)
    if isinstance(result, Graph):
        return result.num_nodes
    assert isinstance(result, torch.Tensor)
    return result.numel()


def outcome(transform, sample):
    """An error, or how much came out."""
    try:
        return numbers_of(transform(sample))
    except (TypeError, ValueError, MemoryError) as error:
        return error


TOO_SMALL = r"no square|pixels from|can't become|empty|sensor_size|at least one graph|can't stack|make no clip"


@each
def test_a_wrong_kind_of_sample_is_named(transform):
    """Alone, and in a pipeline."""
    if isinstance(transform, T.RandomApply):
        transform = T.RandomApply(transform.transform, 1)
    for kind, sample in KINDS.items():
        for seed, applied in enumerate((transform, transform, T.Compose([transform]))):
            torch.manual_seed(seed)
            found = outcome(applied, sample)
            if isinstance(found, TypeError):
                assert re.match("(sample|samples|graphs) must be .*, not ", str(found)), (kind, found)
            elif isinstance(found, ValueError):
                assert re.search(TOO_SMALL, str(found)), (kind, found)
            else:
                assert not isinstance(found, Exception), kind


@pytest.mark.parametrize("feature", [T.Age(), T.Patch(), T.PatchMean(), T.TimeBins()], ids=repr)
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((EVENTS, EVENTS), "nodes must be a Graph, such as NodeFeatures passes, not Events"),
        ((GRAPH, GRAPH), "events must be Events, such as NodeFeatures passes, not Graph"),
        ((EVENTS, None), "nodes must be a Graph, such as NodeFeatures passes, not NoneType"),
        ((FRAMES, GRAPH), "events must be Events, such as NodeFeatures passes, not Tensor"),
    ],
    ids=["events", "graph", "nothing", "frames"],
)
def test_a_feature_of_something_else_is_named(feature, given, message):
    with pytest.raises(TypeError, match=message):
        feature(*given)


TOO_MUCH = (
    r"32767x32767 pixels need an array of shape \[.*\] \w+, .* GB, and 1.07 GB are free: crop or downsample first"
)


def few(size, count):
    """No event, one in the last corner, or three in corners."""
    right, bottom = size[0] - 1, size[1] - 1
    columns = [7, 8, 8], [right, 0, right], [bottom, bottom, 0], [1, 0, 1]
    return Events(*(np.array(column[:count], int) for column in columns), size)


@each
@pytest.mark.parametrize("size", [(1, 1), (SIDE, 1), (1, SIDE), (SIDE, SIDE)], ids="{0[0]}x{0[1]}".format)
def test_unusual_sensors_and_few_events(transform, size, monkeypatch):
    """A result that is valid, or an error that names the sensor, and what would be allocated."""
    monkeypatch.setattr(memory, "free_memory", lambda: memory.LARGE)
    for count in (0, 1, 3):
        for applied in (transform, T.Compose([transform])):
            found = outcome(applied, few(size, count))
            if isinstance(found, TypeError):
                assert re.match("(sample|samples|graphs) must be ", str(found)), found
            elif isinstance(found, ValueError):
                assert re.search(TOO_SMALL, str(found)), found
                assert "{}x{}".format(*size) in str(found)
            elif isinstance(found, MemoryError):
                assert size == (SIDE, SIDE)
                assert re.match(TOO_MUCH, str(found)), found
                assert applied is transform or "in step 1 of the pipeline" in found.__notes__[0]


def test_memory_that_the_system_refuses_is_reported_alike(monkeypatch):
    def refuse(*_):
        raise MemoryError("Unable to allocate 8 GiB")

    monkeypatch.setattr(np, "zeros", refuse)
    with pytest.raises(
        MemoryError, match=r"^6x4 pixels need an array of shape \[1, 2, 4, 6\] float32, .*system refused"
    ):
        T.EventImage()(EVENTS)


def test_free_memory_is_known():
    assert 1 << 20 < memory.free_memory() <= memory.UNKNOWN


# columns that no `Events(...)` takes
OUTSIDE = {
    "right": {"x": np.array([0, 6, 5], np.int16)},
    "left": {"x": np.array([0, -1, 5], np.int16)},
    "far": {"x": np.array([0, 2, 30_000], np.int16)},
    "below": {"y": np.array([0, 4, 0], np.int16)},
    "above": {"y": np.array([0, -30_000, 0], np.int16)},
    "polarity": {"p": np.array([0, 1, 200], np.uint8)},
    "short": {"y": np.array([0], np.int16)},
}


def outside(where):
    return Events.trusted(Columns(*{**EVENTS.columns._asdict(), **OUTSIDE[where]}.values()), EVENTS.sensor_size)


# what counts, or moves, events without regard to where they lie
PLACELESS = (
    *(T.Center, T.Each, T.DropByArea, T.DropByTime, T.DropEvents, T.KNNGraph, T.MergePolarities, T.NodeFeatures),
    *(T.NonUniformSample, T.Points, T.RadiusGraph, T.RandomAffine, T.RandomApply, T.RandomChoice, T.RandomFlip),
    *(T.RandomPolarityFlip, T.RandomRotate, T.RandomRun, T.RandomScale, T.RandomTimeFlip, T.RandomTimeScale),
    *(T.RandomTranslate, T.RandomWindow, T.RelativeTime, T.SelectPolarity, T.SpatialJitter, T.TimeJitter),
    *(T.UniformNoise, T.RandomWindows, T.Window, T.Compose),
)


@pytest.mark.parametrize("transform", [one for one in CALLED if not isinstance(one, PLACELESS)], ids=repr)
def test_events_outside_their_sensor_are_refused(transform):
    """They would write to memory of others."""
    if isinstance(transform, T.BagOfEvents):
        transform = T.BagOfEvents(1)
    for where in OUTSIDE:
        with pytest.raises((ValueError, TypeError)):
            transform(outside(where))


INVALID = r"must be between|outside the sensor|equally long|polarity"


@pytest.mark.parametrize("where", OUTSIDE)
def test_streams_refuse_events_outside_the_sensor(where):
    events = outside(where)
    for sieve in (T.RefractoryPeriod(5), T.FirstOfBoxes(), T.RateLimit(5), T.Corners()):
        with pytest.raises(ValueError, match=INVALID):
            sieve.begin((6, 4))(events)
    for kind in (T.TAF(), T.TORE(), T.LeakyFrame(), T.TimeSurface()):
        state = kind.state((6, 4))
        with pytest.raises(ValueError, match=INVALID):
            state.update(events)


@pytest.mark.parametrize("where", OUTSIDE)
def test_networks_and_distances_refuse_events_outside_the_sensor(where):
    events = outside(where)
    with pytest.raises(ValueError, match=INVALID):
        metrics.chamfer(events, EVENTS)
    batch = EventBatch(**events.torch(), offsets=torch.tensor([0, 3]), sensor_sizes=((6, 4),))
    with pytest.raises(ValueError, match="outside 6x4 pixels"):
        models.EST(bins=2)(batch)
    network = models.RGCNN(3, sensor_size=(6, 4), channels=(4,), clusters=((2, 2),), hidden=4).eval()
    with pytest.raises(ValueError, match=INVALID):
        models.stream(network).feed(events)


@pytest.mark.parametrize("offsets", [[0, 4], [2, 1], [-1, 3]])
def test_learnt_tensors_refuse_offsets_of_other_events(offsets):
    batch = EventBatch(**EVENTS.torch(), offsets=torch.tensor(offsets), sensor_sizes=((6, 4),))
    with pytest.raises(ValueError, match="events outside 6x4 pixels, or offsets outside its 3 events"):
        models.EST(bins=2)(batch)


def test_a_sieve_of_a_smaller_sensor_refuses_events_outside_it():
    for sieve in (T.RefractoryPeriod(5), T.FirstOfBoxes(side=1), T.RateLimit(5, side=1), T.Corners()):
        with pytest.raises(ValueError, match="events reach 6x4 pixels, outside the sensor of 5x4"):
            sieve.begin((5, 4))(EVENTS)


def test_a_sensor_never_becomes_larger_than_events_can_address():
    line = Events([0, 1, 2], [0, 150, 299], [0, 0, 0], [0, 1, 1], (300, 1))
    with pytest.raises(
        ValueError, match=r"300x1 can't become 76800x256 pixels: events have at most 32767 pixels along an axis"
    ):
        T.Resize(256)(line)
    largest = T.Resize(109)(line)
    assert largest.sensor_size == (32_700, 109)
    assert largest.x.tolist() == [0, 16_350, 32_591]
    # boxes follow up to the same limit
    with pytest.raises(ValueError, match="300x1 can't become 76800x256"):
        T.WithBoxes(T.Resize(256))(line, {"boxes": torch.tensor([[0.0, 0, 9, 1]])})
    # an image isn't limited by what events can address
    assert T.Resize(120)(torch.zeros(1, 1, 300)).shape == (1, 120, 36_000)


@pytest.mark.parametrize("rectangle", [(-1, 0, 2, 2), (0, -1, 2, 2), (0, 0, 0, 2), (0, 0, 2, -1), (5, 0, 2, 2)])
def test_a_crop_lies_within_the_sensor(rectangle):
    with pytest.raises(ValueError, match="a sensor of 6x4 has no"):
        crop_events(EVENTS, *rectangle)


# the axis of the channels, that of ON and that of OFF, and what the docstring says
POLARITIES = [
    (T.EventImage(), 0, (0, 1), "ON first"),
    (T.ToFrames(1), 1, (0, 1), "ON first"),
    (T.TimeSurface(), 0, (0, 1), "ON first"),
    (T.EventSurfaces(1, polarity="both"), 1, (0, 1), "ON first"),
    (T.HATS(), 1, (0, 1), "ON before OFF"),
    (T.TORE(1), 0, (0, 1), "ON comes first"),
    (T.FilterCascade(1), 0, (0, 1), "ON comes first"),
    (T.FourChannels(), 0, (0, 1), "numbers of ON and of OFF"),
    (T.StackedHistogram(1), 0, (1, 0), "all bins of OFF, then all of ON"),
    (T.TAF(1), 0, (1, 0), "OFF comes before ON"),
    (T.GroupTokens(2, 1), 0, (2, 0), "a group of OFF and a group of ON"),
]


@pytest.mark.parametrize(("transform", "axis", "channels", "said"), POLARITIES, ids=repr)
def test_channels_are_those_that_the_docstring_names(transform, axis, channels, said):
    assert said in type(transform).__doc__
    on = Events([0, 1, 2], [1, 1, 1], [1, 1, 1], [1, 1, 1], (3, 3))
    for events, (own, other) in ((on, channels), (T.RandomPolarityFlip(1.0)(on), channels[::-1])):
        found = transform(events).movedim(axis, 0)
        assert found[own].unique().numel() > 1
        assert found[other].unique().numel() == 1
