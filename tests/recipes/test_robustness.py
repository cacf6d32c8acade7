import json
import sys

import cv2
import numpy as np
import pytest
from places import RECIPES

from nvsdata import Events


@pytest.fixture
def recipe(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    import baselines
    import robustness

    # one choice of each setting, because selecting them takes longer than the rest
    for name in ("CELLS", "WINDOWS", "ROOTS", "PENALTIES"):
        monkeypatch.setattr(baselines, name, getattr(baselines, name)[-1:])
    return robustness


def some_events(count=400):
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, 300_000, count))
    return Events(t, rng.integers(0, 34, count), rng.integers(0, 34, count), rng.integers(0, 2, count), (34, 34))


@pytest.mark.parametrize("name", ["noise", "dropped events", "time jitter", "shift", "speed", "contrast"])
def test_without_strength_nothing_changes_and_with_it_the_same_at_each_call(recipe, name):
    events, corruption = some_events(), recipe.CORRUPTIONS[name]
    same = recipe.corrupted(events, name, corruption.none, 7)
    assert all(np.array_equal(one, other) for one, other in zip(same.columns, events.columns, strict=True))
    for strength in corruption.strengths:
        first, again = (recipe.corrupted(events, name, strength, 7) for _ in range(2))
        assert all(np.array_equal(one, other) for one, other in zip(first.columns, again.columns, strict=True))
        assert len(first) != len(events) or any(
            not np.array_equal(one, other) for one, other in zip(first.columns, events.columns, strict=True)
        )


@pytest.mark.parametrize("name", ["noise", "dropped events", "time jitter"])
def test_random_numbers_differ_between_recordings(recipe, name):
    strength = recipe.CORRUPTIONS[name].strengths[0]
    first, other = (recipe.corrupted(some_events(), name, strength, number) for number in (0, 1))
    assert len(first) != len(other) or any(
        not np.array_equal(*pair) for pair in zip(first.columns, other.columns, strict=True)
    )


def test_stronger_corruptions_remove_more(recipe):
    events = some_events(5_000)
    for name in ("dropped events", "shift", "contrast"):
        corruption = recipe.CORRUPTIONS[name]
        counts = [len(recipe.corrupted(events, name, s, 0)) for s in (corruption.none, *corruption.strengths)]
        assert counts == sorted(counts, reverse=True)
        assert len(set(counts)) == len(counts)
    # 1 event per pixel and s on 34x34 pixels
    expected = len(events) + round(34 * 34 * (events.end - events.start) / 1e6)
    assert len(recipe.corrupted(events, "noise", 1, 0)) == expected
    assert recipe.corrupted(events, "speed", 2, 0).duration == pytest.approx(events.duration / 2, abs=2)


def test_less_contrast_keeps_an_event_where_steps_add_up(recipe):
    # up, up, down, up, up at one pixel, and one step at another one
    events = Events([0, 1, 2, 3, 4, 5], [1, 1, 1, 2, 1, 1], [0] * 6, [1, 1, 0, 1, 1, 1], (4, 4))
    assert recipe.lower_contrast(events, 2).t.tolist() == [1]
    assert recipe.lower_contrast(events, 3).t.tolist() == [5]
    # a threshold that is n times as high has at most an n-th of the events
    assert all(len(recipe.lower_contrast(some_events(5_000), n)) <= 5_000 / n for n in (2, 3, 4))


@pytest.fixture
def trained(run, many, tmp_path):
    flags = ("--dataset", "n-mnist", "--root", many, "--epochs", 1, "--votes", 1, "--validate", 0.4, "--device", "cpu")
    pixels = ("--nodes", "pixels", "--radius", 1.5, "--kernel-size", 3, "--window", 100_000, "--features", "bins4")
    run("train_objects.py", *flags, *pixels, "--no-report", "--out", tmp_path / "rg-cnn")
    return tmp_path / "rg-cnn"


def test_a_run_reports_resumes_and_repeats(run, many, tmp_path, trained, recipe):
    words = ("--dataset", "n-mnist", "--root", many, "--votes", 1, "--validate", 0.4, "--runs", trained)
    said = run("robustness.py", *words, "--out", tmp_path / "one")
    found = json.loads((tmp_path / "one/robustness.json").read_bytes())
    cells = {(one["network"], one["corruption"], one["strength"]): one["accuracy"] for one in found["cells"]}
    assert len(cells) == 2 * (1 + sum(len(one.strengths) for one in recipe.CORRUPTIONS.values()))
    assert found["recordings"] == 20
    assert all(low <= value <= high for value, low, high in cells.values())
    # each corruption's curve contains the accuracy without it
    for name, corruption in recipe.CORRUPTIONS.items():
        for network in ("rg-cnn", recipe.HATS):
            points = recipe.curve(found["cells"], network, name)
            assert [strength for strength, _ in points] == sorted((corruption.none, *corruption.strengths))
            assert dict(points)[corruption.none] == cells[network, "none", 0]
    assert f"{cells[recipe.HATS, 'noise', 3][0]:.3f}" in said
    assert cv2.imread(str(tmp_path / "one/robustness.png")).shape == (640, 1080, 3)
    # an interrupted run measures what is missing, with the same results
    journal = tmp_path / "one/cells.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:-6]) + lines[-6][:30])
    again = run("robustness.py", *words, "--out", tmp_path / "one")
    assert again.count(": ") == 6
    assert json.loads((tmp_path / "one/robustness.json").read_bytes()) == found
    with pytest.raises(SystemExit, match=r"cells\.jsonl is of other recordings or settings: choose another folder"):
        run("robustness.py", *words, "--out", tmp_path / "one", "--votes", 2)


def test_networks_of_other_test_recordings_are_refused(run, many, tmp_path, trained):
    (many / "Test/3/00002.bin").unlink()
    with pytest.raises(
        SystemExit, match=r"rg-cnn was trained on other recordings: choose its dataset, root and --seed"
    ):
        run(
            "robustness.py",
            "--dataset",
            "n-mnist",
            "--root",
            many,
            "--out",
            tmp_path / "out",
            "--validate",
            0.4,
            "--runs",
            trained,
        )


def test_missing_networks_are_trained(recipe, monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "argv", ["robustness.py", "--dataset", "n-mnist", "--root", "R", "--out", str(tmp_path)])
    (tmp_path / "rg-cnn").mkdir()
    (tmp_path / "rg-cnn/report.json").write_text("{}")
    commands = []

    class Done:
        returncode = 0

    monkeypatch.setattr(recipe.subprocess, "run", lambda words, check: commands.append(words) or Done)
    assert list(recipe.trained_in(recipe.arguments())) == [tmp_path / "rg-cnn", tmp_path / "resnet50"]
    assert len(commands) == 1
    assert {"--resume", "--network", str(tmp_path / "resnet50")} <= {*commands[0]}
    Done.returncode = 1
    with pytest.raises(ValueError, match=r"the training in .*resnet50 failed"):
        list(recipe.trained_in(recipe.arguments()))
