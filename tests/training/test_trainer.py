import sys

import pytest
from torch.utils.data import DataLoader

from nvsdata import NMNIST
from nvsdata import transforms as T
from nvsdata.training import run


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
    ("error", "told"),
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
def test_what_will_not_do_is_told_in_a_line(monkeypatch, error, told):
    def main():
        raise error

    monkeypatch.setattr(sys, "argv", ["/somewhere/recipe.py"])
    with pytest.raises(SystemExit) as ended:
        run(main)
    assert ended.value.code == told


def test_an_interrupted_recipe_says_how_to_go_on(capsys):
    def main():
        raise KeyboardInterrupt

    for hint, told in (((), "--resume continues from the last epoch"), (("run it again",), "run it again")):
        with pytest.raises(SystemExit) as ended:
            run(main, *hint)
        assert ended.value.code == 130
        assert capsys.readouterr().err == f"interrupted: {told}\n"
    with pytest.raises(KeyError):
        run(lambda: {}[0])
