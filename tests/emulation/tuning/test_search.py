import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from clips import moving_square, write_video

import nvsdata
from nvsdata import Events, metrics
from nvsdata.cli import main
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.tuning.objective import Pair, table
from nvsdata.emulation.tuning.search import SPACE, Range, search

FPS = 25


@pytest.fixture(scope="module")
def frames():
    """A camera that passes over a blotchy ground."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (80, 110)), (0, 0), 3)
    ground = np.interp(ground, (ground.min(), ground.max()), (5, 250)).astype(np.uint8)
    return [ground[n : n + 48, 2 * n : 2 * n + 64] for n in range(12)]


@pytest.mark.parametrize("threshold", [0.15, 0.35])
def test_a_search_finds_settings_as_good_as_the_hidden_ones(frames, threshold):
    hidden = PIX2NVS(threshold=threshold, max_events=2, alpha=0.4)
    real = replace(hidden, noise_rate=3, mismatch=0.05, seed=5).emulate(frames, fps=FPS)
    pair = Pair(real, frames, fps=FPS)
    found = search(pair, trials=100, seed=1)
    both = metrics.score([*(trial.distances for trial in found.trials), pair(hidden)])
    assert both[:-1].min() <= 1.05 * both[-1]
    assert found.best.distances == found.trials[int(np.argmin(found.scores))].distances


def test_a_pair_has_the_colors_of_a_file_for_hue_and_its_luma_for_the_rest(tmp_path):
    frames = moving_square()
    for frame in frames:
        frame[frame[..., 2] > 200, 2] //= 4  # the square is of another hue than the ground
    path = write_video(tmp_path / "a.avi", frames, fps=FPS)
    pair = Pair(PIX2NVS().emulate(path), path)
    for settings in (PIX2NVS(), PIX2NVS(hue=True, threshold=0.05)):
        assert len(settings.emulate(path)) > 50
        assert pair.emulate(settings) == settings.emulate(path)


def bowl(settings):
    """Distances that are least at one place."""
    far = abs(np.log(settings.threshold / 0.3)) + abs(settings.max_events - 3) + settings.exp
    return far + 0.1, far + 0.2, 1.0


def test_the_search_narrows_down():
    found = search(bowl, trials=200)
    best = found.best.settings
    assert best.threshold == pytest.approx(0.3, rel=0.1)
    assert (best.max_events, best.exp) == (3, False)
    late = [trial.settings.threshold for trial in found.trials[-20:]]
    early = [trial.settings.threshold for trial in found.trials[:16]]
    near, far = (np.median(np.abs(np.log(np.array(values) / 0.3))) for values in (late, early))
    assert near < 0.1 < far


def test_jobs_do_not_change_the_search():
    one, two = (search(bowl, trials=30, seed=3, jobs=jobs) for jobs in (1, 2))
    assert one.trials == two.trials
    assert one.trials != search(bowl, trials=30, seed=4).trials


def test_a_stopped_search_goes_on(tmp_path):
    journal = tmp_path / "trials.jsonl"
    whole = search(bowl, trials=40)
    calls = []

    def counted(settings):
        calls.append(settings)
        if len(calls) == 19:
            raise KeyboardInterrupt
        return bowl(settings)

    with pytest.raises(KeyboardInterrupt):
        search(counted, trials=40, journal=journal)
    kept = len(journal.read_text().splitlines()) - 1
    assert 12 <= kept <= 18
    before = len(calls)
    with journal.open("a") as file:
        file.write('{"trial": 17, "dist')  # as a kill would leave it
    assert search(counted, trials=40, journal=journal).trials == whole.trials
    assert len(calls) == before + 40 - kept
    assert search(counted, trials=40, journal=journal).trials == whole.trials
    assert len(calls) == before + 40 - kept
    with pytest.raises(ValueError, match="is of another search"):
        search(bowl, trials=40, seed=1, journal=journal)


def test_ranges_and_spaces():
    assert [Range(1, 3, whole=True).at(share) for share in (0, 0.3, 0.4, 0.99, 1)] == [1, 1, 2, 3, 3]
    assert Range(0.1, 10, log=True).at(0.5) == pytest.approx(1)
    assert Range(2, 4).at(0.25) == 2.5
    with pytest.raises(ValueError, match="no setting 'treshold'"):
        search(bowl, space={"treshold": (1, 2)})
    with pytest.raises(ValueError, match="no choices for new"):
        search(bowl, space={"new": ()})
    for trial in search(bowl, space={"threshold": Range(0.2, 0.3)}, base=PIX2NVS(seed=9), trials=6).trials:
        assert replace(trial.settings, threshold=0.2) == PIX2NVS(seed=9)
        assert 0.2 <= trial.settings.threshold <= 0.3


def test_settings_without_events_rank_last(frames):
    real = PIX2NVS().emulate(frames, fps=FPS)
    found = search(Pair(real, frames, fps=FPS), space={"threshold": (0.2, 30.0)}, trials=8)
    assert found.best.settings.threshold == 0.2
    assert np.isinf(found.scores).any()
    assert len(table(found).splitlines()) <= 6


def test_the_table_has_the_columns_of_table_3_3():
    lines = table(search(bowl, trials=20)).splitlines()
    assert lines[0].split()[:6] == ["T_log", "B", "M_max", "T_map", "new", "exp"]
    scores = [float(line.split()[-1]) for line in lines[1:]]
    assert len(scores) == 5
    assert scores == sorted(scores, reverse=True)


@pytest.fixture
def files(tmp_path, frames):
    video = write_video(tmp_path / "v.avi", [np.dstack([frame] * 3) for frame in frames])
    nvsdata.write(PIX2NVS(noise_rate=1).emulate(video), tmp_path / "real.h5")
    nvsdata.write(PIX2NVS(threshold=0.1).emulate(video), tmp_path / "emulated.h5")
    return tmp_path


def test_compare_prints_and_draws(files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    assert main(["compare", "emulated.h5", "real.h5", "--fps", "25"]) == 0
    out = capsys.readouterr().out
    a, b = (nvsdata.read(files / name) for name in ("emulated.h5", "real.h5"))
    for value in metrics.compare(a, b, 25).values[1:]:
        assert 0 < value < 100
        assert f"{value:.4f}" in out
    assert (files / "compare.png").stat().st_size > 500
    nvsdata.write(Events([1], [1], [1], [1], (9, 9)), files / "other.h5")
    assert main(["compare", "emulated.h5", "other.h5"]) == 1
    assert main(["compare", "emulated.h5", "none.h5"]) == 1
    assert "none.h5" in capsys.readouterr().err


def test_tune_holds_what_is_given(files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    words = "tune --real real.h5 --video v.avi --trials 8 --max-events 2 --no-exp --seed 4".split()
    assert main(words) == 0
    assert "T_map" in capsys.readouterr().out
    lines = [json.loads(line) for line in (files / "tuning/trials.jsonl").read_text().splitlines()]
    assert {line["settings"]["max_events"] for line in lines[1:]} == {2}
    assert {line["settings"]["exp"] for line in lines[1:]} == {False}
    assert len({line["settings"]["threshold"] for line in lines[1:]}) == 8
    assert set(lines[0]["space"]) == set(SPACE) - {"max_events", "exp"}
    for name in ("score.png", "best.png", "table.txt"):
        assert (files / "tuning" / name).stat().st_size > 0
    assert main([*words[:-1], "5"]) == 1
    assert "another search" in capsys.readouterr().err
