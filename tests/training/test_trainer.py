import sys

import pytest
import torch
from torch.utils.data import DataLoader

from nvsdata import NMNIST, FormatError
from nvsdata import transforms as T
from nvsdata.training import Trainer, run, runs, team
from nvsdata.training import runs as ending
from nvsdata.training.processes import ProcessFailed


def test_a_damaged_recording_is_named_however_deep_in_a_pipeline_it_is_met(fake_nmnist, capsys, monkeypatch):
    """What a loader's worker raised comes as a text."""
    victim = fake_nmnist / "Train/3/00002.bin"
    victim.write_bytes(victim.read_bytes()[:-3])
    dataset = NMNIST(fake_nmnist, transform=T.Compose([T.Window(0, 10)]))
    monkeypatch.setattr(sys, "argv", ["recipe.py"])

    def main():
        for _ in DataLoader(dataset, 4, num_workers=1, collate_fn=list):
            pass

    with pytest.raises(SystemExit, match=r"^recipe.py: .*00002.bin: byte \d+: truncated"):
        run(main)


@pytest.mark.parametrize(
    ("error", "output"),
    [
        (ValueError("x: y: z"), "recipe.py: x: y: z"),
        (OSError("no folder"), "recipe.py: no folder"),
        (ImportError("pip install it"), "recipe.py: pip install it"),
        (ProcessFailed("process 1: a.bin: torn"), "recipe.py: process 1: a.bin: torn"),
        # what a loader's worker sends
        (
            ValueError("Caught FormatError in worker 0.\nTraceback:\n  a: b\nnvsdata.FormatError: a.bin: torn\n"),
            "recipe.py: a.bin: torn",
        ),
    ],
)
def test_what_will_not_do_is_told_in_a_line(monkeypatch, error, output):
    def main():
        raise error

    monkeypatch.setattr(sys, "argv", ["/somewhere/recipe.py"])
    with pytest.raises(SystemExit) as ended:
        run(main)
    assert ended.value.code == output


def interrupted(capsys, main, *hint):
    with pytest.raises(SystemExit) as ended:
        run(main, *hint)
    assert ended.value.code == 130
    return capsys.readouterr().err


@pytest.fixture
def no_training(monkeypatch):
    """A process without a training so far."""
    monkeypatch.setattr(runs, "RESUMABLE", {})
    monkeypatch.setattr(ending, "RESUMABLE", runs.RESUMABLE)


def test_an_interrupted_recipe_says_how_to_go_on(capsys, no_training):
    def main():
        raise KeyboardInterrupt

    assert interrupted(capsys, main, "run it again") == "interrupted: run it again\n"
    # it trains nothing
    assert interrupted(capsys, main) == "interrupted\n"
    with pytest.raises(KeyError):
        run(lambda: {}[0])


def test_only_a_checkpoint_can_be_continued_from(capsys, no_training, tmp_path):
    nothing = "interrupted: no checkpoint was written, so there is nothing to continue from\n"
    kept = "interrupted: --resume continues from the last checkpoint\n"

    def main(last, resume=False):
        model = torch.nn.Linear(2, 2)
        optimizer = torch.optim.SGD(model.parameters(), 0.1)
        schedule = torch.optim.lr_scheduler.StepLR(optimizer, 1)
        with team("cpu") as here:
            how = {"data": {}, "epochs": 3, "batch": 2, "team": here, "resume": resume}
            trainer = Trainer(model, optimizer, schedule, tmp_path, **how)

            def evaluate(epoch):
                if epoch > last:
                    raise KeyboardInterrupt
                return {}

            trainer.fit([(torch.zeros(2), 0)] * 4, evaluate)

    assert interrupted(capsys, lambda: main(0)) == nothing
    assert interrupted(capsys, lambda: main(1)) == kept
    # of the checkpoint that is there nothing is continued, unless that was asked for
    assert interrupted(capsys, lambda: main(0)) == nothing
    assert interrupted(capsys, lambda: main(1, resume=True)) == kept
    with pytest.raises(KeyError):
        run(lambda: {}[0])


class Interrupted(torch.nn.Module):
    """A network with random masks and running means, which is interrupted at a step or yields NaN from one on."""

    def __init__(self, at, nan_at=-1):
        super().__init__()
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(3, 8), torch.nn.BatchNorm1d(8), torch.nn.Dropout(), torch.nn.Linear(8, 2)
        )
        self.at, self.nan_at, self.steps = at, nan_at, 0

    def forward(self, x):
        self.steps += self.training
        if self.steps == self.at:
            raise KeyboardInterrupt
        return self.layers(x) * (float("nan") if self.steps == self.nan_at else 1)


def trained(out, *, every, resume=False, validated=False, size=20, batch=3, **how):
    """A run of two epochs, of seven steps by default: the trainer, and its lines without times."""
    dataset = [(torch.tensor([n, n % 3, n % 5]).float(), n % 2) for n in range(size)]
    torch.manual_seed(0)
    model = Interrupted(**{"at": -1} | how)
    optimizer = torch.optim.Adam(model.parameters(), 0.01)
    schedule = torch.optim.lr_scheduler.StepLR(optimizer, 1)
    with team("cpu") as here:
        settings = {"data": {}, "epochs": 2, "batch": batch, "team": here, "resume": resume}
        trainer = Trainer(model, optimizer, schedule, out, **settings)
        evaluate = (lambda epoch: {"validation_accuracy": 1 / epoch}) if validated else None
        trainer.fit(dataset, evaluate, checkpoint_every=every)
    return trainer, [{**line, "seconds": 0} for line in trainer.lines]


def within(out):
    return torch.load(out / "checkpoint.pt", weights_only=True)["within"]


@pytest.mark.parametrize("validated", [True, False])
@pytest.mark.parametrize(("at", "step"), [(2, None), (3, 2), (4, 2), (7, 6), (8, None), (9, None), (10, 2), (13, 4)])
def test_a_run_continues_within_an_epoch_bit_identically(at, step, validated, tmp_path):
    whole, lines = trained(tmp_path / "whole", every=None, validated=validated)
    out = tmp_path / "stopped"
    with pytest.raises(KeyboardInterrupt):
        trained(out, every=2, at=at, validated=validated)
    done = step or 0
    if at > 2:
        assert (within(out) or {}).get("step") == step
    # by another number of steps between checkpoints
    found, log = trained(out, every=5, resume=True, validated=validated)
    assert log == lines
    weights = found.model.state_dict()
    assert all(torch.equal(weights[name], value) for name, value in whole.model.state_dict().items())
    # nothing is trained twice
    assert found.model.steps == 14 - done - 7 * (at > 7)
    assert within(out) is None


def test_the_time_before_an_interruption_counts(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, every=2, at=4)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    state["within"]["seconds"] = 1_000.0
    torch.save(state, tmp_path / "checkpoint.pt")
    trainer, _ = trained(tmp_path, every=None, resume=True)
    assert [line["seconds"] >= 1_000 for line in trainer.lines] == [True, False]


def test_a_checkpoint_without_steps_is_that_of_an_epoch(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, every=None, at=10)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    del state["within"]
    torch.save(state, tmp_path / "checkpoint.pt")
    assert trained(tmp_path, every=None, resume=True)[1] == trained(tmp_path / "whole", every=None)[1]


@pytest.mark.parametrize("nan_at", [3, 4])
def test_a_loss_that_is_nan_leaves_the_checkpoint_before(tmp_path, nan_at):
    with pytest.raises(ValueError, match="the loss became nan in epoch 1"):
        trained(tmp_path, every=2, nan_at=nan_at)
    assert within(tmp_path)["step"] == 2
    assert trained(tmp_path, every=2, resume=True)[1] == trained(tmp_path / "whole", every=None)[1]


STATES = [[torch.zeros(5, dtype=torch.uint8)]]


@pytest.mark.parametrize(
    "changed",
    [
        *({"step": step} for step in (0, 2.0, True, None, 10**400, "2")),
        *(
            {"sums": sums}
            for sums in ((), (1.0, 2.0), None, 5, (1.0, 5.0, 2.0), (-1.0, 1.0, 3.0), (float("nan"), 1.0, 3.0))
        ),
        *({"seconds": seconds} for seconds in (None, "x", -1.0, float("inf"))),
        *({"generators": states} for states in ((), None, [[]], [None], {}, STATES, [[torch.zeros(5)]])),
        {"other": 1},
    ],
)
def test_damaged_states_within_an_epoch_are_named(tmp_path, changed):
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, every=2, at=4)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    state["within"] |= changed
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises((ValueError, FormatError), match=r"checkpoint\.pt"):
        trained(tmp_path, every=2, resume=True)


def test_a_step_beyond_the_epoch_is_named(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path, every=2, at=8)
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert state["epoch"] == 1
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "other", every=6, at=7)
    with pytest.raises(ValueError, match=r"checkpoint\.pt belongs to an epoch of more than 6 steps, not 5"):
        trained(tmp_path / "other", every=2, resume=True, size=15)
    with pytest.raises(ValueError, match="checkpoint_every must be a whole number of at least 1"):
        trained(tmp_path / "third", every=0)
