"""The examples of docs/extending.md, as they stand there; what registers itself twice, or wrongly, is told."""

import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import make_dataclass, replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
import torch
import trees

import nvsdata
from nvsdata import FormatError, models
from nvsdata import transforms as T
from nvsdata.cli import main
from nvsdata.common import registry
from nvsdata.datasets import EventDataset, dataset_named, register_dataset
from nvsdata.emulation.convert import convert_videos
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.search import search
from nvsdata.emulation.tuning.space import Range
from nvsdata.formats import FORMATS, Format, register_format
from nvsdata.models import NETWORKS
from nvsdata.recording.camera import Camera
from nvsdata.recording.capture import record
from nvsdata.transforms import TRANSFORMS

pytestmark = pytest.mark.usefixtures("same_registries")
TEXT = (Path(__file__).parents[1] / "docs/extending.md").read_text(encoding="utf-8")
EXAMPLES = {
    title.strip().split()[-1]: code
    for title, code in re.findall(r"^## (.+?)\n.*?```python\n(.*?)```", TEXT, re.M | re.S)
}


@pytest.fixture
def example(tmp_path, monkeypatch):
    """Runs an example, in a folder of its own; its names."""
    monkeypatch.chdir(tmp_path)

    def example(name):
        names = {"__name__": "example"}
        exec(EXAMPLES[name], names)
        return names

    return example


def test_there_is_an_example_of_each():
    assert list(EXAMPLES) == ["dataset", "format", "transform", "network", "convolution", "camera", "emulator"]


def test_a_dataset(example, tmp_path, capsys):
    trees.put(
        tmp_path / "pens",
        {
            f"{part}/{name}/{i}.bin": trees.atis(trees.some(i))
            for part in ("train", "test")
            for name in ("Pen", "pencil")
            for i in range(2)
        },
    )
    names = example("dataset")
    assert len(names["train"]) == 4
    assert names["train"][3][1] == 1
    assert dataset_named("Pens") is names["Pens"]
    assert main(["verify", "pens", "--dataset", "pens"]) == 0
    assert main(["pack", "pens", "--dataset", "pens", "--out", "pens.h5"]) == 0
    packed = names["Pens"]("pens.h5", "test")
    assert [label for _, label in packed] == [0, 0, 1, 1]
    assert main(["datasets"]) == 0
    assert "\npens " in capsys.readouterr().out


def test_a_format(example, tmp_path):
    names = example("format")
    ev = trees.some(3)
    nvsdata.write(ev, tmp_path / "a.quads")
    assert nvsdata.read(tmp_path / "a.quads", sensor_size=(34, 34)) == ev
    # by its first bytes, whatever the extension
    (tmp_path / "a.quads").rename(tmp_path / "b.xyz")
    recording = nvsdata.open(tmp_path / "b.xyz", sensor_size=(34, 34))
    assert isinstance(recording, names["Quads"])
    a, b = int(ev.t[10]), int(ev.t[20])
    assert recording.read(a, b) == ev.window(a, b)
    assert recording.format == "quads"


def test_a_transform(example, tmp_path):
    names = example("transform")
    pipeline = T.Compose([names["OnOnly"](2), T.RadiusGraph()])
    assert repr(T.from_repr(repr(pipeline))) == repr(pipeline)
    ev = trees.some(1)
    assert len(names["OnOnly"](1)(ev)) == (ev.p == 1).sum()
    path = models.save(models.rgcnn("n-mnist"), tmp_path / "a.safetensors", transform=pipeline)
    assert repr(models.load(path).transform) == repr(pipeline)
    # elsewhere it isn't registered
    del TRANSFORMS._known["OnOnly"]
    with pytest.raises(FormatError, match=r"no transform 'OnOnly' is registered here: import .*register_transform"):
        models.load(path)


def test_a_network(example, tmp_path):
    names = example("network")
    trained = models.load(tmp_path / "mean.safetensors")
    assert isinstance(trained.model, names["MeanPooled"])
    assert trained.classes == ("a", "b")
    graphs = [torch.nn.Module() for _ in range(3)]
    for graph in graphs:
        graph.x = torch.randn(5, 1)
    assert trained.model(graphs).shape == (3, 2)

    class Wider(names["MeanPooled"]):
        def __init__(self, num_classes=2):
            super().__init__(1, num_classes)

    with pytest.raises(ValueError, match="Wider can't be saved: the network is fused or not registered"):
        models.save(Wider(3), tmp_path / "b.safetensors")
    models.register_network("wider")(Wider)
    models.save(Wider(3), tmp_path / "b.safetensors")
    assert type(models.load(tmp_path / "b.safetensors").model) is Wider
    del NETWORKS._known["wider"]
    with pytest.raises(FormatError, match=r"of a network 'wider', which isn't registered here"):
        models.load(tmp_path / "b.safetensors")


def test_a_convolution(example, tmp_path):
    names = example("convolution")
    kinds = [type(module) for module in names["trained"].model.modules()]
    assert kinds.count(names["Offsets"]) == 3
    graph = T.RadiusGraph()(trees.some(3))
    torch.testing.assert_close(names["trained"].model(graph), names["model"].eval()(graph), rtol=0, atol=0)
    with pytest.raises(FormatError, match=r"with the convolution 'Offsets' of the module 'example': import it"):
        models.load(tmp_path / "offsets.safetensors")


def test_a_camera(example, tmp_path):
    names = example("camera")
    assert isinstance(names["Ticking"](), Camera)
    events = nvsdata.read(tmp_path / "ticks.h5")
    assert len(events) == names["report"].events >= 10
    assert (np.diff(events.t) == 1_000).all()
    assert nvsdata.open(tmp_path / "ticks.h5").about["camera"] == "Ticking"
    assert names["report"].whole

    class Partly:
        facts = None

        def configure(self, settings=None): ...

    with pytest.raises(TypeError, match=r"Partly is not a camera: it misses unit, silence, start, .*decoder"):
        record(Partly(), tmp_path / "b.h5", seconds=0.1)


def test_an_emulator(example, tmp_path):
    emulator = example("emulator")["Brightest"]
    from clips import write_video

    frames = [np.zeros((12, 16, 3), np.uint8) for _ in range(6)]
    for n, frame in enumerate(frames):
        frame[3, 2 * n] = 255
    (tmp_path / "in").mkdir()
    video = write_video(tmp_path / "in/a.avi", frames)
    report = convert_videos(tmp_path / "in", tmp_path / "out", emulator(least=50))
    assert report.failed == {}
    assert len(nvsdata.read(tmp_path / "out/a.h5")) == report.events == 5
    with pytest.raises(ValueError, match="made with least 50, not 60"):
        convert_videos(tmp_path / "in", tmp_path / "out", emulator(least=60))
    pair = TuningPair(emulator(50).emulate(video), video)
    found = search(pair, base=emulator(), space={"least": Range(1, 255, whole=True)}, trials=4)
    assert isinstance(found.best.settings, emulator)
    with pytest.raises(ValueError, match="Brightest has no setting 'threshold'"):
        search(pair, base=emulator(), trials=4, space={"threshold": (1, 2)})


def test_names_that_are_taken_and_things_of_another_kind():
    class Compose:
        pass

    class NotOurs(EventDataset):
        info = nvsdata.NMNIST.info

    class Own(torch.nn.Module):
        pass

    taken = Format("hdf5", (".h6",), open=lambda *_: None)
    for register, thing, message in (
        (T.register_transform, Compose, "there is a transform 'Compose' already"),
        (register_dataset, NotOurs, "there is a dataset 'n-mnist' already"),
        (models.register_network("rgcnn"), Own, "there is a network 'rgcnn' already"),
        (register_format, taken, "there is a format 'hdf5' already"),
    ):
        with pytest.raises(ValueError, match=message):
            register(thing)
    for register in (T.register_transform, register_dataset, models.register_network("a"), register_format):
        with pytest.raises(TypeError, match="register_"):
            register(3)
    # a cell of a notebook that is run again
    for _ in range(2):
        exec("class Again: pass\nregister(Again)", {"register": T.register_transform, "__name__": "notebook"})


def test_entry_points_that_work_and_one_that_does_not(monkeypatch):
    points = [
        EntryPoint("gone", "no_such_package:Thing", "nvsdata.transforms"),
        EntryPoint("odd", "json:dumps", "nvsdata.transforms"),
        EntryPoint("Fraction", "fractions:Fraction", "nvsdata.transforms"),
    ]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [p for p in points if p.group == group])
    monkeypatch.setattr(TRANSFORMS, "_loaded", False)
    with pytest.warns(UserWarning, match="installed package") as warned:
        assert T.from_repr("Fraction(1, 2)") == 0.5
    # other packages may warn of things of their own
    messages = [text for warning in warned if "installed package" in (text := str(warning.message))]
    assert "the transform 'gone' (no_such_package:Thing) of an installed package can't be used" in messages[0]
    assert "'odd' (json:dumps)" in messages[1]
    assert repr(T.from_repr("Window(0, 5)")) == "Window(start=0, stop=5)"


def test_names_that_count_as_equal_are_taken():
    class Other(EventDataset):
        info = replace(nvsdata.NMNIST.info, name="NMnist")

    with pytest.raises(ValueError, match="there is a dataset 'n-mnist' already"):
        register_dataset(Other)


def test_a_format_may_be_registered_again_and_its_mark_counts_before_an_extension(tmp_path, monkeypatch):
    def opened(path, *_):
        return path

    for _ in range(2):
        register_format(Format("marked", (".marked",), opened, begins=lambda head: head.startswith(b"MARK")))
    del FORMATS._known["marked"]
    point = EntryPoint("marked", "nowhere:marked", "nvsdata.formats")
    found = Format("marked", (".marked",), opened, begins=lambda head: head.startswith(b"MARK"))
    monkeypatch.setattr(EntryPoint, "load", lambda self: found)
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [point])
    monkeypatch.setattr(FORMATS, "_loaded", False)
    (tmp_path / "a.bin").write_bytes(b"MARK5")
    assert nvsdata.open(tmp_path / "a.bin") == str(tmp_path / "a.bin")


def test_threads_wait_for_what_is_being_loaded(monkeypatch):
    begun, go = threading.Event(), threading.Event()

    class Slow:
        name, value = "slow", "slow:Slow"

        def load(self):
            begun.set()
            assert go.wait(10)
            return int

    fresh = registry.Registry("thing", "things")
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [Slow()])
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(lambda: fresh["slow"])
        assert begun.wait(10)
        second = pool.submit(lambda: fresh["slow"])
        time.sleep(0.05)
        assert not second.done()
        go.set()
        assert first.result() is second.result() is int


def test_networks_that_could_not_be_built_again():
    class Starred(torch.nn.Module):
        def __init__(self, *sizes):
            super().__init__()

    with pytest.raises(TypeError, match="its arguments need names"):
        models.register_network("starred")(Starred)

    @models.register_network("plain")
    class Plain(torch.nn.Module):
        pass

    assert (Plain().settings, Plain().kind) == ({}, "plain")


def test_a_transform_of_ones_own_that_bears_a_registered_name_is_not_saved(tmp_path):
    Window = make_dataclass(
        "Window", [("start", int), ("stop", int)], namespace={"__call__": lambda self, x: x}, frozen=True
    )
    with pytest.raises(ValueError, match="or another transform has its name"):
        models.save(models.rgcnn("n-mnist"), tmp_path / "a.safetensors", transform=T.Compose([Window(0, 5)]))


def test_a_camera_that_fails_in_a_way_of_its_own(example, tmp_path):
    class Failing(example("camera")["Ticking"]):
        def read(self, timeout=100):
            if (self.now or 0) > 50_000:
                raise RuntimeError("no more")
            return super().read(timeout)

    report = record(Failing(), tmp_path / "b.h5", seconds=5)
    assert not report.whole
    assert report.ended == "the camera failed (RuntimeError: no more)"
    assert len(nvsdata.read(tmp_path / "b.h5")) == report.events > 0


def test_a_test_of_first_bytes_that_raises(tmp_path):
    def broken(head):
        return head[10**6]

    register_format(Format("broken", (".broken",), open=lambda *_: None, begins=broken))
    (tmp_path / "a.bin").write_bytes(trees.atis(trees.some(1)))
    with pytest.warns(UserWarning, match="'broken' failed to check whether a file is of this format: IndexError"):
        assert nvsdata.read(tmp_path / "a.bin", sensor_size=(34, 34)) == trees.some(1)
