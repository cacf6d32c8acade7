import json

import numpy as np
import pytest
import torch
from conftest import saccade
from safetensors.torch import save_file

import nvsdata
from nvsdata import Events, FormatError, models
from nvsdata import transforms as T

PIPELINE = T.Compose([T.Window(0, 30_000), T.NonUniformSample(8), T.RadiusGraph(3.0)])


@pytest.fixture
def trained(tmp_path):
    model = models.rgcnn("n-mnist", 3)
    path = tmp_path / "model.safetensors"
    models.save(model, path, classes=("a", "b", "c"), transform=PIPELINE, metrics={"test_accuracy": 0.5})
    return model.eval(), path


def events():
    return Events(*saccade(np.random.default_rng(1), 3, 300), (34, 34))


def test_a_network_is_used_in_two_lines(trained, tmp_path):
    model, path = trained
    recording = tmp_path / "a.h5"
    nvsdata.write(events(), recording)

    loaded = models.load(path)
    answer = loaded.predict(recording)

    torch.manual_seed(0)
    probabilities = loaded(recording)
    torch.manual_seed(0)
    expected = model(PIPELINE(events())).softmax(1)[0]
    assert torch.equal(probabilities, expected)
    assert answer in loaded.classes == ("a", "b", "c")
    assert loaded.metrics == {"test_accuracy": 0.5}
    assert loaded.transform == PIPELINE
    assert not loaded.model.training


@pytest.mark.parametrize(
    "model",
    [
        models.gcnn("n-mnist", convolution="gin"),
        models.RGCNN3D(3, channels=(8, 16), clusters=((2, 2), (4, 4)), sensor_size=(64, 64)),
        models.reference.PointNet(3),
        models.reference.ResNet3D(2, depths=(1, 1, 1, 1)),
    ],
    ids=lambda model: model.kind,
)
def test_any_network_of_the_zoo_comes_back(model, tmp_path):
    path = models.save(model, tmp_path / "m.safetensors")
    loaded = models.load(path)
    assert type(loaded.model) is type(model)
    assert loaded.model.settings == model.settings
    state = loaded.model.state_dict()
    assert all(torch.equal(value, state[name]) for name, value in model.state_dict().items())
    with pytest.raises(ValueError, match="no transform was saved"):
        loaded(events())


def test_a_bare_name_goes_to_the_model_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NVSDATA_MODELS", str(tmp_path / "zoo"))
    models.save(models.RGCNN(2), "mine")
    assert (tmp_path / "zoo" / "mine.safetensors").exists()
    assert models.load("mine").model.settings["num_classes"] == 2
    with pytest.raises(FileNotFoundError, match=r"no trained network .*other.*; there are mine"):
        models.load("other")


def test_foreign_networks_and_transforms_are_not_saved(tmp_path):
    with pytest.raises(ValueError, match="Linear can't be saved: it is no network of"):
        models.save(torch.nn.Linear(2, 2), tmp_path / "m.safetensors")
    with pytest.raises(ValueError, match="not the repr of a transform"):
        models.save(models.RGCNN(2), tmp_path / "m.safetensors", transform=lambda sample: sample)
    assert not list(tmp_path.iterdir())


def test_every_damaged_byte_is_noticed(trained):
    _, path = trained
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    places = [*range(0, 2000, 97), *rng.integers(0, len(whole), 20)]
    for at in places:
        broken = bytearray(whole)
        broken[at] ^= 0x41
        path.write_bytes(broken)
        with pytest.raises(FormatError):
            models.load(path)
    for length in (0, 4, 100, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(FormatError, match="is no network that nvsdata saved"):
            models.load(path)


def rewritten(path, **changes):
    """The file with a changed header and a checksum to match, as someone might who means harm."""
    from safetensors import safe_open

    from nvsdata.models.checkpoint import _digest

    with safe_open(path, "pt") as file:
        header = json.loads(file.metadata()["nvsdata"])
        state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    text = json.dumps(header | changes)
    save_file(state, path, {"nvsdata": text, "sha256": _digest(text, state)})


def test_a_file_of_another_network_is_refused(trained):
    _, path = trained
    rewritten(path, network="gcnn")
    with pytest.raises(FormatError, match="doesn't fit the network 'gcnn'"):
        models.load(path)
    rewritten(path, network="oracle")
    with pytest.raises(FormatError, match="a network 'oracle', which"):
        models.load(path)
    rewritten(path, version=9)
    with pytest.raises(FormatError, match="version 9"):
        models.load(path)
    save_file({"w": torch.zeros(2)}, path)
    with pytest.raises(FormatError, match="holds no network of nvsdata"):
        models.load(path)


@pytest.mark.parametrize("text", ["__import__('os').system('true')", "Compose.__init__", "open('x')", "Window(**{})"])
def test_no_code_of_a_transform_is_run(trained, text):
    _, path = trained
    rewritten(path, network="rgcnn", transform=text)
    with pytest.raises(FormatError, match=r"transform|repr"):
        models.load(path)
