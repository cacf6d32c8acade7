"""The files of a cache, and which samples are in them."""

from __future__ import annotations

import io
import json
import os
import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trees
from torch import nn

import nvsdata
from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.common.files import sealed, unsealed
from nvsdata.datasets.cache import encoding
from nvsdata.datasets.cache.cached import settings_key
from nvsdata.datasets.cache.encoding import decode_sample, encode_sample


@pytest.fixture
def digits(home):
    root = home(trees.nmnist())
    for path in root.rglob("*"):
        # long unchanged
        os.utime(path, ns=(10**18, 10**18))
    return root


def made(cached):
    return sorted(path.relative_to(cached.folder).as_posix() for path in cached.folder.rglob("*.pt"))


def test_a_thousand_samples_share_a_folder(digits, tmp_path):
    dataset = NMNIST(digits, transform=T.Window(0, 100)).subset([0] * 2_001)
    cached = nvsdata.cache(dataset, tmp_path / "cache")
    for index in (0, 999, 1_000, -1):
        cached[index]
    assert made(cached) == ["0/0.pt", "0/999.pt", "1/1000.pt", "2/2000.pt"]
    assert re.fullmatch("[0-9a-f]{16}", cached.folder.name)
    assert len(cached) == 2_001
    for index in (2_001, -2_002):
        with pytest.raises(IndexError):
            cached[index]
    for path in cached.folder.rglob("*.pt"):
        assert unsealed(path) is not None
    assert (tmp_path / "cache/CACHEDIR.TAG").read_bytes().startswith(b"Signature: 8a477f597d28d172789f06886806bc55\n")


def test_a_cache_travels_and_tells_of_itself(digits, tmp_path):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100)), tmp_path / "cache")
    cached[3]
    again = pickle.loads(pickle.dumps(cached))
    assert again[3] == cached[3]
    assert made(again) == ["0/3.pt"]
    assert repr(cached) == f"{cached.dataset!r}\n    cached: Compose([Window(start=0, stop=100)]) in {cached.folder}"
    with pytest.raises(AttributeError, match="has no attribute 'no_such'"):
        cached.no_such  # noqa: B018


def test_the_head_ends_where_chance_begins(digits, tmp_path):
    steps = [T.Window(0, 100), T.Window(0, 90), T.RandomFlip(), T.Window(0, 80)]
    cached = nvsdata.cache(NMNIST(digits, transform=T.Compose([steps[0], T.Compose(steps[1:])])), tmp_path)
    assert (cached.head.transforms, cached.tail.transforms) == (steps[:2], steps[2:])
    whole = nvsdata.cache(NMNIST(digits, transform=steps[0]), tmp_path)
    assert (whole.head.transforms, whole.tail.transforms) == (steps[:1], [])
    bare = nvsdata.cache(NMNIST(digits), tmp_path)
    assert (bare.head.transforms, bare.tail.transforms) == ([], [])
    assert len({cached.folder, whole.folder, bare.folder}) == 3


def test_what_does_not_say_that_it_gives_the_same_is_not_kept(digits, tmp_path):
    with pytest.raises(
        ValueError, match=r"nothing to keep: the pipeline begins with <function .*, which isn't determi"
    ):
        nvsdata.cache(NMNIST(digits, transform=lambda recording: recording), tmp_path)


def test_nothing_is_tried_again_on_a_disk_that_is_full(digits, tmp_path, monkeypatch):
    tried = []

    def fails(*given):
        tried.append(given)
        raise OSError("full")

    monkeypatch.setattr("nvsdata.datasets.cache.cached._save", fails)
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100)), tmp_path)
    with pytest.warns(UserWarning, match="can't be written to, samples are made again each time: full"):
        cached[0]
    for index in (0, 1):
        assert cached[index] == cached.dataset[index]
    assert len(tried) == 1


class Harmful:
    """Unpickling it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_a_file_of_a_cache_runs_no_code(digits, tmp_path):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100)), tmp_path / "cache")
    cached[0]
    out = io.BytesIO()
    torch.save({"stamps": cached._stamps(0), "parts": [["value", Harmful(tmp_path / "made")]]}, out)
    (cached.folder / "0/0.pt").write_bytes(sealed(out.getvalue()) + out.getvalue())
    assert cached[0] == cached.dataset[0]
    assert not (tmp_path / "made").exists()


def rewritten(path, change):
    """Put in the place of a sample's file what `change` makes of its JSON and its numbers, soundly sealed."""
    line, rest = bytes(unsealed(path)).split(b"\n", 1)
    numbers = bytearray(rest[-(len(line) + 1) % 16 :])
    stated = json.loads(line)
    stated = change(stated, numbers) or stated
    line = (stated if isinstance(stated, str) else json.dumps(stated)).encode() + b"\n"
    content = line + bytes(-len(line) % 16) + numbers
    path.write_bytes(sealed(content) + content)


def put_first(kind, value):
    """A change of the first number of a type."""

    def change(stated, numbers):
        view = np.frombuffer(numbers, kind)
        view[0] = value

    return change


def at(value, *place):
    """A change of the JSON of the first part at a place."""

    def change(stated, numbers):
        part = stated[1][1][1][0]
        for step in place[:-1]:
            part = part[step]
        part[place[-1]] = value

    return change


def dropped(stated, numbers):
    del numbers[-16:]


HOSTILE = {
    "unsorted times": put_first(np.int64, 2**61),
    "times beyond 2^62": put_first(np.int64, -(2**63)),
    "a small sensor": at([1, 1], 2),
    "no sensor": at([0, -5], 2),
    "a wide sensor": at([10**9, 34], 2),
    "strings": at("34", 2),
    "a time as text": at("now", 3),
    "an end before the start": at(-(10**6), 4),
    "float times": at("float64", 1, 0, 0),
    "a type that is none": at("Tensor", 1, 0, 0),
    "another length": at([1], 1, 0, 1),
    "10^30 events": at([10**30], 1, 0, 1),
    "-1 events": at([-1], 1, 0, 1),
    "a device that is none": at("abacus", 1, 0, 2),
    "columns missing": at([], 1),
    "fewer numbers": dropped,
    "deep JSON": lambda stated, numbers: "[" * 100_000,
    "numbers of many digits": lambda stated, numbers: '["value", ' + "9" * 10_000 + "]",
    "no JSON": lambda stated, numbers: "\0" * 40,
    "no sample": lambda stated, numbers: "{}",
    "other kinds": lambda stated, numbers: [*stated[:1], ["list", [["system", "rm"]]]],
    "stamps of another file": lambda stated, numbers: [stated[0], ["list", [["value", 1], stated[1][1][1]]]],
}


@pytest.mark.parametrize("change", HOSTILE.values(), ids=HOSTILE)
def test_events_that_somebody_altered_are_made_again(digits, tmp_path, change):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100_000)), tmp_path / "cache")
    expected = cached[0]
    path = cached.folder / "0/0.pt"
    whole = path.read_bytes()
    rewritten(path, change)
    assert path.read_bytes() != whole
    assert cached[0] == expected
    assert path.read_bytes() == whole


def flat(name):
    """As many numbers, but other nodes."""

    def change(fields, graph, numbers):
        fields[name][1][1] = [int(np.prod(fields[name][1][1]))]

    return change


def counted(by):
    def change(fields, graph, numbers):
        graph[2] += by

    return change


def byte(place, value):
    """Of the edges: first the number of each node's edges, then the sources."""

    def change(fields, graph, numbers):
        numbers[place if place >= 0 else fields["pos"][1][1][0]] = value

    return change


def stored_as(name, *kind):
    def change(fields, graph, numbers):
        fields[name][1][3:] = kind

    return change


HOSTILE_GRAPHS = {
    "flat x": flat("x"),
    "flat pos": flat("pos"),
    "no t": lambda fields, graph, numbers: fields.pop("t"),
    "an edge more": counted(1),
    "an edge less": counted(-1),
    "all edges less": counted(-(10**6)),
    "too many edges": counted(10**12),
    "a node without edges more": byte(0, 0),
    "a number without an end": byte(0, 255),
    "a source before the first node": byte(-1, 127),
    "a source after the last node": byte(-1, 126),
    "t as a type that isn't smaller": stored_as("t", "int64", 0),
    "t as text": stored_as("t", "str", 0),
    "steps between coordinates": stored_as("pos", "uint8", 1),
    "pseudo-coordinates of another graph": lambda fields, graph, numbers: fields.update(edge_attr=fields["pos"]),
    "an unknown kind of pseudo-coordinates": lambda fields, graph, numbers: fields.update(pseudo=["value", "other"]),
    "a range of pseudo-coordinates that isn't one": lambda fields, graph, numbers: fields.update(reach=["value", 3]),
    "edges twice": lambda fields, graph, numbers: fields.update(edge_index=fields["t"]),
}


@pytest.mark.parametrize("alter", HOSTILE_GRAPHS.values(), ids=HOSTILE_GRAPHS)
def test_a_graph_that_somebody_altered_is_made_again(digits, tmp_path, alter):
    def change(stated, numbers):
        graph = stated[1][1][1][0]
        alter(graph[1], graph, numbers)

    transform = T.Compose([T.Window(0, 100_000), T.RadiusGraph(radius=20)])
    cached = nvsdata.cache(NMNIST(digits, transform=transform), tmp_path / "cache")
    expected = cached[0][0]
    assert 0 < expected.num_nodes < 64 < expected.num_edges
    path = cached.folder / "0/0.pt"
    whole = path.read_bytes()
    rewritten(path, change)
    assert path.read_bytes() != whole
    found = cached[0][0]
    assert torch.equal(found.edge_index, expected.edge_index)
    assert torch.equal(found.edge_attr, expected.edge_attr)
    assert found.pos.shape == expected.pos.shape
    assert path.read_bytes() == whole


def described(stated, numbers=b""):
    head = json.dumps(stated).encode() + b"\n"
    return memoryview(head + bytes(-len(head) % 16) + numbers)


BYTES_16 = ["tensor", ["int64", [16], "cpu", "uint8", 0]]
LARGE = {
    "a tensor": ["tensor", ["int64", [1 << 28], "cpu", "uint8", 0]],
    "two tensors": ["list", [["tensor", ["int64", [1 << 26], "cpu", "uint8", 0]]] * 3],
    "events": ["events", [["int64", [1 << 28], "cpu", "uint8", 1]] * 4, [1, 1], 0, 0],
    "edges": ["graph", {"x": BYTES_16}, 1 << 26, ["uint8", [1 << 27], "cpu"]],
    "as many edges less": ["list", [BYTES_16, ["graph", {}, -(1 << 40)], ["dict", [[BYTES_16, BYTES_16]]]]],
}


@pytest.mark.parametrize("stated", LARGE.values(), ids=LARGE)
def test_few_bytes_do_not_fill_the_memory(stated):
    with pytest.raises(ValueError, match="a sample of more than 1,073,741,824 bytes"):
        decode_sample(described(stated, bytes(16)))


@pytest.mark.parametrize("shape", [[10**9] * 1_000, [1] * 65, [-1], [True], "1", None])
def test_impossible_shapes(shape):
    with pytest.raises(ValueError, match=r"not a s(hape|ample)"):
        decode_sample(described(["tensor", ["int64", shape, "cpu", "uint8", 0]], bytes(16)))


def test_samples_that_take_too_much_memory_are_not_stored(digits, tmp_path, monkeypatch):
    sample = torch.zeros(1_000, dtype=torch.int64)
    monkeypatch.setattr(encoding, "MOST", 8_000)
    assert torch.equal(decode_sample(memoryview(encode_sample(sample))), sample)
    monkeypatch.setattr(encoding, "MOST", 7_999)
    with pytest.raises(encoding.TooLarge, match="has 8,000 bytes, more than 7,999"):
        encode_sample(sample)
    dataset = NMNIST(digits, transform=T.VoxelGrid(4))
    cached = nvsdata.cache(dataset, tmp_path / "cache")
    assert torch.equal(cached[0][0], dataset[0][0])
    assert made(cached) == []


def bits(tensor):
    return tensor.contiguous().view(-1).view(torch.uint8).numpy().tobytes()


@pytest.mark.parametrize("kind", [torch.int64, torch.int32, torch.int16, torch.float64, torch.float32, torch.float16])
@pytest.mark.parametrize("end", [1, 200, 40_000, 2**31, 2**40])
def test_numbers_are_restored_bit_by_bit_and_in_few_bytes(kind, end):
    whole = not kind.is_floating_point
    top = min(end, torch.iinfo(kind).max) if whole else end
    odd = [-0.0, float("nan"), float("inf"), 0.5] if not whole else [-1, -top]
    for values in ([0], [0, top], [top, 0, top], [-top, top], [*range(0, 5)], [0, *odd], []):
        tensor = torch.tensor(values, dtype=torch.int64 if whole else torch.float64).to(kind)
        content = encode_sample(tensor)
        found = decode_sample(memoryview(content))
        assert (found.dtype, found.shape, bits(found)) == (tensor.dtype, tensor.shape, bits(tensor))
    few = torch.arange(4_000).clamp(max=255).to(kind)
    assert len(encode_sample(few)) < 4_200 or kind == torch.float16


def test_times_are_stored_as_steps():
    t = torch.cumsum(torch.full((1_000,), 250, dtype=torch.int64), 0)
    content = encode_sample(t)
    assert len(content) < 1_100
    assert torch.equal(decode_sample(memoryview(content)), t)


@pytest.mark.parametrize("pseudo", ["abs", "signed", "signed-time"])
def test_a_graph_takes_few_bytes(pseudo):
    graph = T.RadiusGraph(pseudo=pseudo)(trees.some(0, 3_000))
    content = encode_sample(graph)
    assert len(content) < graph.num_edges * 1.3 + graph.num_nodes * 8
    assert graph_bits(decode_sample(memoryview(content))) == graph_bits(graph)


def graph_bits(graph):
    tensors = [getattr(graph, name) for name in ("x", "pos", "t", "edge_index", "edge_attr")]
    return [(one.dtype, tuple(one.shape), bits(one)) for one in tensors], graph.reach, graph.pseudo, graph.sensor_size


@pytest.mark.parametrize("change", ["other pseudo-coordinates", "edges in another order", "no edges", "doubles"])
def test_other_graphs_are_restored_too(change):
    graph = T.RadiusGraph()(trees.some(0, 50, gap=100))
    assert graph.num_edges > 30
    if change == "other pseudo-coordinates":
        graph = replace(graph, edge_attr=graph.edge_attr + 0.25)
    elif change == "no edges":
        graph = replace(graph, edge_index=graph.edge_index[:, :0], edge_attr=graph.edge_attr[:0])
    elif change == "doubles":
        graph = replace(graph, edge_attr=graph.edge_attr.double())
    elif change == "edges in another order":
        # sources in any order, targets still grouped
        order = torch.argsort(graph.edge_index[1] * 1_000 - graph.edge_index[0])
        graph = replace(graph, edge_index=graph.edge_index[:, order], edge_attr=graph.edge_attr[order])
    assert graph_bits(decode_sample(memoryview(encode_sample(graph)))) == graph_bits(graph)


@pytest.mark.skipif(os.name != "posix", reason="links and pipes as POSIX has them")
@pytest.mark.parametrize("kind", ["link", "pipe", "folder", "1 GiB", "1 GiB with a seal"])
def test_what_has_the_name_of_a_sample(digits, tmp_path, kind):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100)), tmp_path / "cache")
    expected = cached[0]
    path, target = cached.folder / "0/0.pt", tmp_path / "thesis.tex"
    target.write_bytes(path.read_bytes() if kind == "link" else b"a year's work")
    before = target.read_bytes()
    if kind.startswith("1 GiB"):
        if kind == "1 GiB":
            path.write_bytes(b"")
        os.truncate(path, 1 << 30)
    else:
        path.unlink()
        {"link": lambda: path.symlink_to(target), "pipe": lambda: os.mkfifo(path), "folder": path.mkdir}[kind]()
    if kind == "folder":
        with pytest.warns(UserWarning, match="can't be written to"):
            assert cached[0] == expected
        return
    assert cached[0] == expected
    assert target.read_bytes() == before
    assert path.is_file()
    assert not path.is_symlink()
    assert path.stat().st_size < 1 << 20


@pytest.mark.skipif(os.name != "posix", reason="links and pipes as POSIX has them")
@pytest.mark.parametrize("name", ["", "0"])
def test_a_folder_that_is_a_link_is_not_written_to(digits, tmp_path, name):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100)), tmp_path / "cache")
    (tmp_path / "home").mkdir()
    place = cached.folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.symlink_to(tmp_path / "home")
    assert cached[0] == cached.dataset[0]
    assert not [*(tmp_path / "home").iterdir()]
    assert made(cached) == ["0/0.pt"]


class Speaks:
    def __init__(self, scale):
        self.scale = scale

    def __repr__(self):
        return f"Speaks({self.scale})"


class TellingModule(nn.Module):
    def __init__(self, scale):
        super().__init__()
        self.scale = scale

    def extra_repr(self):
        return f"scale={self.scale}"


class Inner(Speaks):
    """What it inherits says all."""


class Quiet(nn.Module):
    """What says nothing, in something that does."""


class Loud(nn.Module):
    def __init__(self, scale):
        super().__init__()
        self.scale, self.inner = scale, Quiet()

    def __repr__(self):
        return f"Loud({self.scale})"


@pytest.mark.parametrize(
    "make",
    [
        Inner,
        Loud,
        lambda scale: nn.Sequential(TellingModule(0), nn.ModuleList([TellingModule(scale)])),
        lambda scale: nn.ModuleDict({"a": TellingModule(scale)}),
        lambda scale: nn.Dropout(scale / 10),
        lambda scale: frozenset({scale, "a"}),
        lambda scale: torch.zeros(scale),
        lambda scale: torch.zeros(1, dtype=(torch.int8, torch.uint8)[scale - 1]),
    ],
)
def test_whatever_says_its_settings_is_taken(make):
    assert settings_key(make(1)) == settings_key(make(1)) != settings_key(make(2))


def test_the_order_of_a_set_is_none():
    assert settings_key({"a", "b", "c"}) == settings_key({"c", "b", "a"})
    assert settings_key(["a", "b"]) != settings_key(["b", "a"]) != settings_key(("b", "a"))
    assert settings_key({"a": 1}) != settings_key({"a": 2}) != settings_key({"b": 2})


@pytest.mark.parametrize("text", ["<Thing at 0x7F00>", "<Thing AT 0X12>", "Thing(1, ..., 9)"])
def test_addresses_and_what_is_shortened_say_nothing(text):
    with pytest.raises(TypeError, match="has a repr that doesn't show its settings, so a cache can't distinguish it"):
        settings_key(type("Thing", (), {"__repr__": lambda _: text})())
    assert settings_key(type("Thing", (), {"__repr__": lambda _: "Thing(at=0x12)"})()).endswith(": Thing(at=0x12)")
