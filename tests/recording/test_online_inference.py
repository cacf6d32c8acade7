"""A network that decides what a camera sees, beside a recording."""

import json
from threading import Event

import numpy as np
import pytest
import torch

import nvsdata
from nvsdata import Events, models
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.recording.camera import host_time
from nvsdata.recording.capture import RecordingReport
from nvsdata.recording.online_inference import OnlineInference

CLASSES = ("left", "right")


def saved(path, size=(240, 180), transform=None):
    torch.manual_seed(0)
    network = models.RGCNN(2, channels=(4, 4), clusters=((8, 8), (60, 45)), hidden=5, sensor_size=size).eval()
    transform = transform or T.Compose([T.RandomWindow(10_000), T.RadiusGraph(max_degree=4)])
    models.save(network, path, classes=CLASSES, transform=transform)
    return network


@pytest.fixture
def decider(tmp_path):
    saved(tmp_path / "m.safetensors")
    return models.OnlineClassifier(models.load(tmp_path / "m.safetensors"))


def block(first, count):
    t = np.arange(first, first + count)
    zero = np.zeros(count, int)
    return Events(t, t % 240, zero, zero, (240, 180))


def test_each_line_is_the_decision_of_its_window(decider):
    lines, report = [], RecordingReport(None, zero=host_time())
    with OnlineInference(decider, lines.append) as deciding:
        deciding.add(report, Events.empty((240, 180)))
        deciding.add(report, block(5_000, 100))
    assert deciding.error is None
    (line,) = lines
    assert (line["time"], line["events"], line["skipped"], line["missed"]) == (5_099, 100, 0, 0)
    assert line["behind"] >= 0
    graph = T.RadiusGraph(max_degree=4)
    with torch.no_grad():
        expected = decider.stream._network.model(graph(block(5_000, 100)))[0].softmax(0)
    assert line["class"] == CLASSES[int(expected.argmax())]
    assert line["probability"] == pytest.approx(float(expected.max()), abs=1e-4)


def test_what_is_late_is_skipped_and_told(decider):
    lines, report = [], RecordingReport(None, zero=host_time() - 2e6)
    going_on = Event()

    def slow(line):
        lines.append(line)
        going_on.wait(10)

    with OnlineInference(decider, slow) as deciding:
        deciding.add(report, block(0, 50))
        while not lines:
            pass
        # windows are 10 ms: of what waits meanwhile, the first two blocks are over when the last one comes
        for first in (10_000, 11_000, 30_000, 31_000):
            deciding.add(report, block(first, 50))
        going_on.set()
    assert [line["time"] for line in lines] == [49, 31_049]
    assert [line["missed"] for line in lines] == [0, 100]
    assert [line["skipped"] for line in lines] == [0, 1]
    assert lines[1]["events"] == 100
    # the camera's clock began two seconds ago, by the host's
    assert lines[1]["behind"] > 1.9e6


def test_a_network_that_fails_is_told_and_the_recording_goes_on(decider):
    deciding, report = OnlineInference(decider, lambda line: None), RecordingReport(None)
    with deciding:
        deciding.add(report, block(1_000, 10))
        deciding.add(report, block(0, 10))
        deciding.join(10)
        deciding.add(report, block(2_000, 10))
    assert "go back in time" in str(deciding.error)


def test_record_with_a_model(tmp_path, capsys):
    model, out = tmp_path / "m.safetensors", tmp_path / "a.h5"
    saved(model)
    words = ["record", "--out", str(out), "--seconds", "0.4", "--simulate", "--model", str(model)]
    assert main(words) == 0
    said, output = capsys.readouterr()
    lines = [json.loads(line) for line in said.splitlines()]
    assert len(lines) > 1
    assert [line["time"] for line in lines] == sorted(line["time"] for line in lines)
    assert {line["class"] for line in lines} <= set(CLASSES)
    assert "events in 0.40 s; the time was up" in output
    events = nvsdata.read(out)
    # the last block is decided, too
    assert lines[-1]["time"] == events.t[-1]
    assert lines[-1]["events"] == len(events.window(lines[-1]["time"] - 9_999, None))


def test_decisions_need_no_file(tmp_path, capsys):
    saved(tmp_path / "m.safetensors")
    assert main(["record", "--seconds", "0.2", "--simulate", "--model", str(tmp_path / "m.safetensors")]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["class"] in CLASSES


@pytest.mark.parametrize(
    ("size", "transform", "message"),
    [
        ((34, 34), None, "the camera has 240x180 pixels, but the network is for 34x34"),
        ((240, 180), T.Compose([T.NonUniformSample(8), T.RadiusGraph()]), "NonUniformSample(k=8"),
    ],
)
def test_what_cannot_decide_is_told_before_anything_is_recorded(tmp_path, capsys, size, transform, message):
    saved(tmp_path / "m.safetensors", size, transform)
    out = tmp_path / "a.h5"
    words = ["record", "--out", str(out), "--simulate", "--seconds", "0.2", "--model", str(tmp_path / "m.safetensors")]
    assert main(words) == 1
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_what_fails_is_told_when_it_does_and_ends_what_nothing_else_needs(tmp_path, capsys, monkeypatch):
    network = saved(tmp_path / "m.safetensors")
    for part in network.parameters():
        torch.nn.init.constant_(part, float("nan"))
    transform = T.Compose([T.RandomWindow(10_000), T.RadiusGraph(max_degree=4)])
    models.save(network, tmp_path / "n.safetensors", transform=transform)
    with pytest.raises(ValueError, match="scores are NaN"):
        models.OnlineClassifier(models.load(tmp_path / "n.safetensors")).prepare()

    class Failing(models.OnlineClassifier):
        def decide(self, now):
            raise BrokenPipeError(32, "Broken pipe")

        def prepare(self):
            pass

    monkeypatch.setattr(models, "OnlineClassifier", Failing)
    words = ["record", "--simulate", "--model", str(tmp_path / "m.safetensors")]
    # without an end of its own
    assert main(words) == 1
    assert main([*words, "--out", str(tmp_path / "a.h5"), "--seconds", "0.3"]) == 1
    output = capsys.readouterr().err
    assert output.count("decisions ended early: Broken pipe") == 2
    assert len(nvsdata.read(tmp_path / "a.h5"))


@pytest.mark.parametrize(
    ("transform", "message"),
    [(None, "without its transform"), (T.RadiusGraph(max_degree=4), "trained on whole recordings, but a camera")],
)
def test_networks_that_say_too_little(tmp_path, capsys, transform, message):
    network = saved(tmp_path / "m.safetensors")
    models.save(network, tmp_path / "n.safetensors", transform=transform)
    assert main(["record", "--simulate", "--model", str(tmp_path / "n.safetensors")]) == 1
    assert message in capsys.readouterr().err


def test_the_window_is_that_of_the_training_unless_one_is_given(tmp_path):
    saved(tmp_path / "m.safetensors")
    trained = models.load(tmp_path / "m.safetensors")
    assert models.OnlineClassifier(trained).stream.window == 10_000
    assert models.OnlineClassifier(trained, 500).stream.window == 500
    with pytest.raises(ValueError, match="window"):
        models.OnlineClassifier(trained, 0)


def test_one_model_per_recording(tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["record", "--monitor", str(tmp_path), "--out", "x", "--model", "m.safetensors"])
    assert "--model is for one recording" in capsys.readouterr().err
