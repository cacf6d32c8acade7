"""Damaged recordings among many, and the random numbers of samples, for any number of workers."""

import errno
import pickle
import warnings
from multiprocessing.reduction import ForkingPickler

import pytest
import torch
import trees
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import ASLANDVS, NMNIST, EventFolder, FormatError
from nvsdata import transforms as T
from nvsdata.datasets import SeededBatches, SeededDataset, damage

PIPELINE = T.Compose([T.RandomWindow(30_000), T.NonUniformSample(2), T.RadiusGraph(), T.RandomScale()])
TORN, LOST = "Train/0/00002.bin", "Train/2/00003.bin"


@pytest.fixture
def digits(home):
    """Look-alikes of N-MNIST; one recording is torn, another one, the last of its class, is no file at all."""
    root = home(trees.nmnist())
    (root / TORN).write_bytes((root / TORN).read_bytes() + b"abc")
    (root / LOST).unlink()
    (root / LOST).mkdir()
    (root / LOST).rmdir()
    (root / LOST).symlink_to(root / "nowhere")
    return root


def quietly(make):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return make()


def test_raise_is_the_default(digits):
    dataset = NMNIST(digits)
    with pytest.raises(FormatError, match="truncated: 3 bytes"):
        dataset[1]
    with pytest.raises(FileNotFoundError):
        dataset[8]
    assert dataset.damaged() == {}
    with pytest.raises(ValueError, match="errors must be 'raise', 'skip', 'repair', not 'ignore'"):
        NMNIST(digits, errors="ignore")


def test_skip_puts_the_next_one_in_place(digits):
    dataset, plain = NMNIST(digits, errors="skip"), NMNIST(digits)
    with pytest.warns(UserWarning, match=r"00002\.bin.*truncated.*the next recording that can be read takes its place"):
        assert dataset[1] == plain[2]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # told once
        assert dataset[1] == plain[2]
    # with its target, which may be another
    assert quietly(lambda: dataset[8]) == plain[9]
    assert plain[9][1] == 3
    assert len(dataset) == 30
    assert list(dataset.damaged()) == [TORN, LOST]
    assert dataset.damaged()[TORN].startswith("replaced: ")
    assert "truncated: 3 bytes" in dataset.damaged()[TORN]
    assert "No such file" in dataset.damaged()[LOST]
    assert "damaged: 2" in repr(dataset)


def test_repair_reads_the_rest(digits):
    dataset = NMNIST(digits, errors="repair")
    with pytest.warns(UserWarning, match="3 bytes of a torn record, cut off"):
        sample, target = dataset[1]
    assert (sample, target) == (nvsdata.open(digits / TORN, sensor_size=(34, 34), strict=False).read(), 0)
    assert quietly(lambda: dataset[8]) == dataset[9]
    assert dataset.damaged()[TORN] == "repaired: 3 bytes of a torn record, cut off"
    assert dataset.damaged()[LOST].startswith("replaced: ")


def test_after_the_last_comes_the_first(digits):
    dataset = NMNIST(digits, errors="skip")
    (digits / dataset.samples[29].name).write_bytes(b"abc")
    assert quietly(lambda: dataset[29]) == dataset[0]


def test_many_in_a_row_are_no_damaged_file(digits, monkeypatch):
    for path in (digits / "Train").rglob("*.bin"):
        path.unlink()
        path.write_bytes(b"abc")
    dataset = NMNIST(digits, errors="skip")
    with pytest.raises(FormatError, match=r"0/00001\.bin"):
        quietly(lambda: dataset[0])
    monkeypatch.setattr(damage, "MAX_UNREADABLE", 3)
    (digits / "Train/9/00003.bin").write_bytes(trees.atis(trees.some(1)))
    assert len(quietly(lambda: dataset[27])[0]) == 60
    (digits / "Train/9/00003.bin").write_bytes(b"abc")
    with pytest.raises(FormatError, match=r"9/00001\.bin"):
        quietly(lambda: dataset[27])


@pytest.mark.parametrize(("count", "found"), [(99, 99), (100, None), (150, None)])
def test_a_hundred_in_a_row_are_too_many(count, found):
    def make(index):
        if index < count:
            raise FormatError("x.bin", f"is {index}")
        return index

    if found is None:
        with pytest.raises(FormatError, match="is 0"):
            quietly(lambda: damage.Damage(200).first_readable(0, make))
    else:
        result = damage.Damage(200)
        assert quietly(lambda: result.first_readable(0, make)) == found
        assert result.found() == dict.fromkeys(range(count), damage.REPLACED)
    # of a few, each is tried once
    tried = []
    with pytest.raises(FormatError, match="is 2"):
        quietly(lambda: damage.Damage(3).first_readable(2, lambda index: tried.append(index) or make(index)))
    assert tried == [2, 0, 1]


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.ENOMEM])
def test_a_machine_that_has_run_out_is_no_damage(number):
    def make(index):
        raise OSError(number, "none left")

    result = damage.Damage(3)
    with pytest.raises(OSError, match="none left"):
        result.first_readable(0, make)
    assert result.found() == {}


def test_nothing_is_counted_where_damage_raises(digits):
    dataset = NMNIST(digits)
    assert (dataset.num_damaged, dataset.damaged()) == (0, {})
    assert "damaged" not in repr(dataset)
    careful = NMNIST(digits, errors="skip")
    assert "damaged" not in repr(careful)
    for i in (1, 8, 1):
        quietly(lambda i=i: careful[i])
    assert careful.num_damaged == 2


def test_what_can_be_read_again_is_told(digits):
    dataset = NMNIST(digits, errors="skip")
    quietly(lambda: dataset[1])
    (digits / TORN).write_bytes(trees.atis(trees.some(1)))
    assert dataset.damaged() == {TORN: "replaced, but it can be read now"}


def test_a_fault_of_a_transform_is_no_damage(digits):
    def fails(recording):
        raise ValueError("my own")

    with pytest.raises(ValueError, match="my own"):
        NMNIST(digits, errors="skip", transform=fails)[0]


def test_a_pair_with_a_damaged_recording_is_replaced(home):
    root = home(trees.aslandvs(True))
    (root / "ASLAN/v_2.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM")
    dataset, plain = ASLANDVS(root, "all", errors="skip"), ASLANDVS(root, "all")
    broken = [i for i, pair in enumerate(plain.samples) if "ASLAN/v_2.mat" in pair[:2]]
    sound = next(i for i in range(broken[0], len(plain)) if i not in broken)
    assert quietly(lambda: dataset[broken[0]]) == plain[sound]
    assert all("v_2.mat" in name for name in dataset.damaged())


def test_a_folder_that_begins_with_a_damaged_recording(tmp_path):
    trees.put(tmp_path, {"a/0.h5": b"junk", "a/1.bin": trees.atis(trees.some(1))})
    with pytest.raises(FormatError):
        EventFolder(tmp_path).sensor_size  # noqa: B018
    dataset = EventFolder(tmp_path, errors="skip")
    assert quietly(lambda: dataset.sensor_size) == dataset[1][0].sensor_size
    assert list(dataset.damaged()) == ["a/0.h5"]


def epoch(dataset, workers):
    loader = DataLoader(dataset, 4, num_workers=workers, collate_fn=nvsdata.collate)
    return quietly(lambda: [(batch.pos, batch.edge_index, targets) for batch, targets in loader])


def alike(one, other):
    return all(torch.equal(a, b) for x, y in zip(one, other, strict=True) for a, b in zip(x, y, strict=True))


@pytest.mark.parametrize("errors", ["skip", "repair"])
def test_batches_are_the_same_for_any_number_of_workers(digits, errors):
    def dataset():
        return NMNIST(digits, transform=PIPELINE, errors=errors, seed=7)

    alone = dataset()
    epochs = [epoch(alone, 0), epoch(alone, 0)]
    assert not alike(*epochs)
    assert [len(targets) for *_, targets in epochs[0]] == [4] * 7 + [2]
    for workers in (1, 2):
        other = dataset()
        for expected in epochs:
            assert alike(epoch(other, workers), expected)
        # this process knows what its workers met
        assert other.damaged() == alone.damaged()
        assert set(other.damaged()) == {TORN, LOST}


def test_what_is_sent_to_a_spawned_worker_counts_too(digits):
    """It gets the dataset by this pickler, which sends shared memory by its handle."""
    one, other = (NMNIST(digits, transform=PIPELINE, errors="skip", seed=7) for _ in range(2))
    sent = pickle.loads(ForkingPickler.dumps(other))
    assert alike(epoch(one, 0), epoch(sent, 0))
    assert other.damaged() == one.damaged() != {}
    assert alike(epoch(one, 0), epoch(other, 0))


def test_without_a_seed_torch_draws_on(fake_nmnist):
    dataset = NMNIST(fake_nmnist, transform=PIPELINE)
    assert not torch.equal(dataset[0][0].pos, dataset[0][0].pos)
    torch.manual_seed(3)
    before = torch.rand(1)
    torch.manual_seed(3)
    seeded = NMNIST(fake_nmnist, transform=PIPELINE, seed=1)
    seeded[0]
    assert torch.equal(torch.rand(1), before)


def test_seeds_and_samples_draw_differently(fake_nmnist):
    drawn = {seed: epoch(NMNIST(fake_nmnist, transform=PIPELINE, seed=seed), 0) for seed in (0, 1)}
    assert not alike(drawn[0], drawn[1])
    assert alike(drawn[0], epoch(NMNIST(fake_nmnist, transform=PIPELINE, seed=0), 0))
    # whatever the order
    backward = NMNIST(fake_nmnist, transform=PIPELINE, seed=0)
    positions = [backward[i][0].pos for i in reversed(range(40))][::-1]
    assert torch.equal(torch.cat(positions), torch.cat([pos for pos, *_ in drawn[0]]))


def test_the_outer_seed_holds(fake_nmnist):
    def batches(seed):
        dataset = NMNIST(fake_nmnist, transform=PIPELINE, seed=seed)
        seeded = SeededDataset(dataset, 5)
        sampler = SeededBatches(len(dataset), 8, first=1, last=2)
        return [(b.pos, t) for b, t in DataLoader(seeded, batch_sampler=sampler, collate_fn=nvsdata.collate)]

    assert alike(batches(None), batches(3))


def test_a_slice_is_a_dataset(fake_nmnist):
    dataset = NMNIST(fake_nmnist, transform=PIPELINE, seed=0, errors="skip")
    part = dataset[4:12:2]
    assert isinstance(part, NMNIST)
    assert (len(part), part.targets) == (4, [1, 1, 2, 2])
    assert part.samples == dataset.samples[4:12:2]
    assert part.names == dataset.names[4:12:2]
    assert dataset[-1][1] == dataset[39][1] == 9
    assert dataset.subset([3, 1]).samples == [dataset.samples[3], dataset.samples[1]]
    with pytest.raises(IndexError):
        dataset[40]
    assert len(list(part)) == 4
