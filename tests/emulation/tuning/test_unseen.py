"""What tuning keeps from the search, and where the search for a DVS begins."""

import json
import re

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import nvsdata
from nvsdata import Events
from nvsdata.cli import main
from nvsdata.emulation import DVS, PIX2NVS
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.search import Measured, search
from nvsdata.emulation.tuning.space import SENSOR_SPACE, SPACE, place_of, settings_at
from nvsdata.video.frames import VideoFrame

SENSOR = DVS(on=0.2, off=0.25, dark=5.0)


@pytest.fixture(scope="module")
def stills():
    """A camera that passes over a blotchy ground."""
    rng = np.random.default_rng(1)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (90, 130)), (0, 0), 2)
    ground = np.interp(ground, (ground.min(), ground.max()), (5, 250)).astype(np.uint8)
    return [ground[n : n + 48, 2 * n : 2 * n + 64] for n in range(21)]


@pytest.mark.parametrize("offset", [0, 3_000, -7_000])
@pytest.mark.parametrize("share", [0.1, 0.25, 0.5])
def test_parts_have_all_frames_and_each_event_once(stills, offset, share):
    real = SENSOR.emulate(stills, fps=25)
    whole = TuningPair(real, stills, fps=25, offset=offset)
    seen, rest = whole.split(share)
    assert len(seen.frames) + len(rest.frames) == len(stills) + 1
    assert len(rest.frames) - 1 == {0.1: 2, 0.25: 5, 0.5: 10}[share]
    edge = seen.frames[-1].time
    assert [frame.time for frame in rest.frames] == [
        frame.time - edge for frame in whole.frames[len(seen.frames) - 1 :]
    ]
    assert all(np.array_equal(a.pixels, b) for a, b in zip(rest.frames, stills[len(seen.frames) - 1 :], strict=True))
    assert seen.fps == rest.fps == whole.fps
    # on the clock of the video
    first, second = (part.real.t - part.real.start + part.offset for part in (seen, rest))
    assert first.max(initial=0) < edge <= edge + second.min(initial=0)
    assert np.array_equal(np.concatenate((first, second + edge)), whole.real.t - whole.real.start + offset)
    assert tuple(map(sum, zip(seen.real_events, rest.real_events, strict=True))) == whole.real_events


def test_an_emulator_that_is_the_sensor_is_as_near_on_each_part(stills):
    # one that looks at the last frame only, so that nothing reaches over the edge
    settings = PIX2NVS(exp=False, max_events=2)
    for part in TuningPair(settings.emulate(stills, fps=25), stills, fps=25).split(0.3):
        assert part(settings).distances == (0,) * len(part(settings).distances)


def test_a_part_has_its_colors():
    rng = np.random.default_rng(0)
    stills = list(rng.integers(0, 256, (6, 12, 16, 3), dtype=np.uint8))
    pair = TuningPair(PIX2NVS(hue=True).emulate(stills, fps=25), stills, fps=25)
    rest = pair.split(0.4)[1]
    assert rest.colored
    assert rest.emulate(PIX2NVS(hue=True)) == PIX2NVS(hue=True).emulate(stills[3:], fps=25)


def test_events_that_begin_late_keep_their_place():
    t = 1_200_000
    frames = [VideoFrame(1_000_000 + 40_000 * n, np.full((4, 4), 50 + n, np.uint8)) for n in range(8)]
    late = Events([t + 5], [0], [0], [1], (4, 4), start=t, end=1_300_000)
    pair = TuningPair(late, frames)
    assert pair.real.t[0] - pair.real.start == 200_005
    seen, rest = pair.split(0.5)
    assert (len(seen.real), (rest.real.t - rest.real.start).tolist()) == (0, [80_005])
    early = TuningPair(Events([70_000, 200_005], [0] * 2, [0] * 2, [1] * 2, (4, 4)), [f.pixels for f in frames], fps=25)
    assert early.real.t[0] == early.real.start


@pytest.mark.parametrize(("count", "share"), [(2, 0.25), (3, 0.9), (5, 0.9)])
def test_a_pair_that_is_too_short_is_told(stills, count, share):
    pair = TuningPair(SENSOR.emulate(stills[:count], fps=25), stills[:count], fps=25)
    with pytest.raises(ValueError, match=f"{count} frames can't be split with {share:.0%} in the second part"):
        pair.split(share)
    with pytest.raises(ValueError, match=r"^the video: 1 frames in the time that is compared"):
        TuningPair(pair.real, stills[:count], fps=25, seconds=1e-6)


@given(st.lists(st.floats(0, 1), min_size=len(SPACE), max_size=len(SPACE)))
def test_places_are_found_back(shares):
    for base, space in ((PIX2NVS(), SPACE), (DVS(), SENSOR_SPACE)):
        settings = settings_at(base, space, shares[: len(space)])
        place = place_of(settings, space)
        again = settings_at(base, space, place)
        assert all(0 <= share <= 1 for share in place)
        assert {name: pytest.approx(getattr(settings, name)) for name in space} == {n: getattr(again, n) for n in space}


def test_a_place_outside_is_the_nearest():
    place = dict(zip(SENSOR_SPACE, place_of(DVS(on=0.01, off=2.0, cutoff=77.0, leak=9.0), SENSOR_SPACE), strict=True))
    assert (place["on"], place["off"], place["cutoff"], place["leak"]) == (0, 1, 0.625, 1)


def bowl(settings):
    far = abs(np.log(settings.on / 0.21)) + abs(np.log(settings.off / 0.3)) + settings.leak
    return Measured((far + 0.1, 1.0), (1, 2))


def test_a_search_that_begins_near_finds_more(tmp_path):
    start = DVS(on=0.2, off=0.31)
    near, far = (search(bowl, base=DVS(), start=begin, trials=24).best for begin in (start, None))
    assert near.distances[0] < far.distances[0] / 2
    journal = tmp_path / "trials.jsonl"
    found = search(bowl, base=DVS(), start=start, trials=12, journal=journal)
    assert found.trials[0].settings == start
    assert found.trials == search(bowl, base=DVS(), start=start, trials=24).trials[:12]
    with pytest.raises(ValueError, match="another search"):
        search(bowl, base=DVS(), start=DVS(), trials=12, journal=journal)


def test_tune_fits_a_sensor_and_reports_on_what_it_has_not_seen(stills, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shown").mkdir()
    for n, still in enumerate(stills):
        cv2.imwrite(f"shown/{n:03d}.png", still)
    (tmp_path / "shown/timestamps.txt").write_text("\n".join(str(40_000 * n) for n in range(len(stills))))
    nvsdata.write(SENSOR.emulate(stills, fps=25), "real.h5")
    words = [
        "tune",
        "--preset",
        "ideal",
        "--real",
        "real.h5",
        "--video",
        "shown",
        "--trials",
        "5",
        "--set",
        "noise_rate=0",
    ]
    assert main(words) == 0
    output = capsys.readouterr().out
    assert "began with a fit: events follow the frames by " in output
    found = {
        name: tuple(map(float, numbers))
        for name, *numbers in re.findall(r"\n  (\w+) (\S+) \(95% interval (\S+) to (\S+)\)", output)
    }
    assert {"on", "off", "dark", "delay"} >= found.keys() >= {"on", "off"}
    assert all(low <= value <= high for value, low, high in found.values())
    lines = [json.loads(line) for line in (tmp_path / "tuning/trials.jsonl").read_text().splitlines()]
    first = lines[1]["settings"]
    assert lines[0]["start"] == {"emulator": "DVS", **first}
    assert first["noise_rate"] == 0
    assert (first["on"], first["off"]) == (pytest.approx(SENSOR.on, rel=0.15), pytest.approx(SENSOR.off, rel=0.15))
    table = output[output.index("unseen part") :].splitlines()
    _, rest = TuningPair(nvsdata.open("real.h5"), tmp_path / "shown").split(0.25)
    best = json.loads((tmp_path / "tuning/best.json").read_text())
    assert best.pop("nvsdata-dvs") == 1
    for row, name, settings in zip(table[1:], ("best", "fit"), (DVS(**best), DVS(**first)), strict=False):
        found = rest(settings)
        figures = (*(f"{value:.3f}" for value in found.distances), *(f"{count:,}" for count in found.events))
        assert row.split() == [name, *figures]
    assert table[3].split()[0] == "camera"
    assert table[3].split()[1:] == [f"{count:,}" for count in rest.real_events]
    assert "unseen part" in (tmp_path / "tuning/table.txt").read_text()
    # all of it for the search
    assert main([*words, "--unseen", "0", "--out", "all"]) == 0
    assert "unseen part" not in capsys.readouterr().out
    # a pair that tells nothing
    nvsdata.write(SENSOR.emulate(stills[:3], fps=25), "short.h5")
    short = ["--real", "short.h5", "--video", "shown", "--seconds", "0.05", "--unseen", "0", "--out", "b"]
    assert main([*words[:3], *short, "--trials", "3"]) == 0
    assert "began with random settings, because the fit failed: 2 frames: a fit needs" in capsys.readouterr().out
