"""Long files that are handed out, and converted, in parts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import events

import nvsdata
from nvsdata import Events, FormatError, formats
from nvsdata.cli import main
from nvsdata.data.events import Columns
from nvsdata.data.pieces import in_windows
from nvsdata.formats import file_recording
from nvsdata.formats.text import TextRecording

KINDS = {"evt3": ".raw", "evt2": ".raw", "evt2.1": ".raw", "atis": ".bin"}
every = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(file_recording, "LONG", 100)
    monkeypatch.setattr(file_recording, "PART", 500)


def made(folder, kind, count=9_000):
    """A file with events that come in bursts, and these."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 40, count) ** 3 * 10 + rng.integers(0, 9, count))
    ev = Events(t, rng.integers(0, 120, count), rng.integers(0, 100, count), rng.integers(0, 2, count), (128, 128))
    path = folder / f"a{KINDS[kind]}"
    formats.write(ev, path, format=kind)
    return path, ev


@every
def test_parts_are_the_whole(tmp_path, kind):
    path, ev = made(tmp_path, kind)
    found = nvsdata.open(path, sensor_size=(128, 128))
    parts = list(found.pieces())
    assert len(parts) > 5
    assert found._whole is None
    assert [part.start for part in parts[1:]] == [part.end + 1 for part in parts[:-1]]
    assert (parts[0].start, parts[-1].end) == (found.start, found.end)
    formats.write(found, tmp_path / "b.h5")
    assert nvsdata.read(tmp_path / "b.h5") == found.read()
    assert np.array_equal(nvsdata.read(tmp_path / "b.h5").t, ev.t)


@given(events(max_size=60, width=128, height=100), st.integers(1, 9))
def test_any_number_of_windows(tmp_path, ev, count):
    formats.write(ev, tmp_path / "a.h5")
    found = nvsdata.open(tmp_path / "a.h5")
    parts = list(in_windows(found, count))
    assert len(parts) == count
    for name in "txyp":
        assert np.concatenate([getattr(part, name) for part in parts]).tolist() == getattr(ev, name).tolist()
    assert min(part.start for part in parts) == ev.start
    assert max(part.end for part in parts) == ev.end


def test_what_may_be_out_of_order_is_read_as_a_whole(tmp_path):
    t = np.arange(9_000)
    # one event comes far too late, and no index of first records tells
    t[[10, 8_000]] = t[[8_000, 10]]
    ev = Events.trusted(Columns(t, *(np.zeros(9_000, np.int16),) * 2, np.ones(9_000, np.uint8)), (128, 128))
    raw = np.stack([t, 1 << 28 | np.zeros(9_000, int)], 1).astype("<u4").tobytes()
    (tmp_path / "a.dat").write_bytes(b"% Version 2\n% Width 128\n% Height 128\n\x0c\x08" + raw)
    (whole,) = nvsdata.open(tmp_path / "a.dat").pieces()
    assert whole.t.tolist() == sorted(ev.t.tolist())


def test_damage_in_a_late_part_leaves_no_file(tmp_path, capsys):
    path, _ = made(tmp_path, "atis")
    raw = bytearray(path.read_bytes())
    # a row that no sensor has
    raw[-2_999] = 250
    path.write_bytes(raw)
    with pytest.raises(FormatError):
        formats.write(nvsdata.open(path, sensor_size=(128, 128)), tmp_path / "b.h5")
    assert main(["convert", str(path), str(tmp_path / "b.h5"), "--sensor-size", "128x128"]) == 1
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("stated", [(500_000, 600_000), (-5, 100), (2_000_000, 3_000_000)])
def test_a_stated_time_that_is_wrong_is_told_of_parts_too(tmp_path, stated):
    path, ev = made(tmp_path, "evt3")
    right = b"%% nvsdata time %20d to %20d us" % (ev.start, ev.end)
    raw = path.read_bytes()
    assert right in raw
    path.write_bytes(raw.replace(right, b"%% nvsdata time %20d to %20d us" % stated))
    with pytest.raises(FormatError, match="outside the time that it states"):
        formats.write(nvsdata.open(path), tmp_path / "b.h5")


def test_a_sensor_that_is_not_stated_is_found_in_the_whole(tmp_path):
    path, ev = made(tmp_path, "evt3")
    raw = path.read_bytes()
    path.write_bytes(b"% evt 3.0\n" + raw[raw.index(b"% end\n") + 6 :])
    (whole,) = nvsdata.open(path).pieces()
    assert np.array_equal(whole.t, ev.t)


def test_what_a_bar_would_have_to_decode_for_has_none(tmp_path, monkeypatch):
    (tmp_path / "a.txt").write_text("".join(f"{n % 9} {n % 7} {n} 1\n" for n in range(500)))
    monkeypatch.setattr("nvsdata.common.progress.bar", None)
    decoded = []
    decode = TextRecording.decode
    monkeypatch.setattr(TextRecording, "decode", lambda self: decoded.append(1) or decode(self))
    assert main(["convert", str(tmp_path / "a.txt"), str(tmp_path / "b.h5"), "--sensor-size", "9x7"]) == 0
    assert len(decoded) == 1


def test_the_command_tells_how_much_of_the_time_is_done(tmp_path, monkeypatch):
    path, ev = made(tmp_path, "evt3")
    steps = []

    class Bar:
        n = 0

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def update(self, more):
            self.n += more
            steps.append(self.n)

    monkeypatch.setattr("nvsdata.common.progress.bar", lambda *_, **how: Bar())
    assert main(["convert", str(path), str(tmp_path / "b.h5")]) == 0
    assert steps == sorted(steps)
    assert len(steps) > 5
    assert steps[-1] == 100
    assert np.array_equal(nvsdata.read(tmp_path / "b.h5").t, ev.t)
