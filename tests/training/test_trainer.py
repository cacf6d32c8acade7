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
