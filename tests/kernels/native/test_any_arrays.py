"""Every bound function, with each of its arrays of another dtype, shape, order or length: a clear error, or the result.

Calls are recorded from a sample run. An index that leads out of an array stops a build with bounds or sanitizers.
"""

import runpy
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from lookalikes import aedat4_bytes, evt2_bytes, evt3_bytes, evt21_bytes

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.datasets.cache.encoding import decode_sample, encode_sample
from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.kernels import _native
from nvsdata.kernels.decode.clock import UNKNOWN, clock_at
from nvsdata.kernels.graph import spline

WITHOUT_ARRAYS = {"touched", "error_counter", "counted_errors", "cpu_level"}
FUNCTIONS = {name: thing for name, thing in vars(_native).items() if callable(thing) and not isinstance(thing, type)}
NAMES = sorted(name for name in FUNCTIONS if name[0] != "_" and name not in WITHOUT_ARRAYS)
MOST = 2  # calls of a function that are repeated
N = 60


def examples(path):
    return runpy.run_path(str(Path(__file__).parents[1] / path))


def columns_of(n=N):
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 5, (2, n)).astype(np.int16)
    return np.sort(rng.integers(0, 5_000, n)), x, y, rng.integers(0, 2, n).astype(np.uint8)


def whole(*values):
    return np.array(values, np.int64)


def use_files(folder, events):
    for suffix in (".bin", ".dat", ".txt", ".aedat", ".aedat1", ".aedat3"):
        nvsdata.write(events, folder / f"a{suffix}")
    for name, made in (("2", evt2_bytes), ("21", evt21_bytes), ("3", evt3_bytes)):
        (folder / f"{name}.raw").write_bytes(made(events))
        nvsdata.open(folder / f"{name}.raw").triggers()
    (folder / "a.aedat4").write_bytes(aedat4_bytes(events))
    for path in folder.iterdir():
        nvsdata.open(path).read(0, 900)
        nvsdata.open(path, strict=False).read()


def use_graphs(events):
    graph = T.RadiusGraph()(events)
    assert decode_sample(memoryview(encode_sample(graph))).num_edges == graph.num_edges
    batch = nvsdata.collate([(graph, 0)] * 2)[0]
    for pooling in ("max", "average"):
        network = models.RGCNN(3, sensor_size=(6, 5), channels=(4, 6), clusters=((2, 2), (5, 5)), pooling=pooling)
        network(batch).sum().backward()
    network.eval()
    stream = models.stream(network, 900)
    for at in range(0, N, 20):
        stream.feed(events[at : at + 20])
        stream.scores()


def use_emulators():
    for shape in ((9, 20), (9, 20, 3)):
        video = list(np.random.default_rng(0).integers(90, 100, (3, *shape), np.uint8))
        for emulator in (PIX2NVS(mode="CE", refractory=9), PIX2NVS(hue=True), DVS(on=0.01), DVS(cutoff=100)):
            emulator.emulate(video, fps=25)


def use_rest(folder, t, x, y, p):
    n, times, room = N, np.zeros(N, np.int64), np.zeros(N, np.int64)
    columns, words, mask = (t, x, y, p), np.arange(N, dtype=np.uint32), np.zeros(N, bool)
    outputs = lambda m: [np.zeros(m, column.dtype) for column in columns]  # noqa: E731
    for name, length in (("evt2_encode", 1), ("evt21_encode", 1), ("evt3_encode", 3)):
        kind = np.uint16 if length == 3 else np.uint32
        getattr(_native, name)(*columns, np.full(length, -1), np.zeros(9 * n, kind))
    _native.count_shown(t, -1, 28, 6)
    _native.atis_walk(np.zeros(5 * n, np.uint8), 7, whole(*[0] * 10), times, np.zeros((n, 1), np.int64))
    _native.extremes(t, 7, *np.zeros((3, n), np.int64))
    for name in ("unwrap", "go_evenly"):
        getattr(_native, name)(clock_at(UNKNOWN, 0), t.copy(), 7)
    _native.is_jump(1, 2, 32, 3, 4)
    _native.nearest(1, 2, 32)
    _native.kept_words(t, 28, 100, 1000, mask)
    _native.lasting(words)
    _native.late(t[::-1].copy(), room)
    _native.merge_late(whole(3, 9), whole(9, 3), *columns, *outputs(n))
    _native.stable_order(t, np.zeros((2, n), np.int32), np.zeros((2, n), np.uint64))
    _native.moved(t, np.ones(n, np.float32), 3.0, 0, 9_000, room)
    _native.copy_where(p == 1, *columns, *outputs(n))
    for kind in (np.int32, np.int64):
        _native.copy_at(np.arange(n, dtype=kind), *columns, *outputs(n))
    with (folder.parent / "bytes").open("w+b") as file:
        file.write(bytes(13 * n))
        file.flush()
        _native.read_samples(file.fileno(), 0, 9, np.zeros((5, 3), np.uint8))
    table = np.array([0, n, 0], np.int64).view(np.uint8)
    for wide, narrow in ((8, 2), (4, 1)):
        raw = np.zeros(n * (wide + 2 * narrow + 1), np.uint8)
        _native.unpack_blocks(*outputs(n), 0, 0, 900, raw, table, 0, wide, narrow, 30, 20)
    _native.blocks_between(table, 0, 100, 900)
    _native.record_head(np.zeros(96, np.uint8), 900)
    _native.crc32c(raw)
    _native.expand_lzf(raw, np.zeros(90, np.uint8))
    _native.expand_ecf(raw, np.zeros(90, np.uint64))
    names, ends, slots = np.frombuffer(b"b/1\0a/0\0b\0", np.uint8).copy(), whole(3, 7, 9), np.zeros(8, np.uint32)
    ends = ends.astype(np.uint32)
    _native.enter_names(names, ends, slots)
    _native.find_name(names, ends, slots, names[:3])
    _native.folders_of_names(names, ends, np.zeros(3, np.uint32))
    _native.sort_names(names, ends, True, np.arange(3, dtype=np.uint32))
    for kind, narrow in ((np.uint32, np.uint8), (np.int64, np.uint16)):
        _native.marked_range(t.astype(kind), 0, 100, 900)
        _native.stored_window(*outputs(n), 0, 100, 900, t.astype(kind), x.astype(narrow), y.astype(narrow), p)
    _native.in_rectangle(x, y, 1, 1, 3, 3, mask)
    _native.logarithms(t, mask, 0.0, 9.0, np.zeros(n, np.float32))
    _native.ages_of_bins(
        900,
        9,
        np.ones((2, 3, 4, 5), np.int64),
        np.ones((2, 3, 4, 5, 2)),
        np.ones((2, 3, 4), np.int64),
        np.zeros((5, 2, 3, 4), np.float32),
    )
    _native.nonuniform_sample(t, x, y, 3, 1.0, 1.0, 1, mask)
    _native.merged_pixels(*columns, np.zeros((n, 2), np.float32), times, *(np.zeros((n, 2), kind) for kind in "qf"))
    _native.patch_counts(x, y, p, np.ones((4, 2), np.float32), np.zeros((4, 2, 3, 3), np.float32))
    for kind in (np.int32, np.float32):
        _native.logarithm(x.astype(kind), 1.0, 1.0, np.zeros(n, np.float32))
    _native.find_dirty(*np.zeros((2, 9, 30), np.uint8), 3, np.zeros((2, 10), bool))
    _native.read_keys(np.arange(n, dtype=np.uint64), 6, 0, *outputs(n))
    _native.read_out(t, x, y, 6, np.zeros(30, np.int64), 5, 1.0, 0.0, 0, room, mask)
    _native.receptor_rates(np.ones(n), 3, 0.1, np.zeros(n))
    _native.davis_encode(*columns, whole(0, -1, -1), np.zeros(4 * n, np.uint16))
    _native.davis_measure(
        np.ones((4, 12), np.int64), 1, 1.0, 1.0, *np.zeros((2, 4, 3), np.float32), np.zeros(4, np.float32)
    )
    examples("recording/test_davis_stream.py")["kernel"].decode(
        **examples("recording/test_davis_stream.py")["arguments"]()
    )
    degree, source = np.zeros(n, np.int32), np.zeros((n, 5), np.int32)
    for kind in (np.int16, np.int32):
        _native.near_sources(t, x.astype(kind), y.astype(kind), 3.0, 1.0, 1e-6, 0, degree, source)
        sums = np.zeros((5, 6), np.int32 if kind is np.int16 else np.int64)
        places = room.copy()
        count = _native.sum_polarity(x.astype(kind), y.astype(kind), p, sums, places)
        _native.spikes(sums, places[:count].copy(), *np.zeros((3, count), np.int64))
    edges = np.zeros((2, degree.sum()), np.int64)
    _native.listed_edges(degree, source, edges)
    _native.earlier_sources(t, x.astype(np.int32), y.astype(np.int32), 6, 5, 3.0, 1.0, 1e-6, degree, source)
    pos = np.stack((x, y), 1).astype(np.float32)
    _native.pseudo_coordinates(pos, t, edges, 3.0, 3.0, 900.0, True, np.zeros((edges.shape[1], 3), np.float32))
    for kind in "fd":
        u, features = np.full((edges.shape[1], 2), 0.3, kind), np.ones((n, 2), kind)
        _native.check_edges(*edges, u, n)
        _native.with_self_loops(
            *edges, u, 0.5, np.zeros((2, edges.shape[1] + n), np.int64), np.zeros((edges.shape[1] + n, 2), kind)
        )
        _, _, row, of, share = spline.spline_plan(*edges, u, 3, n)
        for channels in (1, 2):
            sums = spline.dense_sums(*edges, u, 3, np.ones((n, channels), kind))
            spline.dense_gradient(*edges, u, 3, sums, n)
        spline.add_shares(np.zeros((row.max() + 1, 2), kind), row, features, of, share)
        spline.add_rows(features, t % n, features.copy())
    _native.nearest(*np.arange(9).reshape(3, 3), *np.arange(9).reshape(3, 3), 9, 9, 1.0, 99.0, np.zeros(3))
    _native.nearest(*np.arange(9).reshape(3, 3), *np.arange(9).reshape(3, 3), 19, 19, 1.0, 99.0, np.zeros(3))
    _native.cancel(t, room, t.copy(), room.copy())
    _native.least_work(*np.ones((2, 3)), whole(1, 2, 3), *np.zeros((2, 2)), whole(1, 1))
    for make in ("sliding", "causal"):
        network = examples("streaming/test_state.py")[make]()
        network.step(0, *columns)
        network.hidden, network.shown, network.products, len(network)
    network = examples("streaming/test_state.py")["sliding"]()
    network.step(0, *columns)
    network.count_before(900), network.events()


def copied(thing):
    if isinstance(thing, tuple):
        return tuple(map(copied, thing))
    return thing.copy() if isinstance(thing, np.ndarray) else thing


def plain(thing):
    """A result, or arguments, to compare."""
    if isinstance(thing, tuple):
        return tuple(map(plain, thing))
    return thing.tobytes() if isinstance(thing, np.ndarray) else thing if isinstance(thing, int | float) else None


def read_only(array):
    array.flags.writeable = False
    return array


def strided(array):
    wide = np.zeros((*array.shape[:-1], 2 * array.shape[-1]), array.dtype)
    wide[..., ::2] = array
    return wide[..., ::2]


CHANGES = {
    "other dtype": lambda array: array.astype(np.complex64),
    "no array": lambda array: array.tolist(),
    "none": lambda array: None,
    "strided": strided,
    "in Fortran's order": np.asfortranarray,
    "read-only": read_only,
    "no rows": lambda array: array[:0],
    "a row less": lambda array: array[:-1].copy(),
    "a column less": lambda array: array[..., :-1].copy(),
    "a row more": lambda array: np.concatenate((array, array[-1:])),
    "another dimension": lambda array: array[None],
}
SAME = "strided", "in Fortran's order", "read-only"  # the same values
OF_ANOTHER_KIND = "other dtype", "no array", "none", "another dimension"


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """Arguments of calls of each bound function."""
    found, folder = {name: [] for name in NAMES}, tmp_path_factory.mktemp("files")

    def recorder(name, function):
        def call(*args):
            if len(found[name]) < MOST:
                found[name].append(copied(args))
            return function(*args)

        return call

    columns = columns_of()
    events = Events(*columns, (6, 5))
    with pytest.MonkeyPatch.context() as patch:
        for name in NAMES:
            patch.setattr(_native, name, recorder(name, getattr(_native, name)))
        use_rest(folder, *columns)
        use_files(folder, events)
        use_graphs(events)
        use_emulators()
        for call in examples("represent/test_refused.py")["ALL"].values():
            call(*columns_of(5000))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_arrays_that_do_not_fit(calls, name):
    assert calls[name]
    function = getattr(_native, name)
    for args in calls[name]:
        # a network's state would change
        repeats = all(isinstance(argument, np.ndarray | int | float) for argument in args)
        after = copied(args)
        result = plain(function(*after)) if repeats else None
        for place, what in product(range(len(args)), CHANGES):
            if not (isinstance(args[place], np.ndarray) and args[place].size):
                continue
            given = [*copied(args)]
            given[place] = CHANGES[what](given[place])
            error = None
            try:
                found = plain(function(*given))
            except (TypeError, ValueError, IndexError) as raised:
                error = raised
            if error:
                assert f"{name}(): " in str(error), (what, place)
            if what in OF_ANOTHER_KIND:
                assert isinstance(error, TypeError), (what, place)
                assert f"argument {place + 1} must be" in str(error), (what, place)
            if what in SAME and repeats and not error:
                assert (found, plain(tuple(given))) == (result, plain(after)), (what, place)


def test_first_of_several_types_is_named():
    wrong = [np.zeros(3)] * 5
    with pytest.raises(TypeError, match=r"sum_polarity\(\): argument 1 must be ndarray\[dtype=int16, "):
        _native.sum_polarity(*wrong)
    right = [np.zeros(3, kind) for kind in (np.int32, np.int32, np.uint8)]
    with pytest.raises(TypeError, match=r"sum_polarity\(\): argument 4 must be ndarray\[dtype=int32, "):
        _native.sum_polarity(*right, *wrong[3:])
