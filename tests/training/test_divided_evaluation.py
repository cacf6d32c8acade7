"""Two and three processes evaluate as one does, to the last digit. Run as a script, this is one of the processes."""

import sys
from pathlib import Path

import pytest
import torch
from processes_of_others import by_torchrun
from torch import nn
from torch.utils.data import Dataset

import nvsdata
from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.training import Trainer, loader, predict, predict_batches, team, votes
from nvsdata.training.processes import ProcessFailed

WIDTH, BATCH, EPOCHS = 20, 4, 3
SIZES = (1, 5, 12)  # 1, 2 and 3 batches an epoch


# processes don't have pytest's path
SCRIPT = """
import runpy, sys
sys.path.insert(0, {tests!r})
runpy.run_path({file!r}, run_name="__main__")
"""


class Random(Dataset):
    """Random inputs, of which the number is the target; that of `torn` can't be read."""

    def __init__(self, size, torn=-1):
        self.size, self.torn = size, torn

    def __len__(self):
        return self.size

    def __getitem__(self, index):
        if index == self.torn:
            raise nvsdata.FormatError(f"{index}.bin", "torn")
        return torch.rand(WIDTH), index


class Mixed(nn.Module):
    """A layer whose outputs depend on the entire batch, as rounding may do."""

    def forward(self, x):
        return x + 1e-6 * x.mean(0)


def network():
    """A network with statistics that processes don't share in training."""
    torch.manual_seed(0)
    norm = nn.BatchNorm1d(WIDTH)
    return nn.Sequential(nn.Linear(WIDTH, WIDTH), norm, nn.Dropout(), nn.Linear(WIDTH, 2 * WIDTH), Mixed())


def evaluated(root, here):
    """Outputs of each size, and votes on recordings of which one is damaged, as each process computes them."""
    found, model = {}, network()
    for size in SIZES:
        batches = loader(Random(size), BATCH, here, seed=7, last=EPOCHS, whole_batches=True)
        found[size] = predict(model, batches, here)
    recordings = NMNIST(root, "test", transform=Surface(), errors="skip")
    batches = loader(recordings, BATCH, here, last=2, whole_batches=True)
    chosen = votes(nn.Sequential(nn.Flatten(), nn.Linear(2 * 34 * 34, 10)), batches, 2, here)
    found["votes"] = chosen.voters, chosen.targets, chosen.right_votes, tuple(chosen.together)
    return found


class Surface:
    """A random window as a surface [2, 34, 34]."""

    def __call__(self, recording):
        return T.Compose([T.RandomWindow(100_000), T.EventImage()])(recording)


def failed(torn, here):
    """The error of a process, and how many batches came before it."""
    batches = loader(Random(23, torn), BATCH, here, whole_batches=True)
    count = 0
    try:
        for _ in predict_batches(network(), batches, here):
            count += 1
    except (nvsdata.FormatError, ProcessFailed) as error:
        return type(error).__name__, str(error).strip().splitlines()[-1], count
    return None


def trained(out, here):
    """Outputs during a training, by a network with layers of torch, and the weights that the first process has."""
    model, seen = network(), []
    optimizer = torch.optim.SGD(model.parameters(), 0.01)
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, 1)
    trainer = Trainer(model, optimizer, schedule, out, data={}, epochs=2, batch=8, team=here)
    batches = loader(Random(10), BATCH, here, whole_batches=True)

    def evaluate(epoch):
        states = here.gather({name: value.clone() for name, value in model.state_dict().items()})
        seen.append((states[0], predict(model, batches, here)))
        return {}

    trainer.fit(Random(24), evaluate)
    return seen


def main(root, out):
    with team("cpu") as here:
        found = {"evaluated": evaluated(root, here), "trained": trained(out / "run", here)}
        # each process meets the damaged recording in turn, at its first or at its second batch
        found["failed"] = {torn: failed(torn, here) for torn in (0, BATCH, 2 * BATCH)}
        torch.save(found, out / f"{here.rank}.pt")


@pytest.fixture
def damaged(fake_nmnist):
    """Recordings to test on, the last of which is damaged, so that the first one takes its place."""
    victim = max((fake_nmnist / "Test").rglob("*.bin"))
    victim.write_bytes(victim.read_bytes()[:-3])
    return fake_nmnist


def same(one, two):
    """True if nested tuples of tensors and numbers are equal to the last bit."""
    if isinstance(one, torch.Tensor):
        return one.dtype == two.dtype and torch.equal(one, two)
    return len(one) == len(two) and all(map(same, one, two)) if isinstance(one, tuple) else one == two


@pytest.mark.filterwarnings("ignore:.*the next recording that can be read takes its place")
@pytest.mark.parametrize("count", [2, 3])
def test_processes_evaluate_and_fail_together(damaged, tmp_path, count):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(tests=str(Path(__file__).parents[1]), file=__file__))
    result = by_torchrun(count, script, damaged, tmp_path)
    assert result.returncode == 0, result.stderr[-3000:]
    with team("cpu") as alone:
        expected = evaluated(damaged, alone)
        # the first recording takes the place of the last one
        assert expected["votes"][1].tolist() == [*(n // 2 for n in range(19)), 0]
        for size in SIZES:
            assert expected[size][1].tolist() == EPOCHS * list(range(size))
        everyone = [torch.load(tmp_path / f"{rank}.pt", weights_only=True) for rank in range(count)]
        for rank, found in enumerate(everyone):
            assert found["evaluated"].keys() == expected.keys()
            for name, values in expected.items():
                assert same(found["evaluated"][name], values), name
            for state, outputs in found["trained"]:
                model = network()
                model.load_state_dict(state)
                batches = loader(Random(10), BATCH, alone, whole_batches=True)
                assert same(outputs, predict(model, batches, alone))
            for torn, (kind, message, before) in found["failed"].items():
                turn, owner = divmod(torn // BATCH, count)
                assert (kind, before) == ("FormatError" if rank == owner else "ProcessFailed", turn * count)
                assert message.endswith(f"{torn}.bin: torn")
                assert message.startswith(f"process {owner}: ") == (rank != owner)


def test_one_thread_computes(monkeypatch):
    threads = []

    def model(x):
        threads.append(torch.get_num_threads())
        return x

    with team("cpu") as alone:
        batches = loader(Random(5), BATCH, alone)
        before = torch.get_num_threads()
        try:
            torch.set_num_threads(3)
            seen = [torch.get_num_threads() for _ in predict_batches(model, batches, alone)]
        finally:
            torch.set_num_threads(before)
    assert (threads, seen) == ([1, 1], [3, 3])


def test_an_empty_dataset_is_named():
    with team("cpu") as alone, pytest.raises(ValueError, match="the dataset is empty"):
        predict(network(), loader(Random(0), BATCH, alone), alone)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
