import os
import warnings
from collections import namedtuple
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trees
from disks import PAGE, file_limit, small_disk
from torch import nn
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import Events, FormatError
from nvsdata import transforms as T
from nvsdata.data.views import Slice
from nvsdata.datasets import ASLANDVS, NMNIST
from nvsdata.datasets.cache.cached import settings_key
from nvsdata.datasets.cache.encoding import decode_sample, encode_sample
from nvsdata.datasets.store.writer import pack

HEAD = (T.Window(0, 80_000), T.RadiusGraph())


def settled(root):
    """The folder, its files long unchanged."""
    for path in root.rglob("*"):
        os.utime(path, ns=(10**18, 10**18))
    return root


@pytest.fixture
def digits(home):
    return settled(home(trees.nmnist()))


def dataset(root, *steps, **options):
    return NMNIST(root, transform=T.Compose(steps) if steps else None, **options)


def same(a, b):
    return all(torch.equal(getattr(a, n), getattr(b, n)) for n in ("x", "pos", "t", "edge_index", "edge_attr"))


@dataclass(frozen=True)
class Gives:
    """A transform of one's own: gives what it was told to."""

    what: Any
    deterministic = True

    def __call__(self, recording):
        return self.what(recording) if callable(self.what) else self.what


@dataclass(frozen=True)
class Times:
    """Another one: the times of events, over `by`."""

    by: int = 1
    deterministic = True

    def __call__(self, recording):
        return torch.from_numpy(recording.read().t // self.by)


def test_the_head_is_made_once_and_the_tail_each_time(digits, tmp_path, monkeypatch):
    plain = dataset(digits, *HEAD)
    cached = nvsdata.cache(dataset(digits, *HEAD, T.RandomTranslate(5)), tmp_path / "cache")
    first, target = cached[7]
    monkeypatch.setattr(NMNIST, "recording", lambda *_: pytest.fail("read again"))
    second, _ = cached[7]
    assert not torch.equal(first.pos, second.pos)
    assert target == plain.targets[7]
    assert cached.classes == plain.classes
    whole = nvsdata.cache(plain, tmp_path / "cache")
    monkeypatch.undo()
    assert same(whole[7][0], plain[7][0])
    assert whole[7][0].sensor_size == (34, 34)


@pytest.mark.parametrize("steps", [(), (T.Window(0, 80_000),), (Times(),)])
def test_events_and_tensors_are_kept(digits, tmp_path, steps):
    for _ in range(2):
        cached = nvsdata.cache(dataset(digits, *steps), tmp_path / "cache")
        given, expected = cached[3], dataset(digits, *steps)[3]
        assert given[1] == expected[1]
        assert torch.equal(given[0], expected[0]) if isinstance(given[0], torch.Tensor) else given[0] == expected[0]
    assert len(list(cached.folder.rglob("*.pt"))) == 1


def test_other_settings_and_options_are_kept_apart(digits, tmp_path):
    def folder(*steps, **options):
        return nvsdata.cache(dataset(digits, *steps, **options), tmp_path).folder

    folders = [
        folder(*HEAD),
        folder(T.Window(0, 70_000)),
        folder(*HEAD, first_saccade=True),
        folder(*HEAD, split="test"),
        folder(Times(1)),
        folder(Times(2)),
    ]
    assert len(set(folders)) == len(folders)
    for others in ({"seed": 3}, {"errors": "skip"}, {"errors": "repair"}, {"target_transform": str}):
        assert folder(*HEAD, T.RandomFlip(), **others) == folders[0]
    assert folder(T.Compose(HEAD), T.RandomFlip()) == folders[0]


class Silent:
    deterministic = True

    def __init__(self, scale):
        self.scale = scale

    def __call__(self, recording):
        return torch.tensor([len(recording.read()) * self.scale])


class Speaks(Silent):
    def __repr__(self):
        return f"Speaks({self.scale})"


class SpeaksForItself(Speaks):
    """What it inherits says nothing of its own settings."""

    def __init__(self, scale, more):
        super().__init__(scale)
        self.more = more


class Shortens(Silent):
    def __repr__(self):
        return f"Shortens({np.zeros(10_000)})"


class Buffers(nn.Module):
    def __init__(self):
        super().__init__()
        self.register_buffer("kept", torch.zeros(3), persistent=False)

    def extra_repr(self):
        return "kept"


class Inherits(Times):
    def __init__(self, scale):
        super().__init__(2)
        object.__setattr__(self, "scale", scale)


class Module(nn.Module):
    def __init__(self, scale):
        super().__init__()
        self.scale = scale


class TellingModule(Module):
    def extra_repr(self):
        return f"scale={self.scale}"


def count(recording):
    return torch.tensor([len(recording.read())])


@pytest.mark.parametrize(
    "transform",
    [
        Silent(1),
        count,
        lambda recording: count(recording),
        partial(count),
        Gives(count),
        Gives([Silent(1)]),
        Gives({1: (len,)}),
        Module(1),
        nn.Sequential(Module(1)),
        nn.Linear(2, 2),
        SpeaksForItself(1, 2),
        Shortens(1),
        Buffers(),
        Gives(np.array([Silent(1)])),
    ],
)
def test_a_transform_must_tell_its_settings(digits, tmp_path, transform):
    if not isinstance(transform, Gives):
        transform.deterministic = True
    for steps in ((transform,), (T.Compose([T.Window(0, 9), transform]),)):
        with pytest.raises(TypeError, match="make it a dataclass whose fields are its settings, or give its class a"):
            nvsdata.cache(dataset(digits, *steps), tmp_path)


def big(last):
    values = np.zeros(10_000)
    values[-1] = last
    return values


@pytest.mark.parametrize(
    "make",
    [
        Speaks,
        Inherits,
        Gives,
        Times,
        TellingModule,
        lambda s: nn.Sequential(TellingModule(s)),
        lambda s: Gives(big(s)),
        lambda s: Gives(torch.from_numpy(big(s))),
        lambda s: Gives({"a": [s, {3, 4}]}),
        lambda s: Gives((float(s), None, Path(str(s)), np.float32(s))),
        lambda s: Gives({1: str, 2: int}[s]),
    ],
)
def test_settings_are_told_apart(make):
    assert settings_key(make(1)) == settings_key(make(1)) != settings_key(make(2))


def test_a_file_that_changed_is_read_anew(digits, tmp_path):
    """Even one of the same size, and one that changes twice within a tick of the clock."""
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    before, path = cached[0][0], digits / cached.samples[0].name
    assert len(list(cached.folder.rglob("*.pt"))) == 1
    for seed in range(5):
        path.write_bytes(trees.atis(trees.some(1000 + seed)))
        now = dataset(digits, *HEAD)[0][0]
        assert same(cached[0][0], now)
        assert same(nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")[0][0], now)
        assert not same(now, before)


def test_a_store_that_was_packed_anew(digits, tmp_path):
    pack(NMNIST(digits, "all"), tmp_path / "a.h5")
    first = nvsdata.cache(dataset(tmp_path / "a.h5", *HEAD), tmp_path / "cache")[0][0]
    trees.put(digits, {"Train/0/00001.bin": trees.atis(trees.some(1000))})
    pack(NMNIST(digits, "all"), tmp_path / "a.h5", overwrite=True)
    second = nvsdata.cache(dataset(tmp_path / "a.h5", *HEAD), tmp_path / "cache")[0][0]
    assert not same(first, second)
    assert same(second, dataset(digits, *HEAD)[0][0])


def test_a_damaged_file_is_made_anew(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    first = cached[0][0]
    file = next(cached.folder.rglob("0.pt"))
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    damages = [b"junk", b"", whole[:-1], whole[: len(whole) // 2]]
    for place in rng.integers(0, len(whole), 20).tolist():
        damages.append(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    for damage in damages:
        file.write_bytes(damage)
        assert same(cached[0][0], first)
        assert file.read_bytes() == whole


def test_several_workers_share_a_cache(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    for _ in range(2):
        loader = DataLoader(cached, 4, num_workers=2, collate_fn=nvsdata.collate)
        counts = [int(n) for batch, _ in loader for n in batch.ptr.diff()]
        assert counts == [dataset(digits, *HEAD)[i][0].num_nodes for i in range(30)]
    assert len(list(cached.folder.rglob("*.pt"))) == 30
    assert not list(cached.folder.rglob("*.part"))


def test_a_pipeline_that_begins_at_random_has_nothing_to_keep(digits, tmp_path):
    with pytest.raises(ValueError, match=r"begins with RandomWindow"):
        nvsdata.cache(dataset(digits, T.RandomWindow()), tmp_path)


SAMPLES = [
    (1, 2),
    [1, 2],
    {"a": torch.ones(2), 3: [None, (True, 2.5, "x", b"y", 1j)]},
    np.float32(2.5),
    np.arange(6, dtype=np.uint16).reshape(2, 3)[:, ::-1],
    np.array(["a"])[:0].astype(np.int8),
    (),
    [[], {}],
]


def equal(a, b):
    """Whether both are the same, of the same types all through."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return equal(list(a.items()), list(b.items()))
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(equal, a, b))
    if isinstance(a, np.ndarray | torch.Tensor):
        return a.dtype == b.dtype and a.shape == b.shape and bool((a == b).all())
    return a == b


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_same_type_cold_and_warm(digits, tmp_path, sample):
    assert equal(decode_sample(memoryview(encode_sample(sample))), sample)
    for _ in range(2):
        cached = nvsdata.cache(dataset(digits, Gives(sample)), tmp_path / "cache")
        assert equal(cached[3][0], sample)
    assert len(list(cached.folder.rglob("*.pt"))) == 1


def test_when_events_begin_and_end_is_kept():
    ev = nvsdata.Events([5], [1], [1], [1], start=0, end=9)
    again = decode_sample(memoryview(encode_sample(ev)))
    assert (again, again.start, again.stated_end) == (ev, 0, 9)
    again = decode_sample(memoryview(encode_sample(nvsdata.Events([5], [1], [1], [1]))))
    assert again.stated_end is None


def test_a_small_part_of_a_large_tensor_is_kept_alone(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, Gives(torch.zeros(100_000)[:2])), tmp_path / "cache")
    cached[0]
    assert next(cached.folder.rglob("*.pt")).stat().st_size < 10_000


Named = namedtuple("Named", "a")


@pytest.mark.parametrize("sample", [frozenset({1}), Named(1), nn.Parameter(torch.ones(1)), np.array(["a"]), [object]])
def test_what_cannot_be_kept_is_named(digits, tmp_path, sample):
    class Makes:
        deterministic = True

        def __repr__(self):
            return "Makes()"

        def __call__(self, recording):
            return sample

    with pytest.raises(TypeError, match="cache"):
        nvsdata.cache(dataset(digits, Makes()), tmp_path)[0]


def test_a_slice_shares_the_cache(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    part = cached[3:9:2]
    assert len(part) == 3
    assert same(part[1][0], cached[5][0])
    assert [path.name for path in cached.folder.rglob("*.pt")] == ["5.pt"]


def test_pairs_are_cached(home, tmp_path, monkeypatch):
    root = settled(home(trees.aslandvs(True)))
    plain = ASLANDVS(root, transform=T.Compose([Times(7)]))
    cached = nvsdata.cache(plain, tmp_path / "cache")
    for _ in range(2):
        ((a, b), same), ((c, d), expected) = cached[2], plain[2]
        assert torch.equal(a, c)
        assert torch.equal(b, d)
        assert same == expected
        monkeypatch.setattr(ASLANDVS, "recordings", lambda *_: pytest.fail("read again"))
        plain = nvsdata.cache(ASLANDVS(root, transform=Times(7)), tmp_path / "cache")


def test_a_full_disk_does_not_end_a_training(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    plain = dataset(digits, *HEAD)
    with file_limit(PAGE // 16), warnings.catch_warnings(record=True) as result:
        warnings.simplefilter("always")
        for i in range(3):
            assert same(cached[i][0], plain[i][0])
    assert len(result) == 1
    assert "samples are made again each time" in str(result[0].message)
    assert not list(cached.folder.rglob("*.p*"))


def test_a_disk_that_fills_up(digits, tmp_path):
    plain = dataset(digits, *HEAD)
    with small_disk(tmp_path / "disk") as resize, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for room in range(PAGE, 24 * PAGE, 3 * PAGE):
            resize(room)
            cached = nvsdata.cache(plain, tmp_path / "disk" / "cache")
            for i in range(8):
                assert same(cached[i][0], plain[i][0])
            assert not list((tmp_path / "disk").rglob("*.part"))
        assert len(list(cached.folder.rglob("*.pt"))) == 8


def test_what_a_killed_run_left_is_swept(digits, tmp_path):
    from nvsdata.common.locks import owner

    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    cached[0]
    host = owner().rpartition("-")[0]
    for name in (f".1.pt.{host}-4194304-abc.part", f".2.pt.{owner()}-abc.part"):
        (cached.folder / "0" / name).write_bytes(b"half")
    nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    assert [path.name for path in cached.folder.rglob("*.part")] == [f".2.pt.{owner()}-abc.part"]


def test_a_damaged_recording_is_replaced_or_repaired(digits, tmp_path):
    broken = digits / "Train/0/00001.bin"
    broken.write_bytes(broken.read_bytes() + b"ab")
    settled(digits)
    with pytest.raises(FormatError):
        nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")[0]
    for errors, place in (("skip", 1), ("repair", 0)):
        for _ in range(2):
            careful = dataset(digits, *HEAD, errors=errors)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                given = nvsdata.cache(careful, tmp_path / "cache")[0][0]
                assert same(given, dataset(digits, *HEAD, errors="repair")[place][0])
            # it is counted, the second time too
            assert list(careful.damaged()) == ["Train/0/00001.bin"]
            cached = nvsdata.cache(careful, tmp_path / "cache")
            assert [path.name for path in cached.folder.rglob("*.pt")] == ["1.pt"]


def test_what_was_worked_out_meanwhile_makes_no_difference(digits, tmp_path):
    plain, asked = dataset(digits, *HEAD), dataset(digits, *HEAD)
    assert asked.split_hash in repr(asked)
    assert nvsdata.cache(plain, tmp_path).folder == nvsdata.cache(asked, tmp_path).folder


def test_draws_depend_on_seed_epoch_and_index(digits, tmp_path):
    def epochs(workers):
        cached = nvsdata.cache(dataset(digits, *HEAD, T.RandomTranslate(9), seed=4), tmp_path / "cache")
        loader = DataLoader(cached, 4, num_workers=workers, collate_fn=nvsdata.collate)
        return [torch.cat([batch.pos for batch, _ in loader]) for _ in range(2)]

    alone, two = epochs(0), epochs(2)
    assert all(map(torch.equal, alone, two))
    assert not torch.equal(*alone)


class OwnCompose(T.Compose):
    deterministic = True

    def __call__(self, sample):
        return torch.tensor([len(super().__call__(sample))])


class Options(NMNIST):
    def __init__(self, *args, stop, **options):
        self.opts = {"stop": stop}
        super().__init__(*args, **options)

    def _view(self, recording):
        return Slice(recording, 0, self.opts["stop"])


def test_a_compose_of_ones_own_is_called_as_it_is(digits, tmp_path):
    own = OwnCompose([T.Window(0, 30_000)])
    plain, cached = dataset(digits, own), nvsdata.cache(dataset(digits, own), tmp_path)
    for _ in range(2):
        assert cached[1][0].equal(plain[1][0])


def test_a_sequence_of_graphs_is_kept_as_far_as_it_is_deterministic(digits, tmp_path):
    graphs = T.Each(T.Compose([T.NonUniformSample(2), T.RadiusGraph()]))
    fixed = T.Each(T.Compose([T.Window(0, 20_000), T.RadiusGraph()]))
    assert not graphs.deterministic
    assert fixed.deterministic
    assert T.Compose([T.Compose([T.Window(0, 30_000)]), fixed]).deterministic
    assert not T.Compose([T.Compose([T.Window(0, 30_000)]), T.RandomScale()]).deterministic
    assert not type("Own", (T.Compose,), {})([T.Window(0, 30_000)]).deterministic

    def steps_kept(*steps):
        return [type(step) for step in nvsdata.cache(dataset(digits, T.Compose(steps)), tmp_path).head.transforms]

    pair = OwnPair()
    assert steps_kept(T.Window(0, 30_000), pair, fixed, T.RandomScale()) == [T.Window, OwnPair, T.Each]
    assert steps_kept(T.Window(0, 30_000), pair, graphs) == [T.Window, OwnPair]
    kept = nvsdata.cache(dataset(digits, T.Compose([T.Window(0, 30_000), pair, fixed])), tmp_path)
    first, again = kept[0][0], kept[0][0]
    assert [graph.edge_index.tolist() for graph in first] == [graph.edge_index.tolist() for graph in again]


@dataclass(frozen=True)
class OwnPair:
    """Two halves of a window."""

    deterministic = True

    def __call__(self, events):
        return [events.window(None, 15_000), events.window(15_000)]


def test_options_of_any_type_are_told_apart(digits, tmp_path):
    for stop in (20_000, 50_000):
        given = Options(digits, "all", stop=stop, errors="skip")
        assert nvsdata.cache(given, tmp_path)[0][0] == given[0][0]


def test_a_cache_within_the_dataset_is_no_class(tmp_path):
    for label in ("ant", "bee"):
        for i in range(3):
            path = tmp_path / label / f"{i}.h5"
            path.parent.mkdir(exist_ok=True)
            nvsdata.write(Events([5, 7 + i], [1, 2], [1, 2], [0, 1], (4, 4)), path)
    (tmp_path / "__pycache__").mkdir()
    settled(tmp_path)
    cached = nvsdata.cache(nvsdata.EventFolder(tmp_path, "all", transform=T.Window(0, 9)), tmp_path / "cache")
    assert len(list(cached)) == 6
    assert list((tmp_path / "cache").rglob("*.pt"))
    assert nvsdata.EventFolder(tmp_path, "all").classes == ["ant", "bee"]
