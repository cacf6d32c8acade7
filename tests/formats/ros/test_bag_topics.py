"""Choice of topics in ROS bags; frames, inertial samples, triggers; conversion, and what commands say."""

import json
import sys

import cv2
import numpy as np
import pytest
from rosbag_files import EPOCH, EVENTS, WAYS, Types, write_bag

import nvsdata
from nvsdata import FormatError
from nvsdata.cli import main
from nvsdata.kernels.decode.evt3 import evt3_encode

pytest.importorskip("rosbags")
every_way = pytest.mark.parametrize("way", WAYS)


def one(types, x, t=EPOCH):
    return types.events([t], [x], [2], [1], (8, 6))


@every_way
def test_a_topic_of_several_is_chosen_in_the_path(tmp_path, way):
    types = Types(way)
    grey = [np.full((6, 8), value, np.uint8) for value in (10, 20)]
    messages = []
    for k, side in enumerate(("left", "right")):
        messages.append((f"/davis/{side}/events", k, one(types, k + 1)))
        messages.append((f"/davis/{side}/image_raw", k, types.image(EPOCH * 1000, grey[k])))
    path = write_bag(tmp_path, types, messages)
    named = rf"{path.name}: events on /davis/left/events \(.*\), /davis/right/events \(.*\): choose a topic, as in "
    with pytest.raises(FormatError, match=f"{named}{path.name}#/davis/left/events"):
        nvsdata.open(path)
    for k, side in enumerate(("left", "right")):
        recording = nvsdata.open(f"{path}#/davis/{side}/events")
        assert recording.read().x.tolist() == [k + 1]
        assert [int(frame.pixels[0, 0]) for frame in recording.frames()] == [10 * (k + 1)]
    with pytest.raises(FormatError, match="no topic /davis/up; there are /davis/left/events"):
        nvsdata.open(f"{path}#/davis/up")
    with pytest.raises(FormatError, match="no topic of events"):
        nvsdata.open(f"{path}#/davis/left/image_raw")


def test_other_formats_have_no_topics(tmp_path):
    nvsdata.write(nvsdata.Events([1], [1], [1], [1]), tmp_path / "a.h5")
    with pytest.raises(FormatError, match="no stream /events: files of hdf5 have no named streams"):
        nvsdata.open(f"{tmp_path}/a.h5#/events")


@pytest.mark.parametrize("name", ["a?b=c.bag", "a#b", "a%41", "a#/b"])
def test_names_of_files_with_marks(tmp_path, name):
    way = "bag" if name.endswith("bag") else "db3"
    types = Types(way)
    path = write_bag(tmp_path, types, [("/e", 1, one(types, 3))])
    target = tmp_path / name
    target.parent.mkdir(exist_ok=True)
    path.rename(target)
    assert nvsdata.read(target).x.tolist() == [3]


def test_a_bag_without_events(tmp_path):
    types = Types("mcap")
    path = write_bag(tmp_path, types, [("/imu", 1, types.imu(1, (0, 0, 0), (0, 0, 0)))])
    with pytest.raises(FormatError, match=r"no topic of events \(dvs_msgs.*\); there are /imu \(sensor_msgs/msg/Imu\)"):
        nvsdata.open(path)


@every_way
def test_frames_and_inertial_samples(tmp_path, way):
    types, rng = Types(way), np.random.default_rng(0)
    color, deep = rng.integers(0, 256, (6, 8, 3), np.uint8), rng.integers(0, 1 << 16, (6, 8)).astype("<u2")
    shown = {
        "mono8": color[..., 0],
        "rgb8": color,
        "bgr8": color,
        "mono16": deep,
        "bayer_rggb8": np.full((6, 8), 7, np.uint8),
    }
    messages = [("/dvs/events", 0, one(types, 1))]
    for k, (encoding, pixels) in enumerate(shown.items()):
        ns = (EPOCH + 200_000 * k) * 1000 + 999
        messages.append(("/dvs/image_raw", 100 + k, types.image(ns, pixels, encoding)))
        messages.append(("/dvs/imu", 100 + k, types.imu(ns, (np.pi, 0, -np.pi / 2), (0, 9.80665, -19.6133))))
    recording = nvsdata.open(write_bag(tmp_path, types, messages))
    times = [EPOCH + 200_000 * k for k in range(5)]
    wanted = [color[..., 0], cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), cv2.cvtColor(color, cv2.COLOR_BGR2GRAY), deep]
    wanted.append(shown["bayer_rggb8"])
    frames = list(recording.frames())
    assert [frame.exposure_start for frame in frames] == times
    for frame, pixels in zip(frames, wanted, strict=True):
        np.testing.assert_array_equal(frame.pixels, pixels)
    samples = recording.inertial()
    assert samples.t.tolist() == times
    np.testing.assert_allclose(samples.rotation, [(180, 0, -90)] * 5, rtol=1e-6)
    np.testing.assert_allclose(samples.acceleration, [(0, 1, -2)] * 5, rtol=1e-6)
    # windows
    a, b = times[1], times[3]
    assert [frame.start for frame in recording.frames(a, b)] == times[1:3]
    assert recording.inertial(a, b).t.tolist() == times[1:3]
    assert recording.inertial(a + 1).t.tolist() == times[2:]


def test_gray_of_bayer_patterns_follows_the_colors(tmp_path):
    """A pure red scene is as bright as OpenCV makes red, whatever the pattern."""
    types, messages = Types("bag"), [("/e", 0, one(Types("bag"), 1))]
    for k, pattern in enumerate(("rggb", "bggr", "gbrg", "grbg")):
        tile = np.array([255 * (color == "r") for color in pattern], np.uint8).reshape(2, 2)
        messages.append(("/image", k, types.image(k, np.tile(tile, (8, 8)), f"bayer_{pattern}8")))
    frames = list(nvsdata.open(write_bag(tmp_path, types, messages)).frames())
    red = int(cv2.cvtColor(np.array([[[255, 0, 0]]], np.uint8), cv2.COLOR_RGB2GRAY)[0, 0])
    assert len(frames) == 4
    for frame in frames:
        assert np.abs(frame.pixels[4:-4, 4:-4].astype(int) - red).max() <= 1


@every_way
def test_samples_are_moved_to_the_clock_of_packets(tmp_path, way):
    """EVT3 and mono packets have times of the camera; a message's stamp says what they are since 1970."""
    types, size = Types(way), (8, 6)
    events = nvsdata.Events([500, 900], [1, 2], [1, 2], [1, 0])
    words = evt3_encode(*events.columns, np.full(3, -1, np.int64))
    word = np.array([5_000 | 1 << 32], "<u8").tobytes()
    packets = {"evt3": types.packet(words.tobytes(), size, "evt3", stamp=EPOCH * 1000)}
    packets["mono"] = types.packet(word, size, "mono", base=495_000, stamp=EPOCH * 1000 - 5_000)
    for encoding, packet in packets.items():
        messages = [("/ev", 0, packet), ("/imu", 1, types.imu((EPOCH + 70) * 1000, (0, 0, 0), (0, 0, 0)))]
        messages.append(("/image", 2, types.image((EPOCH + 90) * 1000, np.zeros((6, 8), np.uint8))))
        recording = nvsdata.open(write_bag(tmp_path, types, messages, name=encoding))
        assert recording.read().t[0] == 500
        assert recording.inertial().t.tolist() == [570]
        assert recording.inertial(570, 571).t.tolist() == [570]
        assert [frame.start for frame in recording.frames(580, 600)] == [590]


@every_way
def test_triggers(tmp_path, way):
    types, size = Types(way), (8, 6)
    head = evt3_encode(*nvsdata.Events([500], [1], [1], [1]).columns, np.full(3, -1, np.int64))
    # EXT_TRIGGER on input 2, rising
    words = np.append(head, np.uint16(0xA201))
    apart = np.array([1_000 | 1 << 63, 5_999 | 3 << 48], "<u8").tobytes()
    messages = [("/cam/ev", 0, types.packet(words.tobytes(), size, "evt3"))]
    messages.append(("/cam/trigger", 1, types.packet(apart, size, "trigger", base=1_000_000)))
    recording = nvsdata.open(write_bag(tmp_path, types, messages))
    assert recording.holds_triggers
    found = recording.triggers()
    assert list(zip(*(column.tolist() for column in found), strict=True)) == [(500, 2, 1), (1001, 0, 1), (1005, 3, 0)]
    assert recording.triggers(501, 1005).t.tolist() == [1001]


@every_way
def test_convert_and_info(tmp_path, capsys, way):
    types = Types(way)
    messages = [("/dvs/events", k, one(types, k, EPOCH + k)) for k in range(8)]
    messages.append(("/dvs/imu", 9, types.imu(EPOCH * 1000, (0, 0, 0), (0, 0, 0))))
    path = write_bag(tmp_path, types, messages)
    assert main(["info", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["events"], facts["first"], facts["last"], facts["sensor_size"]) == (8, EPOCH, EPOCH + 7, [8, 6])
    assert facts["format"] == ("rosbag" if way == "bag" else "rosbag2")
    for suffix in ("npy", "h5", "txt"):
        assert main(["convert", str(path), str(tmp_path / f"b.{suffix}")]) == 0
        assert nvsdata.read(tmp_path / f"b.{suffix}", sensor_size=(8, 6)) == nvsdata.read(path)
    assert "inertial samples" in capsys.readouterr().err
    assert nvsdata.open(tmp_path / "b.h5").inertial().t.tolist() == [EPOCH]
    assert main(["info", f"{path}#/no"]) == 1
    assert f"{path}: no topic /no; there are /dvs/events" in capsys.readouterr().err
    assert main(["info", str(tmp_path / "no.bag")]) == 1
    assert "No such file" in capsys.readouterr().err


@pytest.mark.parametrize("way", ["mcap", "db3"])
def test_a_bag_of_ros_2_is_its_folder_its_metadata_or_its_file(tmp_path, way):
    types = Types(way)
    path = write_bag(tmp_path, types, [("/e", 1, one(types, 3))])
    for place in (path, path / "metadata.yaml", path / f"{path.name}.{way}"):
        assert nvsdata.read(place).x.tolist() == [3]
    (path / "metadata.yaml").unlink()
    with pytest.raises(FormatError, match="is a folder, not a recording"):
        nvsdata.open(path)


def test_without_rosbags(tmp_path, monkeypatch, capsys):
    types = Types("bag")
    path = write_bag(tmp_path, types, [("/e", 1, one(types, 3, EPOCH))])
    for name in [name for name in sys.modules if name.split(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(ImportError, match=r"a\.bag: ROS bags need the package rosbags: pip install 'nvsdata\[ros\]'"):
        nvsdata.open(path)
    assert main(["info", str(path)]) != 0
    assert "pip install 'nvsdata[ros]'" in capsys.readouterr().err


def test_prophesee_and_dvs_are_both_events(tmp_path):
    types = Types("bag")
    messages = [("/a", 1, one(types, 1)), ("/b", 2, types.events([EPOCH], [2], [2], [1], (8, 6), EVENTS[1]))]
    path = write_bag(tmp_path, types, messages)
    assert [nvsdata.read(f"{path}#{topic}").x.tolist() for topic in ("/a", "/b")] == [[1], [2]]
