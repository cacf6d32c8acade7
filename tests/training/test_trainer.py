import sys

import pytest
import torch
from torch.utils.data import DataLoader

from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.training import Trainer, run, runs, team
from nvsdata.training import runs as ending


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
    monkeypatch.setattr(runs, "FINISHED", {})
    monkeypatch.setattr(ending, "FINISHED", runs.FINISHED)


def test_an_interrupted_recipe_says_how_to_go_on(capsys, no_training):
    def main():
        raise KeyboardInterrupt

    assert interrupted(capsys, main, "run it again") == "interrupted: run it again\n"
    # it trains nothing
    assert interrupted(capsys, main) == "interrupted\n"
    with pytest.raises(KeyError):
        run(lambda: {}[0])


def test_only_a_finished_epoch_can_be_continued_from(capsys, no_training, tmp_path):
    nothing = "interrupted: no epoch was finished, so there is nothing to continue from\n"
    kept = "interrupted: --resume continues from the last epoch\n"

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
