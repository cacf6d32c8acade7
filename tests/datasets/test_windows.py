"""Windows of recordings as samples."""

import json
import os

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import EventFolder, Events
from nvsdata import transforms as T
from nvsdata.datasets import source
from nvsdata.datasets import windows as windows_module
from nvsdata.datasets.windows import windows
from nvsdata.formats.file_recording import FileRecording


def some(n, seed, gap=50):
    random = np.random.default_rng(seed)
    t = 10**6 + np.cumsum(random.integers(0, gap, n))
    return Events(t, random.integers(0, 20, n), random.integers(0, 10, n), random.integers(0, 2, n), (20, 10))


RECORDINGS = {"a/one": some(400, 1), "a/two": some(1, 2), "b/three": some(333, 3, gap=2), "b/none": some(0, 4)}


def written(folder, suffix):
    for name, events in RECORDINGS.items():
        (folder / name).parent.mkdir(exist_ok=True)
        nvsdata.write(events, folder / f"{name}{suffix}")
    return folder


@pytest.fixture
def root(tmp_path):
    return written(tmp_path, ".npy")


def rows(events):
    return list(zip(*(column.tolist() for column in events.columns), strict=True))


def whole(dataset):
    return [row for index in range(len(dataset)) for row in rows(dataset[index][0])]


@pytest.mark.parametrize(
    "way", [{"duration": 1_000}, {"duration": 70}, {"events": 100}, {"events": 10}, {"events": 10**6}]
)
@pytest.mark.parametrize("suffix", [".npy", ".h5"])
def test_each_event_is_in_one_window(tmp_path, suffix, way):
    dataset = EventFolder(written(tmp_path, suffix))
    cut = nvsdata.windows(dataset, **way)
    assert type(cut) is EventFolder
    assert cut.classes == dataset.classes
    assert whole(cut) == whole(dataset)
    for index, sample in enumerate(cut.samples):
        events, target = cut[index]
        assert target == dataset.class_to_idx[sample.name.split("/")[0]]
        if "duration" in way:
            assert events.end - events.start < way["duration"]
            assert sample.window[0] == events.start
        else:
            assert len(events) <= way["events"]
            last = index + 1 == len(cut) or cut.samples[index + 1].name != sample.name
            assert last or len(events) == way["events"]
    assert len({cut._name_of(sample) for sample in cut.samples}) == len(cut)


@settings(max_examples=10, deadline=None)
@given(size=st.integers(1, 60), step=st.integers(1, 90), gap=st.sampled_from((1, 3, 40)))
def test_windows_begin_every_step(tmp_path_factory, size, step, gap):
    events = some(120, size, gap)
    folder = tmp_path_factory.mktemp("x")
    (folder / "a").mkdir()
    nvsdata.write(events, folder / "a" / "one.npy")
    dataset = EventFolder(folder)
    numbered = windows(dataset, events=size, step=step)
    expected = [rows(events[n : n + size]) for n in range(0, len(events), step)]
    assert [rows(part) for part, _ in numbered] == expected
    timed = windows(dataset, 10 * size, step=10 * step)
    begin, end = int(events.t[0]), int(events.t[-1])
    expected = [rows(events.window(t, t + 10 * size)) for t in range(begin, end + 1, 10 * step)]
    assert [rows(part) for part, _ in timed] == expected


@pytest.mark.parametrize("way", [{"duration": 1_000}, {"events": 100}])
def test_the_second_time_nothing_is_decoded(root, way, monkeypatch):
    first = windows(EventFolder(root), **way).samples
    with monkeypatch.context() as patched:
        patched.setattr(FileRecording, "read", None)
        patched.setattr(FileRecording, "decode_span", None)
        # but for some recordings, with which the index is compared
        patched.setattr(windows_module, "COMPARED", 0)
        assert windows(EventFolder(root), **way).samples == first
    # a file that has changed is looked at again
    name = next(path for path in (root / "a").iterdir() if path.stem == "two")
    name.unlink()
    nvsdata.write(some(250, 9), name)
    os.utime(name, ns=(1, 1))
    again = windows(EventFolder(root), **way)
    assert len(again) > len(first)
    assert whole(again) == whole(EventFolder(root))


def test_an_index_that_is_damaged_or_can_not_be_written(root):
    first = windows(EventFolder(root), 1_000).samples
    index = next(root.glob(".nvsdata-windows-*"))
    sound = index.read_bytes()
    head, _, text = sound.partition(b"\n")
    other_version = json.dumps([source.VERSION + 1, json.loads(head)[1]]).encode() + b"\n" + text
    changed = sound.replace(b'"end": ', b'"end": 1')
    deep = b"[" * 100_000
    for content in (b"", b"[]", b"\0" * 99, head, sound[:-9], other_version, changed, deep):
        index.write_bytes(content)
        assert windows(EventFolder(root), 1_000).samples == first
        assert index.read_bytes() == sound
    index.unlink()
    index.mkdir()
    assert windows(EventFolder(root), 1_000).samples == first


def test_labeled_parts_are_cut_from_their_beginning(root):
    dataset = EventFolder(root)
    dataset.samples = [s._replace(window=(10**6 + 500, 10**6 + 3_000)) for s in dataset.samples if s.stem == "one"]
    cut = windows(dataset, 1_000)
    assert [sample.window for sample in cut.samples] == [
        (10**6 + at, 10**6 + min(at + 1_000, 3_000)) for at in (500, 1_500, 2_500)
    ]
    assert whole(cut) == rows(RECORDINGS["a/one"].window(10**6 + 500, 10**6 + 3_000))
    assert whole(windows(dataset, events=7)) == whole(cut)


def test_a_store_has_windows_too(root, tmp_path):
    dataset = EventFolder(root)
    packed = tmp_path / "packed.nvs"
    nvsdata.pack(dataset, packed)
    for way in ({"duration": 1_000}, {"events": 100}):
        cut = windows(EventFolder(packed), **way)
        assert whole(cut) == whole(windows(dataset, **way))


def test_a_loader_of_windows(root):
    dataset = EventFolder(root, transform=T.ToFrames(4), sensor_size=(20, 10), seed=3)
    cut = windows(dataset, 1_000)
    loader = DataLoader(cut, 5, collate_fn=nvsdata.collate, num_workers=1)
    frames = torch.cat([batch for batch, _ in loader])
    assert frames.shape == (len(cut), 4, 2, 10, 20)
    assert frames.sum() == sum(map(len, RECORDINGS.values()))
    assert len(cut[:3]) == 3
    assert cut.targets == [sample.label for sample in cut.samples]


@pytest.mark.parametrize(
    ("way", "reason"),
    [
        ({}, "one of duration and events must be given, not duration=None, events=None"),
        ({"duration": 5, "events": 5}, "one of duration and events must be given"),
        ({"duration": 0.5}, r"duration counts whole µs, not 0.5 \(0.5 s are 500000\)"),
        ({"duration": 0}, "duration must be positive"),
        ({"events": 0}, "events must be a whole number of at least 1, not 0"),
        ({"duration": 5, "step": 0}, "step must be positive"),
        ({"events": 5, "step": -1}, "step must be a whole number of at least 1"),
    ],
)
def test_settings_out_of_range(root, way, reason):
    with pytest.raises(ValueError, match=reason):
        windows(EventFolder(root), **way)


def test_windows_of_windows_and_of_nothing(root):
    dataset = EventFolder(root)
    with pytest.raises(TypeError, match="windows are made from recordings"):
        windows(windows(dataset, events=5), 100)
    with pytest.raises(ValueError, match="none of the recordings has any events"):
        windows(dataset.subset([i for i, s in enumerate(dataset.samples) if "none" in s.name]), 100)


def cut_of(folder, times, errors="raise", **way):
    events = Events(times, [1] * len(times), [1] * len(times), [0] * len(times), (20, 10))
    (folder / "a").mkdir(exist_ok=True)
    nvsdata.write(events, folder / "a" / "one.npy")
    return [(s.window, s.events) for s in windows(EventFolder(folder, errors=errors), **way).samples]


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ({"duration": 10}, [((5, 15), None), ((15, 25), None), ((25, 26), None)]),
        ({"duration": 21}, [((5, 26), None)]),
        ({"duration": 20}, [((5, 25), None), ((25, 26), None)]),
        ({"duration": 3, "step": 20}, [((5, 8), None), ((25, 26), None)]),
        # to the end of the µs in which the next window begins, less the events that were before
        ({"events": 2}, [((5, 16), (0, 2)), ((15, 26), (1, 2)), ((25, 26), (0, 2))]),
        ({"events": 3}, [((5, 16), (0, 3)), ((15, 26), (2, 3))]),
        ({"events": 5}, [((5, 26), (0, 5))]),
        ({"events": 2, "step": 3}, [((5, 16), (0, 2)), ((15, 26), (2, 2))]),
        ({"events": 3, "step": 2}, [((5, 26), (0, 3)), ((15, 26), (1, 3)), ((25, 26), (0, 3))]),
    ],
)
def test_windows_as_counted_by_hand(tmp_path, way, expected):
    assert cut_of(tmp_path, [5, 15, 15, 15, 25], **way) == expected


def test_one_event_at_0_is_a_window(tmp_path):
    assert cut_of(tmp_path, [0], duration=5) == [((0, 1), None)]
    assert cut_of(tmp_path, [0], events=5) == [((0, 1), (0, 5))]


def test_windows_of_time_are_found_without_decoding(root, monkeypatch):
    dataset = EventFolder(root)
    dataset.samples = [sample for sample in dataset.samples if sample.stem in ("one", "three")]
    read = []
    monkeypatch.setattr(FileRecording, "read", lambda self, *_: read.append(self.path))
    windows(dataset, 1_000)
    assert read == []


ALTERED = {
    "another end": {"end": 10},
    "another beginning": {"begins": [[2, 0]]},
    "no windows": {"begins": []},
    "too many windows": {"begins": [[5, 0], [6, 0], [7, 0]]},
    "not in order": {"begins": [[9, 0], [5, 0]]},
    "text": {"end": "10"},
    "huge": {"end": 10**30},
    "a fraction": {"begins": [[5.5, 0]]},
    "negative": {"begins": [[5, -1]]},
    "nothing": {"begins": None},
}


@pytest.mark.parametrize("how", ALTERED)
def test_an_index_altered_with_its_checksum_is_found_out_and_made_again(tmp_path, how):
    expected = cut_of(tmp_path, [5, 15], duration=10)
    (path,) = tmp_path.glob(".nvsdata-windows-*")
    sound = path.read_bytes()
    known = source.load_facts(path)
    known["a/one.npy"] |= ALTERED[how]
    source.save_facts(path, known)
    found = [(sample.window, sample.events) for sample in windows(EventFolder(tmp_path), 10).samples]
    assert found == expected
    assert path.read_bytes() == sound
    # and a sound one isn't written again
    before = path.stat().st_ino
    windows(EventFolder(tmp_path), 10)
    assert path.stat().st_ino == before


def test_a_link_in_the_place_of_an_index_of_windows(tmp_path):
    expected = cut_of(tmp_path, [5, 15], duration=10)
    (path,) = tmp_path.glob(".nvsdata-windows-*")
    mine = tmp_path / "mine.txt"
    mine.write_text("a text")
    path.unlink()
    path.symlink_to(mine)
    assert [(sample.window, sample.events) for sample in windows(EventFolder(tmp_path), 10).samples] == expected
    assert mine.read_text() == "a text"


def test_repaired_recordings_have_an_index_of_their_own(tmp_path):
    names = []
    for errors in ("raise", "skip", "repair"):
        cut_of(tmp_path, [5, 15], errors, duration=10)
        names.append(sorted(path.name for path in tmp_path.glob(".nvsdata-windows-time-????????.json")))
    assert names[0] == names[1]
    assert len(names[1]) + 1 == len(names[2]) == 2
    cut_of(tmp_path, [5, 15], events=2, step=7)
    assert len(list(tmp_path.glob(".nvsdata-windows-7-events-????????.json"))) == 1


@pytest.mark.parametrize(("count", "shown"), [(999, False), (1_000, True)])
def test_many_recordings_are_counted_aloud(root, monkeypatch, count, shown):
    asked = []
    monkeypatch.setattr("nvsdata.datasets.windows.bar", lambda of, what, **how: asked.append((what, how)) or of)
    windows(EventFolder(root).subset([0] * count), 10**6)
    assert asked == [("windows", {"shown": shown, "leave": False})]
