"""A network that follows a recording, from the command line."""

import json

import numpy as np
import pytest
import torch

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T


@pytest.fixture
def model(tmp_path):
    torch.manual_seed(0)
    network = models.RGCNN(3, channels=(4, 5, 6), clusters=((2, 2), (4, 4), (7, 7)), hidden=7).eval()
    graph = T.RadiusGraph(max_degree=4)
    transform = T.Compose([T.RandomWindow(8_000), T.RateLimit(2_000), graph])
    models.save(network, tmp_path / "m.safetensors", classes=("a", "b", "c"), transform=transform)
    return network, graph


@pytest.fixture
def recording(tmp_path):
    rng = np.random.default_rng(0)
    t = 10**12 + np.sort(rng.integers(0, 40_000, 600))
    events = Events(t, *rng.integers(0, 34, (2, 600)), rng.integers(0, 2, 600), (34, 34), start=10**12)
    nvsdata.write(events, tmp_path / "r.h5")
    return events


def test_each_decision_is_that_of_its_window(tmp_path, model, recording, run):
    network, graph = model
    said = run("classify_stream.py", tmp_path / "r.h5", "--model", tmp_path / "m.safetensors", "--every", 5_000)
    lines = [json.loads(line) for line in said.splitlines()]
    assert [line["time"] - 10**12 for line in lines] == list(range(5_000, 40_001, 5_000))
    kept = T.RateLimit(2_000)(recording)
    for line in lines:
        fed = recording.window(None, line["time"])
        last = int(fed.t[-1])
        window = kept.window(last - 8_000 + 1, last + 1)
        assert line["events"] == len(window)
        with torch.no_grad():
            expected = network(graph(window))[0].softmax(0)
        assert line["class"] == "abc"[int(expected.argmax())]
        assert line["probability"] == pytest.approx(float(expected.max()), abs=1e-3)
        assert line["work"] > 0
        assert "behind" not in line


def test_it_keeps_up_with_the_clock_or_says_how_late_it_is(tmp_path, model, recording, run, monkeypatch):
    words = "classify_stream.py", tmp_path / "r.h5", "--model", tmp_path / "m.safetensors"
    patient = "--every", 10_000, "--speed", 0.2, "--behind", 10**9
    lines = [json.loads(line) for line in run(*words, *patient).splitlines()]
    assert [line["skipped"] for line in lines] == [0] * 4
    assert all(line["behind"] >= 0 for line in lines)
    # nothing can be in time
    assert run(*words, "--every", 1_000, "--speed", 1e9, "--behind", 1) == ""


def test_what_cannot_follow_is_told(tmp_path, model, recording, run):
    network, graph = model
    models.save(network, tmp_path / "n.safetensors", transform=T.Compose([T.NonUniformSample(8), graph]))
    with pytest.raises(SystemExit, match=r"NonUniformSample\(.*\) can't stream: this transform of the training"):
        run("classify_stream.py", tmp_path / "r.h5", "--model", tmp_path / "n.safetensors")
