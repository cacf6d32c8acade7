"""What a training keeps in its folder, and what becomes of it when something goes wrong."""

import json
import shutil
from contextlib import suppress
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn
from torch.utils.data import TensorDataset

from nvsdata import FormatError, models
from nvsdata.training import Team, Trainer, TrainTestSplit, adam, evaluation
from nvsdata.training.runs import CHECKPOINT, LOG, Checkpoint

DATA = {"dataset": "folder", "split": "all", "fold": 0, "seed": 0, "hash": "ab", "test_hash": "cd"}
HERE = Team(torch.device("cpu"))


class InTurn:
    """A loader of one batch an epoch, without processes."""

    def __new__(cls, dataset, batch, team, *, first, last, **_):
        return [dataset[:] for _ in range(first, last)]


@pytest.fixture(autouse=True)
def _no_processes(monkeypatch):
    monkeypatch.setattr("nvsdata.training.trainer.loader", InTurn)


def trainer(out, *, epochs=3, data=DATA, resume=True, width=4, rate=None, batch=8, smoothing=0.0):
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(2, width), models.BatchNorm(width), nn.Linear(width, 2))
    optimizer, schedule = adam(model, epochs, (60, 100))
    if rate:
        optimizer.param_groups[0]["lr"] = rate
    options = {"epochs": epochs, "batch": batch, "smoothing": smoothing, "team": HERE, "resume": resume}
    return Trainer(model, optimizer, schedule, out, data=data, **options)


def samples(scale=1.0):
    x = torch.randn(8, 2, generator=torch.Generator().manual_seed(1)) * scale
    return TensorDataset(x, (x[:, 0] > 0).long())


def fit(out, stop=None, **options):
    """Train; after `stop` epochs as a kill would stop it."""

    def evaluate(epoch):
        if epoch == stop:
            raise KeyboardInterrupt
        return {"test_accuracy": 0.5}

    here = trainer(out, **options)
    here.fit(samples(), evaluate)
    return here


def lines(out):
    return [
        {k: v for k, v in json.loads(line).items() if k != "seconds"} for line in (out / LOG).read_text().splitlines()
    ]


def stopped(out, stop=3):
    with pytest.raises(KeyboardInterrupt):
        fit(out, stop=stop)
    return out


def test_the_data_is_kept_and_told_once(tmp_path, capsys):
    fit(tmp_path)
    assert capsys.readouterr().out.count("hash ab, test_hash cd") == 1
    assert torch.load(tmp_path / CHECKPOINT, weights_only=True)["data"] == DATA | {"batch": 8, "smoothing": 0.0}
    model = models.RGCNN(2, channels=(2, 2), clusters=((4, 4), (17, 17)))
    where = models.save(model, tmp_path / "model.safetensors", data=DATA)
    assert models.load(where).data == DATA


def test_hashes_tell_what_is_trained_on(fake_nmnist, tmp_path):
    def hashes(root, name="n-mnist", seed=0):
        data = TrainTestSplit(name, root, seed=seed).data
        return data["hash"], data["test_hash"]

    there = shutil.copytree(fake_nmnist, tmp_path / "elsewhere" / "nm")
    whole = hashes(fake_nmnist)
    assert hashes(there) == whole
    assert hashes(there, seed=1) == whole
    (there / "Train/3/00002.bin").unlink()
    fewer = hashes(there)
    assert fewer[0] != whole[0]
    assert fewer[1] == whole[1]
    # held back by the seed
    drawn = [hashes(fake_nmnist / "Train", "folder", seed) for seed in (0, 0, 1)]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]
    assert len({*drawn[0], *drawn[2]}) == 4


@pytest.mark.parametrize("name", DATA)
def test_a_run_on_other_data_is_not_gone_on_with(tmp_path, name):
    stopped(tmp_path)
    with pytest.raises(ValueError, match=rf"belongs to another run, whose {name} is {DATA[name]}, not other"):
        trainer(tmp_path, data=DATA | {name: "other"})
    assert len(lines(tmp_path)) == 2
    trainer(tmp_path, data=DATA | {name: "other"}, resume=False)


@pytest.mark.parametrize(("name", "was", "other"), [("batch", 8, 4), ("smoothing", 0.0, 0.1)])
def test_a_run_of_other_settings_is_not_gone_on_with(tmp_path, name, was, other):
    stopped(tmp_path)
    with pytest.raises(ValueError, match=f"belongs to another run, whose {name} is {was}, not {other}"):
        trainer(tmp_path, **{name: other})


@pytest.mark.parametrize("left", [b"", b'{"epoch": 1, "lo', b'{"epoch": 9}\n\x00\xff\n', None])
def test_a_torn_log_is_mended(tmp_path, left):
    fit(tmp_path / "whole")
    stopped(tmp_path / "stopped")
    log = tmp_path / "stopped" / LOG
    if left is None:
        log.unlink()
    else:
        log.write_bytes(left)
    fit(tmp_path / "stopped")
    assert lines(tmp_path / "stopped") == lines(tmp_path / "whole")


def test_a_damaged_checkpoint_is_told_in_a_line(tmp_path):
    path = stopped(tmp_path) / CHECKPOINT
    whole = path.read_bytes()
    for at in range(0, len(whole), 101):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x41]) + whole[at + 1 :])
        try:
            here = trainer(tmp_path)
        except FormatError as error:
            told = str(error)
        else:
            # a byte that nothing is made of, such as padding
            assert here.done == 2
            continue
        assert told.startswith(f"{path}: is no checkpoint of a training, or damaged: ")
        assert "\n" not in told
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(FormatError, match="or damaged"):
            trainer(tmp_path)


ODD = st.one_of(
    st.none(), st.booleans(), st.sampled_from((0, -1, 10**9, 10**400, 0.5, "x", float("nan"))), st.just([]), st.just({})
)


@given(st.data())
def test_an_odd_checkpoint_is_told_in_a_line(tmp_path_factory, data):
    out = tmp_path_factory.getbasetemp() / "odd"
    if not (out / "whole.pt").exists():
        (stopped(out) / CHECKPOINT).rename(out / "whole.pt")
    state = torch.load(out / "whole.pt", weights_only=True)
    part = state
    while True:
        key = data.draw(st.sampled_from(sorted(part, key=str)))
        if not isinstance(part[key], dict) or not part[key] or data.draw(st.booleans()):
            break
        part = part[key]
    if data.draw(st.booleans()):
        del part[key]
    else:
        part[key] = data.draw(ODD | st.builds(torch.zeros, st.integers(0, 3)))
    torch.save(state, out / CHECKPOINT)
    try:
        here = trainer(out)
    except ValueError as error:
        told = str(error)
    else:
        told = ""
        assert here.done == 2
        # such as weights that are NaN
        with suppress(ValueError):
            here.fit(samples(), lambda epoch: {})
    assert "\n" not in told


def test_other_files_are_no_checkpoints(tmp_path):
    for odd in ([1, 2], torch.zeros(3), {"epoch": 1}, {}):
        torch.save(odd, tmp_path / CHECKPOINT)
        with pytest.raises(FormatError, match="is no checkpoint of a training"):
            trainer(tmp_path)


def test_another_network_is_told(tmp_path):
    stopped(tmp_path)
    with pytest.raises(ValueError, match="belongs to another network or optimizer"):
        trainer(tmp_path, width=5)
    with pytest.raises(ValueError, match="belongs to a run of 3 epochs, not 4"):
        trainer(tmp_path, epochs=4)


def test_a_loss_that_is_no_number_ends_the_training(tmp_path):
    stopped(tmp_path, stop=2)
    before = (tmp_path / CHECKPOINT).read_bytes()
    here = trainer(tmp_path)
    with pytest.raises(ValueError, match=r"the loss became nan in epoch 2: try a lower learning rate"):
        here.fit(samples(scale=float("nan")), lambda epoch: {})
    assert (tmp_path / CHECKPOINT).read_bytes() == before


def test_scores_that_are_nan_name_no_class(monkeypatch):
    scores = torch.tensor([[0.0, 1.0], [torch.nan, torch.nan], [1.0, 0.0], [torch.nan, 2.0]])
    targets = torch.tensor([1, 0, 0, 0])
    monkeypatch.setattr(evaluation, "predict", lambda *_: (scores, targets))
    # two recordings with two windows each: of the second one, one window has no scores
    assert evaluation.accuracies(None, None, 1, HERE) == (0.5, 0.5)
    targets[:] = torch.tensor([1, 0, 1, 0])
    assert evaluation.accuracies(None, None, 2, HERE) == (0.25, 0.0)


def test_a_checkpoint_is_checked_when_it_is_made():
    good = Checkpoint(epoch=1, epochs=2, data={}, log=[{}], model={}, optimizer={}, schedule={})
    for change in ({"epoch": 3}, {"epoch": True}, {"log": []}, {"log": [1]}, {"model": 3}, {"epochs": None}):
        with pytest.raises(ValueError, match=r"it is of|it has|its parts"):
            replace(good, **change)
