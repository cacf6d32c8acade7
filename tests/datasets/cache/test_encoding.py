"""The files of a cache, and which samples are in them."""

from __future__ import annotations

import io
import json
import os
import pickle
import re
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
from nvsdata.datasets.cache.cached import settings_key


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


@pytest.mark.parametrize(
    ("name", "value"), [("edge_index", -1), ("edge_index", 10**6), ("pos", None), ("t", None), ("edge_attr", None)]
)
def test_a_graph_that_somebody_altered_is_made_again(digits, tmp_path, name, value):
    def change(stated, numbers):
        fields, place = stated[1][1][1][0][1], 0
        for field in ("x", "pos", "t", "edge_index", "edge_attr"):
            kind, shape, _ = fields[field][1]
            if field == name and value is None:
                # as many numbers, but other nodes
                fields[field][1][1] = [int(np.prod(shape))]
            elif field == name:
                numbers[place : place + 8] = value.to_bytes(8, "little", signed=True)
            size = int(np.prod(shape)) * getattr(torch, kind).itemsize
            place += size + -size % 16

    transform = T.Compose([T.Window(0, 100_000), T.RadiusGraph(radius=20)])
    cached = nvsdata.cache(NMNIST(digits, transform=transform), tmp_path / "cache")
    expected = cached[0][0]
    assert expected.num_edges
    path = cached.folder / "0/0.pt"
    rewritten(path, change)
    assert torch.equal(cached[0][0].edge_index, expected.edge_index)
    assert cached[0][0].pos.shape == expected.pos.shape


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
