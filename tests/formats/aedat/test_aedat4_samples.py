"""AEDAT 4: frames, inertial samples and triggers."""

import cv2
import numpy as np
import pytest
from flatbuffers import aedat4_file, frame, inertial, triggers
from lookalikes import aedat4_events

import nvsdata
from nvsdata import Events, FormatError
from nvsdata.cli import main

GRAY8, GRAY16, COLOR, COLOR_ALPHA = 0, 2, 16, 24  # as OpenCV numbers types


def recording(path, packets, **how):
    ev = Events([1_000, 2_000], [1, 2], [3, 4], [1, 0])
    path.write_bytes(aedat4_file([("EVTS", aedat4_events(ev)), *packets], **how))
    return nvsdata.open(path, sensor_size=(20, 20))


@pytest.mark.parametrize("compression", [0, 1, 3])
def test_frames(tmp_path, compression):
    pytest.importorskip("lz4")
    pytest.importorskip("zstandard")
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    packets = [("FRME", frame([1_500, 1_000, 1_900, 1_200, 1_700], GRAY8, 4, 3, (5, 6), pixels.tobytes()))]
    (found,) = recording(tmp_path / "a.aedat4", packets, compression=compression).frames()
    assert (found.start, found.exposure_start, found.exposure_end, found.end) == (1_000, 1_200, 1_700, 1_900)
    assert (found.x, found.y, found.pixels.dtype) == (5, 6, np.uint16)
    assert np.array_equal(found.pixels, pixels)


def test_frames_without_times_of_exposure_have_the_frames_time(tmp_path):
    packets = [("FRME", frame([1_500, None, None, None, None], GRAY8, 2, 1, (0, 0), b"\x07\x09"))]
    (found,) = recording(tmp_path / "a.aedat4", packets).frames()
    assert (found.start, found.exposure_start, found.exposure_end, found.end) == (1_500,) * 4
    assert found.pixels.tolist() == [[7, 9]]


def test_deep_and_colored_frames(tmp_path):
    rng = np.random.default_rng(0)
    deep = rng.integers(0, 1 << 16, (2, 3), np.uint16)
    color, alpha = rng.integers(0, 256, (2, 3, 3), np.uint8), rng.integers(0, 256, (2, 3, 4), np.uint8)
    times = [1, 1, 1, 1, 1]
    packets = [
        ("FRME", frame(times, kind, 3, 2, (0, 0), pixels.tobytes()))
        for kind, pixels in ((GRAY16, deep), (COLOR, color), (COLOR_ALPHA, alpha))
    ]
    found = [one.pixels for one in recording(tmp_path / "a.aedat4", packets).frames()]
    assert np.array_equal(found[0], deep)
    assert np.array_equal(found[1], cv2.cvtColor(color, cv2.COLOR_BGR2GRAY))
    assert np.array_equal(found[2], cv2.cvtColor(alpha, cv2.COLOR_BGRA2GRAY))


@pytest.mark.parametrize(
    ("kind", "width", "height", "size", "reason"),
    [
        (GRAY8, 4, 3, 11, "a frame of 4x3 pixels of type 0 in 11 bytes"),
        (GRAY16, 4, 3, 12, "a frame of 4x3 pixels of type 2 in 12 bytes"),
        (5, 4, 3, 48, "a frame of 4x3 pixels of type 5"),
        (8, 4, 3, 24, "a frame of 2 channels"),
        (GRAY8, -4, -3, 12, "a frame of -4x-3 pixels"),
        (GRAY8, 0, 3, 0, "a frame of 0x3 pixels"),
    ],
)
def test_frames_that_make_no_sense(tmp_path, kind, width, height, size, reason):
    packets = [("FRME", frame([1] * 5, kind, width, height, (0, 0), bytes(size)))]
    with pytest.raises(FormatError, match=f"damaged AEDAT 4: {reason}"):
        list(recording(tmp_path / "a.aedat4", packets).frames())


SAMPLES = [(1_000 * k, 20.5 + k, 0.25, -0.5, 1.0, 10.0 + k, -20.0, 30.0) for k in range(6)]


def test_inertial_samples(tmp_path):
    packets = [("IMUS", inertial(SAMPLES[:2])), ("ELSE", b"what"), ("IMUS", inertial(SAMPLES[2:]))]
    found = recording(tmp_path / "a.aedat4", packets).inertial()
    assert found.t.tolist() == [0, 1_000, 2_000, 3_000, 4_000, 5_000]
    assert found.temperature.tolist() == [20.5 + k for k in range(6)]
    assert found.acceleration.tolist() == [[0.25, -0.5, 1.0]] * 6
    assert found.rotation.tolist() == [[10.0 + k, -20.0, 30.0] for k in range(6)]
    assert recording(tmp_path / "a.aedat4", packets).inertial(1_000, 3_000).t.tolist() == [1_000, 2_000]


def test_triggers_are_the_external_ones(tmp_path):
    packets = [("TRIG", triggers([(5, 1), (6, 2), (7, 9), (8, 3), (9, 0), (10, 4)]))]
    found = recording(tmp_path / "a.aedat4", packets).triggers()
    assert (found.t.tolist(), found.level.tolist(), found.channel.tolist()) == ([5, 6, 8], [1, 0, 1], [0, 0, 0])
    assert recording(tmp_path / "a.aedat4", packets).triggers(6, 8).t.tolist() == [6]


def test_a_file_of_events_alone_has_no_samples(tmp_path):
    pytest.importorskip("lz4")
    nvsdata.write(Events([1], [2], [3], [1], (4, 4)), tmp_path / "a.aedat4")
    found = nvsdata.open(tmp_path / "a.aedat4")
    assert not found.holds_samples
    assert (list(found.frames()), found.inertial().t.size, found.triggers().t.size) == ([], 0, 0)


def test_a_window_reads_only_packets_near_it(tmp_path):
    second = 1_000_000
    frames = [frame([k * 3 * second] * 5, GRAY8, 2, 1, (0, 0), b"\0\1") for k in range(4)]
    # the second one is no frame, but a window that doesn't touch it doesn't see that
    frames[1] = b"\0" * len(frames[1])

    def table(begin):
        at = begin + len(aedat4_events(Events([1_000, 2_000], [1, 2], [3, 4], [1, 0]))) + 16
        rows = [(begin + 8, 0, at - begin - 16, 2, 1_000, 2_000)]
        for k, content in enumerate(frames):
            rows.append((at, 1, len(content), 1, k * 3 * second, k * 3 * second))
            at += len(content) + 8
        return rows

    found = recording(tmp_path / "a.aedat4", [("FRME", one) for one in frames], table=table)
    assert [f.exposure_start for f in found.frames(5 * second, 10 * second)] == [6 * second, 9 * second]
    with pytest.raises(FormatError, match="damaged AEDAT 4: no FRME"):
        list(found.frames())


def test_frames_and_samples_go_into_other_files(tmp_path):
    packets = [
        ("FRME", frame([1_500, 1_000, 1_900, 1_200, 1_700], GRAY8, 2, 1, (1, 2), b"\x07\x09")),
        ("IMUS", inertial(SAMPLES)),
    ]
    source = recording(tmp_path / "a.aedat4", packets)
    nvsdata.write(source, tmp_path / "a.h5")
    found = nvsdata.open(tmp_path / "a.h5")
    assert found.read() == source.read()
    assert np.array_equal(found.inertial().t, source.inertial().t)
    (frame_found,) = found.frames()
    assert (frame_found.exposure_start, frame_found.pixels.tolist()) == (1_200, [[7, 9]])


def test_a_copy_of_the_real_file_holds_the_same(shared_samples, tmp_path):
    pytest.importorskip("lz4")
    given = nvsdata.open(shared_samples.parent / "pairs" / "street_davis346.aedat4")
    nvsdata.write(given, tmp_path / "a.aedat4")
    copy = nvsdata.open(tmp_path / "a.aedat4")
    assert copy.read() == given.read()
    assert copy.about == given.about
    for ours, theirs in zip(copy.inertial(), given.inertial(), strict=True):
        assert np.array_equal(ours, theirs)
    for ours, theirs in zip(copy.frames(), given.frames(), strict=True):
        assert (ours.start, ours.exposure_start, ours.end) == (theirs.start, theirs.exposure_start, theirs.end)
        assert np.array_equal(ours.pixels, theirs.pixels)


def test_the_real_file_with_frames(shared_samples):
    aedat = pytest.importorskip("aedat")
    path = shared_samples.parent / "pairs" / "street_davis346.aedat4"
    found = nvsdata.open(path)
    theirs = list(aedat.Decoder(str(path)))
    frames = [packet["frame"] for packet in theirs if "frame" in packet]
    for ours, other in zip(found.frames(), frames, strict=True):
        assert np.array_equal(ours.pixels, other["pixels"])
        times = (ours.start, ours.exposure_start, ours.exposure_end, ours.end)
        assert times == tuple(int(other[name]) for name in ("begin_t", "exposure_begin_t", "exposure_end_t", "end_t"))
    samples = np.concatenate([packet["imus"] for packet in theirs if "imus" in packet])
    inertial = found.inertial()
    assert np.array_equal(inertial.t, samples["t"].astype(np.int64))
    for column, names in ((inertial.acceleration, "accelerometer"), (inertial.rotation, "gyroscope")):
        for i, axis in enumerate("xyz"):
            assert np.array_equal(column[:, i], samples[f"{names}_{axis}"])
    assert np.array_equal(inertial.temperature, samples["temperature"])
    assert found.span == (1589163147368868, 1589163147538809)


def test_a_frame_of_an_unknown_kind_costs_no_other(tmp_path):
    good, odd = (frame([1, 1, 1, 1, 1], kind, 4, 3, (0, 0), bytes(12)) for kind in (GRAY8, 5))
    strict = recording(tmp_path / "a.aedat4", [("FRME", good), ("FRME", odd), ("FRME", good)])
    with pytest.raises(FormatError, match=r"damaged AEDAT 4: a frame of \d+x\d+ pixels of type 5 in"):
        list(strict.frames())
    found = nvsdata.open(tmp_path / "a.aedat4", strict=False)
    assert len(list(found.frames())) == 2
    assert found.repairs == {"damaged packets of FRME, left out": 1}


def test_damaged_samples_stop_no_repair(tmp_path):
    packets = [("IMUS", inertial(SAMPLES)), ("FRME", b"\0" * 100), ("FRME", b"\0" * 100)]
    strict = recording(tmp_path / "a.aedat4", packets)
    with pytest.raises(FormatError, match="no FRME"):
        list(strict.frames())
    found = nvsdata.open(tmp_path / "a.aedat4", strict=False, sensor_size=(20, 20))
    assert list(found.frames()) == []
    assert found.repairs == {"damaged packets of FRME, left out": 2}
    assert found.inertial().t.size == len(SAMPLES)
    raw = (tmp_path / "a.aedat4").read_bytes()
    (tmp_path / "a.aedat4").write_bytes(raw[:-50])
    found = nvsdata.open(tmp_path / "a.aedat4", strict=False, sensor_size=(20, 20))
    assert len(found.read()) == 2
    assert found.inertial().t.size == len(SAMPLES)
    assert list(found.frames()) == []
    # what isn't needed stops nothing
    assert main(["convert", str(tmp_path / "a.aedat4"), str(tmp_path / "b.dat"), "--repair"]) == 0
    assert len(nvsdata.read(tmp_path / "b.dat")) == 2


def test_convert_says_what_is_lost_and_keeps_its_journal(tmp_path, capsys):
    packets = [("IMUS", inertial(SAMPLES)), ("TRIG", triggers([(5, 1)]))]
    recording(tmp_path / "a.aedat4", packets)
    for words, lost in (
        (["b.dat"], "frames and inertial samples and external triggers"),
        (["b.aedat", "--format", "aedat3"], "frames and inertial samples and external triggers"),
        (["b.h5"], "external triggers"),
    ):
        name, *rest = words
        args = ["convert", str(tmp_path / "a.aedat4"), str(tmp_path / name), *rest, "--sensor-size", "20x20"]
        assert main([*args, "--overwrite"]) == 0
        assert f"{name} can't contain everything: {lost} are left out" in capsys.readouterr().err
