"""The log in TensorBoard."""

import builtins
import sys
import types

import pytest
import torch

from nvsdata import training
from nvsdata.training import Team, Trainer, to_tensorboard

HERE = Team(torch.device("cpu"))
LINES = [{"epoch": 1, "loss": 2.0, "test_accuracy": 0.25}, {"epoch": 2, "loss": 1.5, "test_accuracy": 0.5}]


class Writer:
    """Keeps what torch's writer is given."""

    made = ()

    def __init__(self, folder, purge_step):
        self.folder, self.purge_step, self.seen, self.flushed = folder, purge_step, [], 0
        Writer.made = (*Writer.made, self)

    def add_scalar(self, name, value, step):
        self.seen.append((name, value, step))

    def flush(self):
        self.flushed = len(self.seen)


@pytest.fixture
def writers(monkeypatch):
    module = types.ModuleType("torch.utils.tensorboard")
    module.SummaryWriter = Writer
    monkeypatch.setattr(Writer, "made", ())
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return lambda: Writer.made


def trainer_in(out, team=HERE, **options):
    model = torch.nn.Linear(2, 2)
    optimizer, schedule = training.adam(model, 2, (60, 110))
    return Trainer(model, optimizer, schedule, out, data={}, epochs=2, batch=2, team=team, **options)


class Few(torch.utils.data.Dataset):
    def __len__(self):
        return 4

    def __getitem__(self, index):
        return torch.tensor([index, 1.0]), index % 2


def test_every_number_of_every_epoch_is_written_and_flushed(writers, tmp_path):
    trainer = trainer_in(tmp_path)
    trainer.watch(to_tensorboard(tmp_path, HERE))
    trainer.fit(Few(), lambda epoch: {"test_accuracy": epoch / 10})
    (writer,) = writers()
    wanted = [(name, line[name], line["epoch"]) for line in trainer.lines for name in line if name != "epoch"]
    assert writer.seen == wanted
    assert writer.flushed == len(wanted)
    assert {"loss", "test_accuracy", "train_accuracy", "learning_rate", "seconds"} == {name for name, *_ in wanted}


def test_a_resumed_run_shows_its_earlier_epochs_once(writers, tmp_path):
    trainer_in(tmp_path).fit(Few(), lambda epoch: {})
    again = trainer_in(tmp_path, resume=True)
    again.watch(to_tensorboard(tmp_path, HERE))
    again.fit(Few(), lambda epoch: {})
    (writer,) = writers()
    # what an earlier run wrote of these steps is dropped
    assert writer.purge_step == 1
    assert [step for name, _, step in writer.seen if name == "loss"] == [1, 2]


def test_only_the_first_process_writes(writers, tmp_path):
    to_tensorboard(tmp_path, Team(torch.device("cpu"), rank=1, count=2))(LINES[0])
    assert not writers()


def test_without_the_package_its_extra_is_named(monkeypatch, tmp_path):
    real = builtins.__import__

    def lacking(name, *rest):
        if name.endswith("tensorboard"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", lacking)
    monkeypatch.delitem(sys.modules, "torch.utils.tensorboard", raising=False)
    with pytest.raises(ImportError, match=r"pip install 'nvsdata\[tensorboard\]'"):
        to_tensorboard(tmp_path, HERE)


def test_tensorboard_reads_what_was_written(tmp_path):
    accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    for _ in range(2):
        # as a run that is resumed
        see = to_tensorboard(tmp_path, HERE)
        for line in LINES:
            see(line)
    found = accumulator.EventAccumulator(str(tmp_path / "tensorboard"))
    found.Reload()
    assert set(found.Tags()["scalars"]) == {"loss", "test_accuracy"}
    assert [(event.step, event.value) for event in found.Scalars("loss")] == [(1, 2.0), (2, 1.5)]
