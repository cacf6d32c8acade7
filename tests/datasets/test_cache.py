import pytest
import torch
import trees
from test_distributions import home  # noqa: F401  the fixture
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import transforms as T
from nvsdata.datasets import NMNIST

HEAD = (T.Window(0, 80_000), T.RadiusGraph())


@pytest.fixture
def digits(home):  # noqa: F811
    return home(trees.nmnist())


def dataset(root, *steps, **options):
    return NMNIST(root, transform=T.Compose(steps) if steps else None, **options)


def same(a, b):
    return all(torch.equal(getattr(a, n), getattr(b, n)) for n in ("x", "pos", "t", "edge_index", "edge_attr"))


def test_the_head_is_made_once_and_the_tail_each_time(digits, tmp_path, monkeypatch):
    plain = dataset(digits, *HEAD)
    cached = nvsdata.cache(dataset(digits, *HEAD, T.RandomShift(5)), tmp_path / "cache")
    first, target = cached[7]
    monkeypatch.setattr(NMNIST, "recording", lambda *_: pytest.fail("read again"))
    second, _ = cached[7]
    assert not torch.equal(first.pos, second.pos)
    assert target == plain.targets[7]
    assert cached.classes == plain.classes
    whole = nvsdata.cache(plain, tmp_path / "cache")
    monkeypatch.undo()
    assert same(whole[7][0], plain[7][0])
    assert whole[7][0].sensor_size == (34, 34)


@pytest.mark.parametrize("steps", [(), (T.Window(0, 80_000),), (lambda r: torch.tensor([len(r.read())]),)])
def test_events_and_tensors_are_kept(digits, tmp_path, steps):
    if steps and not isinstance(steps[0], T.Window):
        steps[0].deterministic = True
    for _ in range(2):
        cached = nvsdata.cache(dataset(digits, *steps), tmp_path / "cache")
        assert cached[3] == dataset(digits, *steps)[3]


def test_other_settings_options_and_files_are_kept_apart(digits, tmp_path):
    def folder(*steps, **options):
        return nvsdata.cache(dataset(digits, *steps, **options), tmp_path).folder

    folders = [
        folder(*HEAD),
        folder(T.Window(0, 70_000)),
        folder(*HEAD, first_saccade=True),
        folder(*HEAD, split="test"),
    ]
    assert len(set(folders)) == 4
    assert folder(*HEAD, T.RandomFlip()) == folders[0]
    (digits / "Train/0/00001.bin").write_bytes(bytes(5))
    assert folder(*HEAD) != folders[0]


def test_a_damaged_file_is_made_anew(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    first = cached[0][0]
    next(cached.folder.rglob("0.pt")).write_bytes(b"junk")
    assert same(cached[0][0], first)
    assert same(cached[0][0], first)


def test_several_workers_share_a_cache(digits, tmp_path):
    cached = nvsdata.cache(dataset(digits, *HEAD), tmp_path / "cache")
    for _ in range(2):
        loader = DataLoader(cached, 4, num_workers=2, collate_fn=nvsdata.collate)
        counts = [int(n) for batch, _ in loader for n in batch.ptr.diff()]
        assert counts == [dataset(digits, *HEAD)[i][0].num_nodes for i in range(30)]
    assert len(list(cached.folder.rglob("*.pt"))) == 30
    assert not list(cached.folder.rglob("*.part"))


def test_a_pipeline_that_begins_at_random_has_nothing_to_keep(digits, tmp_path):
    with pytest.raises(ValueError, match=r"begins with RandomWindow"):
        nvsdata.cache(dataset(digits, T.RandomWindow()), tmp_path)


def test_what_cannot_be_kept_is_named(digits, tmp_path):
    def step(recording):
        return {1, 2}

    step.deterministic = True
    with pytest.raises(TypeError, match="not set"):
        nvsdata.cache(dataset(digits, step), tmp_path)[0]
