"""What is said of windows that hold nothing, and of files and extensions of no known format."""

import warnings

import pytest

import nvsdata
from nvsdata import Events, FormatError

EV = Events([100, 200], [1, 2], [3, 4], [0, 1], (34, 34))


@pytest.fixture
def path(tmp_path):
    nvsdata.write(EV, tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.mark.parametrize(
    ("start", "stop", "shown"),
    [
        (None, 100, "[, 100)"),
        (-5, 100, "[-5, 100)"),
        (0, 0, "[0, 0)"),
        (201, None, "[201, )"),
        (201, 300, "[201, 300)"),
    ],
)
def test_a_window_outside_is_told_to_the_caller(path, start, stop, shown):
    with pytest.warns(UserWarning, match="has no events") as caught:
        assert len(nvsdata.read(path, start, stop)) == 0
    (warned,) = caught
    none = "has no events; the file's are at 100 to 200 µs; relative=True counts from the first event"
    assert str(warned.message) == f"{path}: the window {shown} {none}"
    assert warned.filename == __file__


@pytest.mark.parametrize(
    ("start", "stop"), [(None, None), (101, 200), (101, 101), (200, 200), (None, 101), (200, None)]
)
def test_a_window_inside_is_not_warned_of(path, start, stop):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        nvsdata.read(path, start, stop)


def test_a_recording_without_events_or_of_one_moment_is_not_warned_of(tmp_path):
    nvsdata.write(Events.empty((5, 5)), tmp_path / "none.h5")
    nvsdata.write(EV[:1], tmp_path / "one.h5")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("none.h5", "one.h5"):
            assert len(nvsdata.read(tmp_path / name, 500, 600)) == 0


def test_windows_that_count_from_the_first_event(path):
    assert nvsdata.read(path, relative=True) == EV
    assert nvsdata.read(path, None, 100, relative=True) == EV.window(None, 200)
    assert nvsdata.read(path, 100, 101, relative=True) == EV.window(200, 201)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.xyz", b"", "empty file of unknown format"),
        ("a.xyz", b"\0\xff" * 300, "unknown format: neither the extension nor the first bytes are of a known one"),
        ("a.H5", b"", "the extension means hdf5, but the file is empty"),
        (
            *("a.h5", b"\0\xff" * 300),
            "the extension means hdf5, but the file doesn't begin like one: it is damaged, or has a wrong extension",
        ),
        ("a.raw", b"", "the extension means evt3, but the file is empty"),
    ],
)
def test_files_of_no_known_format(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError) as caught:
        nvsdata.open(tmp_path / name)
    assert (caught.value.reason, caught.value.offset) == (reason, 0)


def test_extensions_that_are_not_written_are_told_those_that_are(tmp_path):
    with pytest.raises(ValueError, match="can't write files with the extension") as caught:
        nvsdata.write(EV, tmp_path / "a.mat")
    known = str(caught.value).partition("extension '.mat'; known are ")[2].split(", ")
    assert len(known) == len(set(known))
    assert {".raw", ".bin", ".dat", ".txt", ".h5", ".aedat", ".aedat4", ".npy"} <= set(known)
    assert ".mat" not in known
    with pytest.raises(ValueError, match=r"can't write a file with '\.bin' as 'text'; known are ") as caught:
        nvsdata.write(EV, tmp_path / "a.bin", format="text")
    assert "text (.txt, .csv, .text)" in str(caught.value)
    assert "matlab" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.bin", "a.npy", "a.txt", "a.h5"])
def test_a_sensor_size_is_guessed_if_nobody_states_it(tmp_path, name):
    events = Events([0, 9], [3, 4], [2, 1], [1, 0], (34, 34))
    nvsdata.write(events, tmp_path / name)
    recording = nvsdata.open(tmp_path / name)
    guessed = recording.size_is_guessed
    # reading doesn't turn a guess into a fact
    assert recording.read().sensor_size == ((5, 3) if guessed else (34, 34))
    assert recording.size_is_guessed == guessed == (name in ("a.bin", "a.npy"))
    assert not nvsdata.open(tmp_path / name, sensor_size=(34, 34)).size_is_guessed
