"""Times anywhere between ±2^62 µs: every transform, file, batch and network sees the same events, or says it can't."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from graphs import same
from test_deterministic import EXAMPLES

import nvsdata
from nvsdata import EventFolder, Events, GraphBatch, collate, models
from nvsdata import transforms as T
from nvsdata.data.graph import Graph
from nvsdata.datasets.store.writer import pack
from nvsdata.formats.registry import FORMATS
from nvsdata.models.clusters import clusters_cpu, clusters_torch

LAST = 2**62 - 1  # µs, the latest time
LONG = 199_500  # µs that the examples last
SHIFTS = (-LAST, -(10**6), -LONG, 2**31, 2**32, 2**53, LAST - LONG)
TIMED = [(transform, sample) for transform, sample in EXAMPLES if "Events" in str(sample)]


def columns(n, t):
    """Events of `n` pixels in turn, at times `t`."""
    index = np.arange(n)
    return Events(t, index * 7 % 60, index * 11 % 40, index % 2, (60, 40))


def shifted(sample, by):
    """The sample, with all of its events `by` µs later."""
    if isinstance(sample, list | tuple):
        return type(sample)(shifted(part, by) for part in sample)
    if not isinstance(sample, Events):
        return sample
    end = None if sample.stated_end is None else sample.stated_end + by
    return Events(sample.t + by, *sample.columns[1:], sample.sensor_size, start=sample.start + by, end=end)


def equal(a, b):
    """Whether two results are the same, bit by bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[name], b[name]) for name in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(equal, a, b))
    if isinstance(a, Events):
        return a == b and (a.start, a.end) == (b.start, b.end)
    return same(a, b) if isinstance(a, Graph) else torch.equal(a, b)


def alike(transform, found, expected):
    """Compare results; events that choose among stretched pixels by their times may choose a neighbor."""
    if not isinstance(transform, T.Undistort):
        return equal(found, expected)
    near = all(np.abs(a.astype(int) - b).max() <= 1 for a, b in ((found.x, expected.x), (found.y, expected.y)))
    columns = (found.t, expected.x, expected.y, found.p, found.sensor_size)
    return near and equal(Events(*columns, start=found.start, end=found.end), expected)


def applied(transform, sample):
    torch.manual_seed(3)
    return transform(*sample) if isinstance(sample, tuple) else transform(sample)


def test_all_transforms_of_events_are_here():
    assert len(TIMED) > 50
    assert {T.RadiusGraph, T.VoxelGrid, T.TORE, T.HATS, T.RandomWindow} <= {type(transform) for transform, _ in TIMED}


@pytest.mark.parametrize(("transform", "sample"), TIMED, ids=lambda thing: str(thing) if callable(thing) else "")
def test_a_shift_in_time_changes_nothing_else(transform, sample):
    plain = applied(transform, sample)
    for by in SHIFTS:
        # what counts from 0 stays there
        expected = plain if isinstance(transform, T.RelativeTime) else shifted(plain, by)
        try:
            found = applied(transform, shifted(sample, by))
        except ValueError as error:
            assert by in (-LAST, LAST - LONG)
            assert "µs after scaling" in str(error)  # noqa: PT017 - it may also succeed
        else:
            assert alike(transform, found, expected), by


@pytest.mark.parametrize(("transform", "sample"), TIMED, ids=lambda thing: str(thing) if callable(thing) else "")
def test_events_at_one_moment_are_taken_anywhere(transform, sample):
    """What is finite at one place in time is the same at all."""
    if isinstance(sample, tuple):
        once = (Events(np.zeros_like(sample[0].t), *sample[0].columns[1:], (60, 40)), *sample[1:])
    elif isinstance(sample, list):
        once = [Events(np.zeros_like(part.t), *part.columns[1:], (60, 40)) for part in sample]
    else:
        once = Events(np.zeros_like(sample.t), *sample.columns[1:], (60, 40))
    plain = applied(transform, once)
    assert all(tensor.isfinite().all() for tensor in tensors(plain))
    for by in (-LAST, LAST):
        expected = plain if isinstance(transform, T.RelativeTime) else shifted(plain, by)
        try:
            found = applied(transform, shifted(once, by))
        except ValueError as error:
            assert "µs after scaling" in str(error)  # noqa: PT017
        else:
            assert alike(transform, found, expected)


def tensors(thing):
    """All tensors of floats in a result."""
    if isinstance(thing, list | tuple):
        return [tensor for part in thing for tensor in tensors(part)]
    if isinstance(thing, dict):
        return tensors(list(thing.values()))
    if isinstance(thing, Graph):
        return [thing.x, thing.pos, thing.edge_attr]
    return [thing] if isinstance(thing, torch.Tensor) else []


@pytest.mark.parametrize("by", [0, *SHIFTS])
def test_falling_times_are_sorted_wherever_they_are(by):
    t = np.arange(400) * 500
    ev = columns(400, t)
    backwards = Events(t[::-1] + by, ev.x[::-1], ev.y[::-1], ev.p[::-1], (60, 40))
    assert equal(backwards, shifted(ev, by))
    rng = np.random.default_rng(0)
    # in any order; quarters in turn; and only a few events are late
    for order in (rng.permutation(400), np.arange(400).reshape(4, 100).T.ravel(), [*range(3, 399), 1, 399, 0, 2]):
        assert equal(Events(t[order] + by, ev.x[order], ev.y[order], ev.p[order], (60, 40)), shifted(ev, by))
    # digits sort what is long enough
    many = columns(4_000, np.arange(4_000))
    order = rng.permutation(4_000)
    assert equal(Events(*(column[order] for column in (many.t + by, *many.columns[1:])), (60, 40)), shifted(many, by))


# what files of each format can hold, in µs
WRAPPING = (0, 2**32 - 2)
FILES = {
    "hdf5": (".h5", -LAST, LAST),
    "hdf5-gzip": (".hdf5", -LAST, LAST),
    "text": (".txt", -LAST, LAST),
    "npy": (".npy", -LAST, LAST),
    "aedat4": (".aedat4", -LAST, LAST),
    "aedat3": (".aedat3", 0, LAST),
    "aedat2": (".aedat", *WRAPPING),
    "aedat1": (".aedat1", *WRAPPING),
    "prophesee-dat": (".dat", *WRAPPING),
    "atis": (".bin", 0, 2**33 - 1),
    "evt2": (".raw", 0, 2**51 - 1),
    "evt2.1": (".raw", 0, 2**51 - 1),
    "evt3": (".raw", 0, 2**40 - 1),
}


def test_all_formats_that_are_written_are_here():
    assert {one.name for one in FORMATS.loaded() if one.write} == FILES.keys()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("by", [0, 2**40 - LONG - 1, 2**32 - LONG - 2, *SHIFTS])
def test_a_file_holds_the_same_events_or_says_which_it_can(tmp_path, name, by):
    ev = shifted(columns(400, np.arange(400) * 500), by)
    suffix, first, last = FILES[name]
    path = tmp_path / f"a{suffix}"
    if first <= ev.t[0] and ev.t[-1] <= last:
        nvsdata.write(ev, path, format=name)
        recording = nvsdata.open(path, sensor_size=(60, 40))
        assert all(np.array_equal(a, b) for a, b in zip(recording.read().columns, ev.columns, strict=True))
        middle = int(ev.t[200])
        assert recording.read(middle, middle + 501).t.tolist() == [middle, middle + 500]
    else:
        with pytest.raises(ValueError, match=r"supports (those|times from|a first time)"):
            nvsdata.write(ev, path, format=name)
        assert not list(tmp_path.iterdir())


def test_a_store_holds_times_of_any_place(tmp_path):
    (tmp_path / "data/a").mkdir(parents=True)
    recordings = [shifted(columns(400, np.arange(400) * 500), by) for by in (0, *SHIFTS)]
    for number, ev in enumerate(recordings):
        nvsdata.write(ev, tmp_path / f"data/a/{number}.h5")
    pack(EventFolder(tmp_path / "data"), tmp_path / "a.h5")
    store = EventFolder(tmp_path / "a.h5")
    assert [store[number][0] for number in range(len(store))] == recordings


@pytest.mark.parametrize("by", SHIFTS)
def test_the_mean_time_of_pooled_nodes_is_exact_anywhere(by):
    """A sum of 400 times at 2^53 fits int64, one of dates of 2026 in µs and 6,000 nodes doesn't."""
    batch = GraphBatch.from_graphs([T.RadiusGraph()(columns(400, np.arange(400) * 500))] * 2)
    # the graphs of a batch needn't be at one time
    late = replace(batch, t=torch.cat((batch.t[:400], batch.t[400:] + by)))
    for structure in (clusters_cpu, clusters_torch):
        cluster, _, t, *_ = structure(late, (17, 9), (4, 5))
        members = [late.t[cluster == number].tolist() for number in range(len(t))]
        assert t.tolist() == [sum(times) // len(times) for times in members]


def test_batches_and_networks_see_no_shift():
    model = models.RGCNN(10, sensor_size=(60, 40)).eval()
    make = T.Compose([T.Window(0, 100_000), T.RadiusGraph()])
    ev = columns(400, np.arange(400) * 500)
    with torch.no_grad():
        plain = model(GraphBatch.from_graphs([make(ev), make(ev)]))
        for by in SHIFTS:
            graphs = [make(shifted(ev, by)), make(ev)]
            batch = collate([(graph, 0) for graph in graphs])[0]
            assert same(batch, GraphBatch.from_graphs(graphs))
            assert torch.equal(model(batch), plain)
            rows = collate([(shifted(ev, by), 0), (ev, 1)], events="columns")[0]
            assert (rows.t[:400] - by).equal(rows.t[400:])
            assert rows.durations.tolist() == [LONG, LONG]
            assert torch.equal(*models.EST(3)(rows))
