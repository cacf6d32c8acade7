"""The files of a cache, and which samples are in them."""

from __future__ import annotations

import io
import os
import pickle
import re
import zlib
from pathlib import Path

import pytest
import torch
import trees
from torch import nn

import nvsdata
from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.datasets.cache_identity import described


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
        data = path.read_bytes()
        assert int.from_bytes(data[:4], "little") == zlib.crc32(data[4:])
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

    monkeypatch.setattr("nvsdata.datasets.cache._save", fails)
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
    expected = cached[0]
    harmful = {"stamps": cached._stamps(0), "parts": [["value", Harmful(tmp_path / "made")]]}
    # and in the older kind of file, which torch before 2.6 reads less safely
    for content, is_zip in ((harmful, True), (harmful, False), ({"stamps": cached._stamps(0), "parts": 3}, True)):
        out = io.BytesIO()
        torch.save(content, out, _use_new_zipfile_serialization=is_zip)
        data = out.getvalue()
        (cached.folder / "0/0.pt").write_bytes(zlib.crc32(data).to_bytes(4, "little") + data)
        assert cached[0] == expected
    assert not (tmp_path / "made").exists()


def keep(cached, data):
    """Put other bytes in the place of the first sample's, with a right checksum."""
    (cached.folder / "0/0.pt").write_bytes(zlib.crc32(data).to_bytes(4, "little") + data)


@pytest.mark.parametrize("change", ["no parts", "none", "outside", "falls", "short", "no zip"])
def test_what_is_no_sample_of_ours_is_made_again(digits, tmp_path, change):
    cached = nvsdata.cache(NMNIST(digits, transform=T.Window(0, 100_000)), tmp_path / "cache")
    expected = cached[0]
    content = torch.load(io.BytesIO((cached.folder / "0/0.pt").read_bytes()[4:]), weights_only=True)
    columns = content["parts"][0][1]
    if change == "no parts":
        del content["parts"]
    elif change == "none":
        content["parts"] = []
    elif change == "outside":
        columns["x"][3] = -30_000
    elif change == "falls":
        columns["t"][0] = 2**62
    elif change == "short":
        columns["p"] = columns["p"][:-1]
    out = io.BytesIO()
    torch.save(content, out)
    keep(cached, b"no zip" if change == "no zip" else out.getvalue())
    assert cached[0] == expected


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
    assert described(make(1)) == described(make(1)) != described(make(2))


def test_the_order_of_a_set_is_none():
    assert described({"a", "b", "c"}) == described({"c", "b", "a"})
    assert described(["a", "b"]) != described(["b", "a"]) != described(("b", "a"))
    assert described({"a": 1}) != described({"a": 2}) != described({"b": 2})


@pytest.mark.parametrize("text", ["<Thing at 0x7F00>", "<Thing AT 0X12>", "Thing(1, ..., 9)"])
def test_addresses_and_what_is_shortened_say_nothing(text):
    with pytest.raises(TypeError, match="has a repr that doesn't say its settings, so a cache can't distinguish it"):
        described(type("Thing", (), {"__repr__": lambda _: text})())
    assert described(type("Thing", (), {"__repr__": lambda _: "Thing(at=0x12)"})()).endswith(": Thing(at=0x12)")
