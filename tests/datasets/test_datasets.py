import inspect
import pickle

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST, EventFolder, Events, GraphBatch
from nvsdata import transforms as T
from nvsdata.datasets import DATASETS, SeededBatches, SeededDataset

PIPELINE = T.Compose([T.RandomWindow(30_000), T.NonUniformSample(2), T.RadiusGraph(), T.RandomScale()])


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    for split in ("train", "test"):
        for name in ("cat", "ant"):
            for i, suffix in enumerate((".h5", ".txt", ".dat")):
                path = tmp_path / "events" / split / name / f"{i}{suffix}"
                path.parent.mkdir(parents=True, exist_ok=True)
                t = np.arange(200) * 100
                nvsdata.write(Events(t, rng.integers(0, 20, 200), rng.integers(0, 16, 200), t % 2, (20, 16)), path)
    return tmp_path / "events"


def test_nmnist_finds_recordings_and_labels(fake_nmnist):
    train, test, both = (NMNIST(fake_nmnist, split) for split in ("train", "test", "all"))
    assert (len(train), len(test), len(both)) == (40, 20, 60)
    assert train.targets == sorted(train.targets)
    assert train.classes == list("0123456789")
    events, target = train[5]
    assert isinstance(events, Events)
    assert (target, events.sensor_size, len(events)) == (1, (34, 34), 600)
    assert "40 recordings, 10 classes" in repr(train)
    assert "transform" not in repr(train)
    assert "transform: ToFrames(bins=3" in repr(NMNIST(fake_nmnist, transform=T.ToFrames(3)))


def test_nmnist_below_a_folder_of_its_name(fake_nmnist):
    assert len(NMNIST(fake_nmnist.parent)) == 40


def test_nmnist_says_what_is_missing(tmp_path, fake_nmnist):
    with pytest.raises(FileNotFoundError, match="download=True"):
        NMNIST(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="split must be 'train', 'test', 'all', not 'tran'"):
        NMNIST(fake_nmnist, "tran")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="no folder Train"):
        NMNIST(tmp_path / "empty")


def test_transforms_are_applied(fake_nmnist):
    dataset = NMNIST(fake_nmnist, transform=PIPELINE, target_transform=lambda label: -label)
    graph, target = dataset[39]
    assert graph.sensor_size == (34, 34)
    assert target == -9


def test_a_corrupt_recording_names_its_file(fake_nmnist):
    (fake_nmnist / "Train" / "0" / "00001.bin").write_bytes(b"abcdefg")
    with pytest.raises(nvsdata.FormatError, match=r"00001\.bin: byte 5: truncated"):
        NMNIST(fake_nmnist)[0]
    # as it does from a worker
    loader = DataLoader(NMNIST(fake_nmnist), num_workers=1, collate_fn=nvsdata.collate)
    with pytest.raises(nvsdata.FormatError, match=r"00001\.bin: byte 5: truncated") as caught:
        next(iter(loader))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_event_folder_mixes_formats(folder):
    train = EventFolder(folder, "train", transform=T.RadiusGraph())
    assert (len(train), train.classes, train.targets) == (6, ["ant", "cat"], [0, 0, 0, 1, 1, 1])
    assert {train[i][0].num_nodes for i in range(6)} == {200}
    assert train.sensor_size == (20, 16)
    assert len(EventFolder(folder / "test")) == 6


def test_event_folder_says_what_is_missing(tmp_path, folder):
    with pytest.raises(FileNotFoundError, match="not a folder"):
        EventFolder(tmp_path / "nowhere")
    with pytest.raises(FileNotFoundError, match="no class folders"):
        EventFolder(folder / "train" / "ant")
    (tmp_path / "bare" / "ant").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match="no recordings"):
        EventFolder(tmp_path / "bare")


def test_hidden_files_are_left_out(folder):
    (folder / "train" / "ant" / ".0.h5.part").write_bytes(b"half")
    (folder / "train" / "ant" / ".hidden.h5").write_bytes(b"half")
    (folder / "train" / "ant" / "notes.md").write_text("hello")
    assert len(EventFolder(folder, "train")) == 6


def batches(dataset, workers, first=0):
    sampler = SeededBatches(len(dataset), 7, first=first, last=3, shuffle=True, seed=5)
    loader = DataLoader(
        SeededDataset(dataset, 5), batch_sampler=sampler, num_workers=workers, collate_fn=nvsdata.collate
    )
    assert len(loader) == 6 * (3 - first)
    return list(loader)


def test_batches_are_the_same_for_any_number_of_workers_and_any_resumption(fake_nmnist):
    dataset = NMNIST(fake_nmnist, transform=PIPELINE)
    alone, two, resumed = batches(dataset, 0), batches(dataset, 2), batches(dataset, 0, first=2)
    for (a, ya), (b, yb) in [*zip(alone, two, strict=True), *zip(alone[12:], resumed, strict=True)]:
        assert isinstance(a, GraphBatch)
        assert torch.equal(ya, yb)
        assert torch.equal(a.pos, b.pos)
        assert torch.equal(a.edge_index, b.edge_index)
    assert not torch.equal(alone[0][1], alone[6][1])
    assert sorted(torch.cat([y for _, y in alone[:6]]).tolist()) == dataset.targets


def test_seeding_a_sample_leaves_the_generator_alone(fake_nmnist):
    dataset = SeededDataset(NMNIST(fake_nmnist, transform=PIPELINE), 1)
    torch.manual_seed(3)
    before = torch.rand(1)
    torch.manual_seed(3)
    dataset[0, 0]
    assert torch.equal(torch.rand(1), before)


def test_every_dataset_of_the_registry_states_its_facts():
    for name, kind in DATASETS.items():
        assert kind.info.name == name
        assert kind.__doc__


@pytest.mark.parametrize("name", DATASETS)
def test_every_option_is_in_the_signature(name):
    parameters = inspect.signature(DATASETS[name]).parameters
    assert {"root", "split", "transform", "target_transform", "download", "seed", "errors"} <= set(parameters)
    assert all(parameter.kind is not parameter.VAR_KEYWORD for parameter in parameters.values())
