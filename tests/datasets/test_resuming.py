"""Loaders of torch, torchdata and Lightning that stop in the middle of an epoch and continue in another process."""

from __future__ import annotations

import copy
import itertools

import pytest
import torch
import trees
from torch.utils.data import DataLoader

import nvsdata
from nvsdata import NMNIST, SeededBatches, SeededDataset
from nvsdata import transforms as T

SAMPLES, BATCH = 30, 4
STEPS = -(-SAMPLES // BATCH)


def random_number(_):
    return torch.randint(1_000_000, ()).item()


@pytest.fixture
def dataset(home):
    """Makes equal datasets of 30 samples, each a random number and its label, as other processes would."""
    root = home(trees.nmnist())
    return lambda seed=5: NMNIST(root, transform=random_number, seed=seed)


def batches(loader, count=None):
    return [(samples.tolist(), labels.tolist()) for samples, labels in itertools.islice(loader, count)]


@pytest.mark.parametrize(("workers", "stop"), [(0, 1), (2, STEPS - 1), (0, STEPS), (2, STEPS + 3), (0, 2 * STEPS)])
def test_a_plain_loader_continues_at_any_step(dataset, workers, stop):
    def loader(first=0, start=0):
        order = SeededBatches(SAMPLES, BATCH, first=first, last=3, start=start, shuffle=True, seed=1)
        # torch's own seeds differ between runs
        return DataLoader(SeededDataset(dataset(None), 5), batch_sampler=order, num_workers=workers)

    assert batches(loader(*divmod(stop, STEPS))) == batches(loader())[stop:]


def stateful(data, workers, **options):
    # random orders of torchdata's sampler change after an epoch that was resumed
    stateful_dataloader = pytest.importorskip("torchdata.stateful_dataloader")
    return stateful_dataloader.StatefulDataLoader(data, BATCH, num_workers=workers, **options)


@pytest.mark.parametrize(("workers", "stop"), [(0, 1), (0, STEPS - 1), (2, 3)])
def test_a_stateful_loader_continues_within_an_epoch_that_is_counted(dataset, workers, stop):
    whole = stateful(dataset(), workers)
    expected = [batches(whole) for _ in range(4)]

    stopped = stateful(dataset(), workers)
    assert batches(stopped) == expected[0]
    reading = iter(stopped)
    assert batches(reading, stop) == expected[1][:stop]
    state = copy.deepcopy(stopped.state_dict())

    # twice within an epoch, and the epochs after it
    again = stateful(dataset(), workers)
    again.load_state_dict(state)
    reading = iter(again)
    assert batches(reading, 1) == expected[1][stop : stop + 1]
    state = copy.deepcopy(again.state_dict())
    last = stateful(dataset(), workers)
    last.load_state_dict(state)
    assert [batches(last) for _ in range(3)] == [expected[1][stop + 1 :], *expected[2:]]


@pytest.mark.parametrize("workers", [0, 2])
def test_a_stateful_loader_goes_back_in_the_same_process(dataset, workers):
    data = dataset()
    loader = stateful(data, workers)
    batches(loader)
    reading = iter(loader)
    batches(reading, 2)
    state = copy.deepcopy(loader.state_dict())
    rest, following = batches(reading), batches(loader)
    loader.load_state_dict(state)
    assert (batches(loader), batches(loader)) == (rest, following)


@pytest.mark.parametrize("passes", [0, 1, 2])
@pytest.mark.parametrize("workers", [0, 2])
def test_a_state_of_the_main_process_between_passes_continues_with_the_next_one(dataset, passes, workers):
    data = dataset()
    loader = DataLoader(data, BATCH, num_workers=workers)
    for _ in range(passes):
        batches(loader)
    state = copy.deepcopy(data.state_dict())
    expected = batches(loader)
    other = dataset()
    other.load_state_dict(state)
    assert batches(DataLoader(other, BATCH, num_workers=workers)) == expected
    # and back
    data.load_state_dict(state)
    assert batches(loader) == expected


@pytest.mark.parametrize("persistent", [False, True])
def test_a_stateful_loader_continues_an_epoch_that_was_set(dataset, persistent):
    def passes(loader, data, epochs, count=None):
        for epoch in epochs:
            data.set_epoch(epoch)
            yield batches(loader, count)

    data = dataset()
    expected = list(passes(stateful(data, 2, persistent_workers=persistent), data, range(3)))
    stopped = stateful(data, 2, persistent_workers=persistent)
    found = list(passes(stopped, data, [0]))
    data.set_epoch(1)
    reading = iter(stopped)
    found += [batches(reading, 3)]
    state = stopped.state_dict()
    other = dataset()
    again = stateful(other, 2, persistent_workers=persistent)
    again.load_state_dict(state)
    found[-1] += batches(again)
    found += passes(again, other, [2])
    assert found == expected


def test_a_state_is_saved_by_torch_and_belongs_to_its_dataset(dataset, tmp_path):
    data = dataset()
    before = [data[index][0] for index in (0, 1, 2)]
    torch.save(data.state_dict(), tmp_path / "state.pt")
    state = torch.load(tmp_path / "state.pt", weights_only=True)
    rest = [data[index][0] for index in (*range(3, 30), 1, 0)]

    other = dataset()
    other.load_state_dict(state)
    # 1 comes a second time, so the next epoch begins
    assert [other[index][0] for index in (*range(3, 30), 1, 0)] == rest
    assert before != rest[-2:]
    assert dataset(None).state_dict() == {}
    dataset(None).load_state_dict({})
    with pytest.raises(ValueError, match="the state has seed=5, and the dataset seed=6"):
        dataset(6).load_state_dict(state)
    with pytest.raises(ValueError, match="the state has seed=None, and the dataset seed=5"):
        dataset().load_state_dict({})
    with pytest.raises(ValueError, match="the state is of 30 samples, not of 10"):
        dataset()[:10].load_state_dict(state)


def test_a_cache_has_the_state_of_its_dataset(dataset, tmp_path):
    data = dataset()
    data.transform = T.Compose([T.Window(0, 10), random_number])
    cached = nvsdata.cache(data, tmp_path / "cache")
    cached.set_epoch(7)
    data = dataset()
    data.transform = cached.dataset.transform
    other = nvsdata.cache(data, tmp_path / "cache")
    other.load_state_dict(cached.state_dict())
    assert other.dataset.state_dict()["epoch"] == 7


def lightning_run(data, folder, workers, checkpoint=None, **until):
    """The batches that a run of Lightning saw, and its weights at the end."""
    lightning = pytest.importorskip("pytorch_lightning")
    stateful_dataloader = pytest.importorskip("torchdata.stateful_dataloader")
    seen = []

    class Mean(lightning.LightningModule):
        def __init__(self):
            super().__init__()
            self.layer = torch.nn.Linear(1, 1)

        def train_dataloader(self):
            order = SeededBatches(SAMPLES, BATCH, shuffle=True, seed=1)
            # of a resumed run, because Lightning begins to read before it calls `set_epoch`
            order.set_epoch(self.trainer.fit_loop.epoch_progress.current.processed)
            data_of_keys = SeededDataset(data, 5)
            return stateful_dataloader.StatefulDataLoader(data_of_keys, batch_sampler=order, num_workers=workers)

        def training_step(self, batch, _):
            seen.append(batch[0].tolist())
            return self.layer(batch[0][:, None] / 1e6).square().mean()

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), 0.1)

    # at the last step of an epoch, a checkpoint of this kind leaves out the next epoch with any dataset
    often = {"every_n_train_steps": 1} if until.get("max_steps", 0) % STEPS else {"every_n_epochs": 1}
    keep = lightning.callbacks.ModelCheckpoint(folder, save_top_k=-1, filename="{step}", **often)
    torch.manual_seed(0)
    quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
    trainer = lightning.Trainer(accelerator="cpu", callbacks=[keep], default_root_dir=folder, **quiet, **until)
    model = Mean()
    trainer.fit(model, ckpt_path=checkpoint)
    return seen, [parameter.tolist() for parameter in model.parameters()]


@pytest.mark.parametrize(("workers", "stops"), [(0, (STEPS,)), (2, (STEPS + 2, STEPS + 5)), (0, (2 * STEPS - 1,))])
def test_lightning_continues_at_any_step(dataset, tmp_path, workers, stops):
    expected = lightning_run(dataset(None), tmp_path / "whole", workers, max_epochs=3)
    seen, checkpoint = [], None
    for stop in stops:
        seen += lightning_run(dataset(None), tmp_path / "stopped", workers, checkpoint, max_steps=stop)[0]
        checkpoint = tmp_path / f"stopped/step={stop}.ckpt"
    rest, weights = lightning_run(dataset(None), tmp_path / "resumed", workers, checkpoint, max_epochs=3)
    assert (seen + rest, weights) == expected


def read_by_ranks(data, count, workers, first=0, start=0, last=2):
    """The samples of each step of a run by some processes, each with its own loader."""
    how = {"first": first, "start": start, "last": last, "shuffle": True, "seed": 2}
    orders = [SeededBatches(len(data), 24, part=(rank, count), **how) for rank in range(count)]
    loaders = [DataLoader(SeededDataset(data, 5), batch_sampler=order, num_workers=workers) for order in orders]
    return [[sample for part in step for sample in part.tolist()] for step in zip(*loaders, strict=True)]


class Numbered(torch.utils.data.Dataset):
    """Samples of an index and a random number."""

    def __len__(self):
        return 150

    def __getitem__(self, index):
        return torch.tensor([index, torch.randint(1_000_000, ()).item()])


def stopped_runs(workers, trials):
    """Stop a run of 8 processes at random steps, and continue with 8, 6 and 12: whole steps and joined ones."""
    data = Numbered()
    whole = read_by_ranks(data, 1, 0)
    steps = len(whole) // 2
    for trial in range(trials):
        stop = int(torch.randint(2 * steps + 1, (), generator=torch.Generator().manual_seed(trial)))
        count = (8, 6, 12)[trial % 3]
        begun = read_by_ranks(data, 8, workers)[:stop]
        rest = read_by_ranks(data, count, workers, *divmod(stop, steps))
        yield whole, begun + rest


def check_stopped_runs(runs):
    for whole, joined in runs:
        assert len(joined) == len(whole)
        # the last batch of an epoch is filled from its beginning, so that all processes have as many samples
        assert [found[: len(step)] for found, step in zip(joined, whole, strict=True)] == whole
        for epoch in (joined[: len(joined) // 2], joined[len(joined) // 2 :]):
            indices = [
                index for step, of_whole in zip(epoch, whole, strict=False) for index, _ in step[: len(of_whole)]
            ]
            assert sorted(indices) == list(range(150))


def test_eight_processes_stop_and_others_continue():
    check_stopped_runs(stopped_runs(0, 100))


@pytest.mark.long
def test_eight_processes_with_eight_workers_each_stop_and_others_continue():
    check_stopped_runs(stopped_runs(8, 6))


def test_batches_have_a_state_from_the_beginning():
    whole = list(SeededBatches(30, 4, last=3, shuffle=True))
    order = SeededBatches(30, 4, last=3, shuffle=True)
    for done, batch in enumerate(order, 1):
        assert order.state_dict() == {"epoch": (done - 1) // STEPS, "step": (done - 1) % STEPS + 1}
        assert batch == whole[done - 1]
        other = SeededBatches(30, 4, last=3, shuffle=True)
        other.load_state_dict(order.state_dict())
        assert other.state_dict() == order.state_dict()
        assert len(other) == len(whole) - done
        assert list(other) == whole[done:]
        # once: the next iteration is the whole one
        assert len(other) == len(list(other)) == len(whole)


def test_the_state_of_batches_is_that_of_the_latest_iteration():
    order = SeededBatches(30, 4)
    older = iter(order)
    next(older)
    newer = iter(order)
    next(older)
    assert order.state_dict() == {"epoch": 0, "step": 0}
    next(newer)
    assert order.state_dict() == {"epoch": 0, "step": 1}


def test_an_epoch_that_is_set_takes_the_place_of_a_state():
    order = SeededBatches(30, 4, shuffle=True)
    order.load_state_dict({"epoch": 3, "step": 2})
    order.set_epoch(5)
    assert list(order) == list(SeededBatches(30, 4, first=5, last=6, shuffle=True))
    # a longer run than the one that was stopped
    longer = SeededBatches(30, 4, last=4)
    longer.load_state_dict({"epoch": 1, "step": 7})
    assert len(list(longer)) == 2 * STEPS + 1
    with pytest.raises(ValueError, match="the state is of step 9, and an epoch has 8: of another batch size"):
        order.load_state_dict({"epoch": 0, "step": 9})
