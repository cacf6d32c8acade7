import functools
import json

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lookalikes import saccade
from safetensors import safe_open
from safetensors.torch import save_file

import nvsdata
from nvsdata import Events, FormatError, models
from nvsdata import transforms as T
from nvsdata.models.checkpoint import _digest, _same_kinds
from nvsdata.transforms.rng import deterministic_rng

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

    voters = []
    for number in range(5):
        with deterministic_rng(number, 5):
            voters.append(model(PIPELINE(events())).log_softmax(1))
    expected = torch.cat(voters).mean(0).softmax(0)
    torch.testing.assert_close(loaded.predict_proba(recording), expected)
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
        loaded.predict(events())


def test_a_bare_name_goes_to_the_model_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NVSDATA_MODELS", str(tmp_path / "zoo"))
    models.save(models.RGCNN(2), "mine")
    assert (tmp_path / "zoo" / "mine.safetensors").exists()
    assert models.load("mine").model.settings["num_classes"] == 2
    with pytest.raises(FileNotFoundError, match=r"no trained network .*other.*; there are mine"):
        models.load("other")


def test_foreign_networks_and_transforms_are_not_saved(tmp_path):
    with pytest.raises(ValueError, match="Linear can't be saved: the network is fused or not registered"):
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
        with pytest.raises(FormatError, match="is not a network that nvsdata saved"):
            models.load(path)


def test_a_header_without_anything_about_it_is_named(tmp_path):
    for about in (b"null", b"{}", b'{"other": "x"}'):
        head = b'{"__metadata__": %s}' % about
        (tmp_path / "a.safetensors").write_bytes(len(head).to_bytes(8, "little") + head)
        with pytest.raises(FormatError):
            models.load(tmp_path / "a.safetensors")


def opened(path):
    with safe_open(path, "pt") as file:
        return json.loads(file.metadata()["nvsdata"]), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118


def put(path, text, state):
    """A file of that header, with a checksum to match, as someone might make who means harm."""
    save_file(state, path, {"nvsdata": text, "sha256": _digest(text, state)})


def rewritten(path, **changes):
    header, state = opened(path)
    put(path, json.dumps(header | changes), state)


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
    with pytest.raises(FormatError, match="doesn't contain a network of nvsdata"):
        models.load(path)


NUMBERS = (0, -1, 1, 10**9, 10**30, 10**400, 0.5, -0.0, 1e308, float("inf"), float("nan"))
DEEP = "[" * 100_000 + "]" * 100_000
CALLS = "Compose([" * 3000 + "RadiusGraph()" + "])" * 3000
TEXTS = (
    "",
    "x",
    "\0",
    "\ud800",
    "5",
    "[1, 2]",
    "Compose",
    "Compose(5)",
    "RandomWindow(within=())",
)
MORE = (
    "RandomWindows(10**400)",
    "RandomWindow(duration=1e400)",
    "RandomWindows('8')",
    "RadiusGraph(nan)",
    "RadiusGraph(radius={[]})",
    "-" * 9999 + "1",
    CALLS,
)
SCALARS = st.one_of(st.none(), st.booleans(), st.sampled_from(NUMBERS), st.sampled_from(TEXTS + MORE))
ODD = st.recursive(SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(st.sampled_from("ab"), v, max_size=2))


@st.composite
def damaged(draw, value):
    """The same JSON with something of another kind somewhere in it, or missing."""
    if not isinstance(value, dict | list) or not value or draw(st.integers(0, 3)) == 0:
        return draw(ODD)
    changed = value.copy()
    at = draw(st.sampled_from(list(value))) if isinstance(value, dict) else draw(st.integers(0, len(value) - 1))
    if draw(st.integers(0, 9)) == 0:
        del changed[at]
    else:
        changed[at] = draw(damaged(value[at]))
    return changed


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("tiny") / "tiny.safetensors"
    model = models.RGCNN(2, channels=(2, 2), clusters=((4, 4), (17, 17)), hidden=2, kernel_size=2)
    models.save(model, path, classes=("a", "b"), transform=PIPELINE, metrics={"loss": 0.5}, data={"dataset": "folder"})
    return path, *opened(path)


@given(st.data())
def test_odd_headers_are_told_in_a_line(tiny, data):
    path, header, state = tiny
    try:
        text = json.dumps(data.draw(damaged(header)))
        put(path, text, state)
    except (UnicodeEncodeError, ValueError):
        return
    result = ""
    try:
        trained = models.load(path)
    except FormatError as error:
        result = str(error)
    else:
        trained.model(T.RadiusGraph()(events()))
        assert all(isinstance(name, str) for name in trained.classes)
    assert "\n" not in result
    assert len(result) < 700


def test_headers_without_bottom_or_end(tiny):
    path, header, state = tiny
    for text in (DEEP, '{"version": ' + "9" * 5000 + "}", '{"a":' * 50_000, "[]", "3", '"x"', "null", "", "{}", "nope"):
        put(path, text, state)
        with pytest.raises(FormatError):
            models.load(path)
    for name in header:
        put(path, json.dumps({key: value for key, value in header.items() if key != name}), state)
        with pytest.raises(FormatError, match=name):
            models.load(path)
    settings = header["settings"]
    for kind, odd in (
        ("rgcnn", settings | {"kernel_size": 10**9}),
        ("rgcnn", settings | {"hidden": 10**12}),
        ("rgcnn", settings | {"channels": [10**18, 2]}),
        ("lstm", {"num_classes": 2, "layers": 10**9}),
        ("resnet3d", {"num_classes": 2, "depths": [10**9] * 4}),
    ):
        put(path, json.dumps(header | {"network": kind, "settings": odd}), state)
        with pytest.raises(FormatError, match="doesn't fit the network"):
            models.load(path)
    put(path, json.dumps(header), state | {"odd": torch.zeros(2)})
    with pytest.raises(FormatError, match="1 weights are missing or of another size, first 'odd'"):
        models.load(path)
    put(path, json.dumps(header), {name: value.bool() for name, value in state.items()})
    with pytest.raises(FormatError, match="of another size"):
        models.load(path)


@pytest.mark.parametrize("text", ["__import__('os').system('true')", "Compose.__init__", "open('x')", "Window(**{})"])
def test_no_code_of_a_transform_is_run(trained, text):
    _, path = trained
    rewritten(path, network="rgcnn", transform=text)
    with pytest.raises(FormatError, match=r"transform|repr"):
        models.load(path)


class Own(models.conv.GINConv):
    pass


def own(in_channels, out_channels):
    return Own(in_channels, out_channels)


@pytest.mark.parametrize("convolution", [Own, own])
def test_a_convolution_of_ones_own_is_asked_for_by_name(convolution, tmp_path):
    model = models.RGCNN(3, convolution=convolution).eval()
    path = models.save(model, tmp_path / "own.safetensors", transform=PIPELINE)
    name = convolution.__qualname__
    with pytest.raises(FormatError, match=rf"convolution '{name}' of the module '{__name__}'.*convolution={name}\)"):
        models.load(path)
    with pytest.raises(FormatError, match=r"saved with the convolution .*, not with .*GCNConv"):
        models.load(path, convolution=models.conv.GCNConv)
    loaded = models.load(path, convolution=convolution)
    assert loaded.model.settings == model.settings
    graph = PIPELINE(events())
    torch.testing.assert_close(loaded.model(graph), model(graph), rtol=0, atol=0)


def test_convolutions_that_cannot_be_asked_for_by_name(trained, tmp_path):
    for nameless in (lambda a, b: Own(a, b), functools.partial(Own)):
        with pytest.raises(ValueError, match="can't be saved: make it a class, or a function"):
            models.save(models.GCNN(3, convolution=nameless), tmp_path / "a.safetensors")
    with pytest.raises(ValueError, match="has no convolution of your own"):
        models.load(trained[1], convolution=Own)


def test_a_name_with_a_folder_or_suffix_is_a_path(tmp_path, monkeypatch):
    monkeypatch.setenv("NVSDATA_MODELS", str(tmp_path / "zoo"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    model = models.RGCNN(2, channels=(2, 2), clusters=((4, 4), (17, 17)), hidden=2)
    for name, place in (
        ("mine", "zoo/mine.safetensors"),
        ("sub/mine", "sub/mine"),
        ("mine.bin", "mine.bin"),
        ("~/mine", "home/mine"),
    ):
        assert models.save(model, name).resolve() == tmp_path / place
        assert (tmp_path / place).is_file()
        assert models.load(name).model.settings == model.settings
    with pytest.raises(FileNotFoundError, match=r"no trained network nowhere/other$"):
        models.load("nowhere/other")


def test_transforms_are_alike_if_they_and_what_is_in_them_are():
    pair = [T.RandomFlip(), T.RadiusGraph()]
    assert _same_kinds(T.Compose(pair), T.Compose([T.RandomFlip(), T.RadiusGraph(max_degree=3)]))
    for other in (pair[:1], pair[::-1], [], pair[0], None, 5, (1, 2, 3)):
        assert not _same_kinds(pair, other)
        assert not _same_kinds(other, pair)
    assert not _same_kinds(T.Compose(pair), T.Compose(pair[:1]))
    assert _same_kinds(5, 7)
