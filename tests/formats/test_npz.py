"""Archives of NumPy arrays, as spikingjelly and N-ImageNet have them."""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import EventFolder, Events, FormatError

SIZE = (240, 180)
EV = Events([5, 9, 9, 2_000_005], [0, 100, 239, 1], [0, 80, 179, 1], [1, 0, 1, 1], SIZE)
COLUMNS = {"t": EV.t, "x": EV.x, "y": EV.y, "p": EV.p}


def saved(folder, compress=False, **arrays):
    (np.savez_compressed if compress else np.savez)(folder / "a.npz", **arrays)
    return folder / "a.npz"


@given(events(max_size=60, width=240, height=180), st.booleans())
def test_columns_as_spikingjelly_writes_them(tmp_path, ev, compress):
    path = saved(tmp_path, compress, t=ev.t, x=ev.x, y=ev.y, p=ev.p)
    assert nvsdata.read(path, sensor_size=SIZE) == ev


@pytest.mark.parametrize(
    "arrays",
    [
        {"event_data": EV.to_structured()},
        {"arr_0": EV.to_structured()},
        {"events": np.stack([EV.x, EV.y, EV.t, EV.p], 1), "label": np.array(3)},
        {"events": np.stack([EV.x, EV.y, EV.p, EV.t]).T},
        {"Timestamp": EV.t, "X": EV.x, "Y": EV.y.astype(float), "polarity": EV.p.astype(bool), "more": np.zeros(3)},
        {"ts": EV.t / 1e6, "x": EV.x, "y": EV.y, "pol": 2 * EV.p.astype(int) - 1},
    ],
)
def test_names_units_and_polarities(tmp_path, arrays):
    for compress in (False, True):
        recording = nvsdata.open(saved(tmp_path, compress, **arrays), sensor_size=SIZE)
        assert recording.format == "npz"
        assert recording.read() == EV
        assert recording.read(9, 10) == EV.window(9, 10)


def test_a_folder_of_them(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        saved(tmp_path / name, **COLUMNS)
    dataset = EventFolder(tmp_path)
    assert (len(dataset), dataset.classes) == (2, ["a", "b"])
    assert dataset.recording(0).size_is_guessed
    assert dataset[0][0].t.tolist() == EV.t.tolist()


def test_mixed_times_are_sorted(tmp_path):
    at = [3, 1, 0, 2]
    path = saved(tmp_path, **{name: column[at] for name, column in COLUMNS.items()})
    assert nvsdata.read(path, sensor_size=SIZE) == EV[np.array([0, 1, 2, 3])]


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"t": EV.t, "x": EV.x, "y": EV.y}, r"has the arrays \['t', 'x', 'y'\], not t, x, y and p"),
        ({"a": EV.t, "b": EV.x}, "not t, x, y and p, or a single one of events"),
        ({}, r"has the arrays \[\]"),
        ({**COLUMNS, "x": EV.x[:3]}, "aren't columns of one length"),
        ({**COLUMNS, "x": EV.x[:, None]}, "aren't columns of one length"),
        ({**COLUMNS, "p": EV.p + 5}, "polarity"),
        ({**COLUMNS, "x": EV.x + 0.5}, "numbers that aren't whole"),
        ({**COLUMNS, "t": np.array(["a"] * 4)}, "not of numbers"),
        ({**COLUMNS, "t": np.array([None] * 4)}, "not of numbers"),
        ({"events": np.zeros((4, 5))}, r"an array of shape \(4, 5\)"),
        ({"events": np.array(1)}, r"an array of shape \(\)"),
    ],
)
def test_other_arrays_are_refused(tmp_path, arrays, reason):
    with pytest.raises(FormatError, match=reason):
        nvsdata.read(saved(tmp_path, **arrays), sensor_size=SIZE)


@pytest.mark.parametrize("compress", [False, True])
def test_damaged_archives_are_refused(tmp_path, compress):
    raw = saved(tmp_path, compress, **COLUMNS).read_bytes()
    path = tmp_path / "b.npz"
    for end in (0, 1, 30, len(raw) // 2, len(raw) - 1):
        path.write_bytes(raw[:end])
        with pytest.raises(FormatError):
            nvsdata.read(path)
    # in the data of the first array
    at = raw.index(b"NUMPY") + 140 if not compress else 90
    path.write_bytes(raw[:at] + bytes([raw[at] ^ 255]) + raw[at + 1 :])
    with pytest.raises(FormatError, match="damaged archive"):
        nvsdata.read(path)


@given(st.data())
def test_any_damage_is_an_error_or_events(tmp_path, data):
    raw = bytearray(saved(tmp_path, data.draw(st.booleans()), **COLUMNS).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    (tmp_path / "b.npz").write_bytes(raw)
    try:
        found = nvsdata.read(tmp_path / "b.npz")
    except FormatError:
        return
    assert (np.diff(found.t) >= 0).all()


def test_archives_do_not_expand_without_limit(tmp_path):
    zeros = io.BytesIO()
    np.save(zeros, np.zeros(1 << 24, np.int64))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in "txyp":
            archive.writestr(f"{name}.npy", zeros.getvalue())
    with pytest.raises(FormatError, match="expands too far: a file of"):
        nvsdata.read(tmp_path / "a.npz")


def test_arrays_shorter_than_their_header_says(tmp_path):
    with zipfile.ZipFile(saved(tmp_path, **COLUMNS)) as archive:
        arrays = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name, raw in arrays.items():
            archive.writestr(name, raw[:-1] if name == "y.npy" else raw)
    with pytest.raises(FormatError, match=r"y has 7 bytes, not those of an array of shape \(4,\)"):
        nvsdata.read(tmp_path / "a.npz")


def test_nothing_is_unpickled(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (exec, ("raise SystemExit('unpickled')",))

    path = tmp_path / "a.npz"
    np.savez(path, **{**COLUMNS, "t": np.array([Bomb()] * 4, object)}, allow_pickle=True)
    with pytest.raises(FormatError, match="not of numbers"):
        nvsdata.read(path)
