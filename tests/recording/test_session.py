import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import nvsdata
from nvsdata.cli import main
from nvsdata.recording.davis import driver
from nvsdata.recording.davis.registers import CameraSettings
from nvsdata.recording.session import settings_of
from nvsdata.recording.simulated.camera import picture


def test_a_simulated_recording(tmp_path, capsys):
    path = tmp_path / "a.h5"
    assert main(["record", "--out", str(path), "--seconds", "0.3", "--simulate", "--bias", "OnBn=5:200"]) == 0
    out, err = capsys.readouterr()
    assert f"{len(nvsdata.read(path)):,} events in 0.30 s; the time was up" in out
    assert "DAVIS240C SIM00001, 240x180, for 0.3 s" in err


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--bias", "OnBn"], "--bias takes NAME=COARSE:FINE"),
        (["--bias", "Foo=1:2"], "has no bias 'Foo'"),
        (["--region", "0", "0", "500", "5"], "not within 240x180"),
        (["--simulate", "drift"], "--simulate takes NAME=NUMBER of drift, noise"),
        (["--monitor", "/nope"], "/nope: no such folder or video"),
        (["--device", "X"], "no camera of serial number X; there is SIM00001"),
    ],
)
def test_wrong_flags_are_said_in_one_line(tmp_path, capsys, flags, message):
    try:
        code = main(["record", "--out", str(tmp_path / "a.h5"), "--simulate", *flags])
    except SystemExit as ended:
        code = ended.code
    # what only the camera or the disk can tell isn't wrong usage
    assert code == (2 if flags[0] in ("--bias", "--simulate") and "Foo" not in flags[1] else 1)
    err = capsys.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_without_a_camera(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(driver.usb.core, "find", lambda **options: iter(()))
    assert main(["record", "--out", str(tmp_path / "a.h5")]) == 1
    assert "nvsdata record: no DAVIS camera is connected" in capsys.readouterr().err


def test_settings_from_a_file_and_flags(tmp_path):
    file = tmp_path / "s.json"
    given = {"biases": {"OnBn": [5, 1], "PrBp": [2, 2]}, "activity_filter": None, "masked": [[7, 8]]}
    file.write_text(json.dumps(given))
    settings = settings_of(file, ["OnBn=4:7"], region=(1, 2, 3, 4))
    assert settings == CameraSettings(
        biases={"OnBn": (4, 7), "PrBp": (2, 2)}, activity_filter=None, region=(1, 2, 3, 4), masked=((7, 8),)
    )


@pytest.mark.parametrize(
    "text",
    [
        "[",
        "{}[",
        '{"bias": 1}',
        '{"biases": {"OnBn": 5}}',
        '{"exposure": -1}',
        "[1]",
        '{"masked": [[1]]}',
        '{"polarity": "x"}',
    ],
)
def test_a_settings_file_that_makes_no_sense(tmp_path, text):
    (tmp_path / "s.json").write_text(text)
    with pytest.raises(ValueError, match=r"s\.json"):
        settings_of(tmp_path / "s.json", [])


@pytest.mark.parametrize("text", ["OnBn", "OnBn=5", "OnBn=5:", "OnBn=:5", "=5:1", "OnBn=5:x", "OnBn=x:5", "OnBn=-1:5"])
def test_a_bias_is_a_name_and_two_numbers(text):
    with pytest.raises(ValueError, match=f"--bias takes NAME=COARSE:FINE, such as OnBn=5:255, not '{text}'"):
        settings_of(None, [text])


def test_flags_replace_what_a_file_says_unless_they_are_not_given(tmp_path):
    file = tmp_path / "s.json"
    file.write_text('{"region": null, "frame_region": [1, 2, 3, 4], "frames": true, "skip": 5}')
    settings = settings_of(file, [], frames=False, skip=None, exposure=7)
    assert settings == CameraSettings(frame_region=(1, 2, 3, 4), skip=5, exposure=7)
    file.write_text('{"skip": 5, "b": 1, "a": 2}')
    with pytest.raises(ValueError, match=r"s\.json: no such setting: a, b; there are activity_filter, biases, expos"):
        settings_of(file, [])


def test_live_events_need_no_file(monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main(["record", "--live", "--simulate", "--seconds", "0.3"]) == 0
    assert "events in 0.30 s; the time was up" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", ["h5", "aedat"])
def test_frames_and_samples_that_settings_ask_for(tmp_path, capsys, suffix):
    (tmp_path / "s.json").write_text('{"frames": true, "frame_region": [10, 20, 100, 50]}')
    path = tmp_path / f"a.{suffix}"
    how = ["--simulate", "--settings", str(tmp_path / "s.json"), "--seconds", "0.5", "--bias", "OnBn=5:200"]
    assert main(["record", "--out", str(path), *how]) == 0
    recording = nvsdata.open(path)
    frames, inertial = list(recording.frames()), recording.inertial()
    assert f"{len(frames)} frames" in capsys.readouterr().out
    # a busy machine gives few
    assert 1 <= len(frames) < 14
    for frame in frames:
        assert np.array_equal(frame.pixels >> 6, picture([10, 20, 109, 69]))
        assert (frame.x, frame.y) == (10, 20)
        assert 0 <= frame.start <= frame.exposure_start < frame.exposure_end <= frame.end < 600_000
    assert 1 <= inertial.t.size < 6
    assert inertial.acceleration.tolist() == [[0, -1, 0]] * inertial.t.size
    assert inertial.temperature.tolist() == [25.0] * inertial.t.size
    if suffix == "h5":
        about = recording.about
        assert (about["camera"], about["serial"], about["temperature"]) == ("DAVIS240C", "SIM00001", 25.0)
        assert (about["biases"]["OnBn"], about["biases"]["DiffBn"]) == ([5, 200], [4, 39])
        assert abs(datetime.fromisoformat(about["started"]) - datetime.now(UTC)) < timedelta(minutes=1)


def test_a_format_says_what_it_cannot_hold_before_it_starts(tmp_path, capsys):
    (tmp_path / "s.json").write_text('{"frames": true}')
    how = ["record", "--simulate", "--seconds", "0.1", "--out", str(tmp_path / "a.txt")]
    assert main([*how, "--settings", str(tmp_path / "s.json")]) == 1
    assert capsys.readouterr().err.endswith(
        "files can't store frames: record to .h5, .aedat or .aedat4, or without frames\n"
    )
    assert not (tmp_path / "a.txt").exists()
    assert main(how) == 0
    assert ".txt files can't store inertial samples: they are left out" in capsys.readouterr().err


def test_the_recipes_preset_is_understood():
    preset = Path(__file__).parents[2] / "recipes/screen_playback/preset.json"
    assert settings_of(preset, []) == CameraSettings(activity_filter=None)
