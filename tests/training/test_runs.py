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

import nvsdata
from nvsdata import FormatError, models
from nvsdata.datasets.store.writer import pack
from nvsdata.training import Team, Trainer, TrainTestSplit, adam, evaluation, runs
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


def test_networks_are_made_for_the_sensor_of_the_data(fake_nmnist, monkeypatch):
    assert TrainTestSplit("n-mnist", fake_nmnist).sensor_size == (34, 34)
    monkeypatch.setattr(nvsdata.NMNIST, "sensor_size", None)
    # that of the DAVIS240C, which recorded most of them
    assert TrainTestSplit("n-mnist", fake_nmnist).sensor_size == (240, 180)


@pytest.mark.parametrize("packed", [False, True])
def test_test_recordings_that_are_training_recordings_are_found(fake_nmnist, tmp_path, packed):
    shutil.copy(fake_nmnist / "Train/3/00002.bin", fake_nmnist / "Test/4/00777.bin")
    root = fake_nmnist
    if packed:
        root = tmp_path / "digits.nvs"
        pack(nvsdata.NMNIST(fake_nmnist, "all"), root)
    assert TrainTestSplit("n-mnist", root).overlap() == {"Test/4/00777.bin": "Train/3/00002.bin"}
    # one of another size, one of equal size with other events
    content = bytearray((fake_nmnist / "Train/3/00002.bin").read_bytes())
    content[1] ^= 1
    (fake_nmnist / "Test/4/00777.bin").write_bytes(content)
    (fake_nmnist / "Test/4/00778.bin").write_bytes(content[:-5])
    assert TrainTestSplit("n-mnist", fake_nmnist).overlap() == {}


def test_a_copy_of_the_training_data_is_no_other_dataset(fake_nmnist, tmp_path):
    shutil.copytree(fake_nmnist / "Train", tmp_path / "copy/Test")
    data = TrainTestSplit("n-mnist", fake_nmnist, test_from=("n-mnist", tmp_path / "copy"))
    trained = data.train(None).recording_names()
    assert data.overlap() == {name.replace("Train", "Test"): name for name in trained}
    both = TrainTestSplit("n-mnist", fake_nmnist, test_from=("n-mnist", fake_nmnist))
    assert both.overlap() == {}


def test_recordings_for_validation_come_from_training_only(fake_nmnist):
    for path in list((fake_nmnist / "Train").glob("*/00001.bin")):
        for number in range(10, 40):
            shutil.copy(path, path.with_name(f"{number:05}.bin"))
    whole, part = TrainTestSplit("n-mnist", fake_nmnist), TrainTestSplit("n-mnist", fake_nmnist, validate=0.5)
    assert whole.validation(None) is None
    names = [sample.name for sample in part.train(None).samples + part.validation(None).samples]
    assert sorted(names) == sorted(sample.name for sample in whole.train(None).samples)
    assert part.test(None).samples == whole.test(None).samples
    assert part.data["validation_hash"] == part.validation(None).split_hash != part.data["hash"]
    assert (part.data["validate"], "validate" in whole.data) == (0.5, False)
    # the same for other seeds
    assert (
        TrainTestSplit("n-mnist", fake_nmnist, validate=0.5, seed=1).data["validation_hash"]
        == part.data["validation_hash"]
    )
    assert part.validation(len).transform is len


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
            result = str(error)
        else:
            # a byte that nothing is made of, such as padding
            assert here.done == 2
            continue
        assert result.startswith(f"{path}: is not a checkpoint of a training, or is damaged: ")
        assert "\n" not in result
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(FormatError, match="or is damaged"):
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
        result = str(error)
    else:
        result = ""
        assert here.done == 2
        # such as weights that are NaN
        with suppress(ValueError):
            here.fit(samples(), lambda epoch: {})
    assert "\n" not in result


def test_other_files_are_no_checkpoints(tmp_path):
    for odd in ([1, 2], torch.zeros(3), {"epoch": 1}, {}):
        torch.save(odd, tmp_path / CHECKPOINT)
        with pytest.raises(FormatError, match="is not a checkpoint of a training"):
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
    found = evaluation.votes(None, None, 1, HERE)
    assert (found.single.value, found.together.value) == (0.5, 0.5)
    targets[:] = torch.tensor([1, 0, 1, 0])
    found = evaluation.votes(None, None, 2, HERE)
    assert (found.single.value, found.together.value) == (0.25, 0.0)


def test_a_checkpoint_is_checked_when_it_is_made():
    good = Checkpoint(epoch=1, epochs=2, data={}, log=[{}], model={}, optimizer={}, schedule={})
    for change in ({"epoch": 3}, {"epoch": True}, {"log": []}, {"log": [1]}, {"model": 3}, {"epochs": None}):
        with pytest.raises(ValueError, match=r"epoch is|log has|wrong types"):
            replace(good, **change)


def test_checkpoints_of_no_epoch_and_of_all():
    good = {"data": {}, "model": {}, "optimizer": {}, "schedule": {}}
    for epoch, epochs in ((0, 0), (0, 2), (2, 2)):
        assert Checkpoint(epoch=epoch, epochs=epochs, log=[{}] * epoch, **good).epoch == epoch
    for epoch, epochs, lines, reason in (
        (3, 2, 3, "epoch is 3, of 2 epochs"),
        (-1, 2, 0, "epoch is -1, of 2 epochs"),
        (2, 2, 1, "log has 1 lines for 2 epochs"),
        (1, 2, 2, "log has 2 lines for 1 epochs"),
    ):
        with pytest.raises(ValueError, match=reason):
            Checkpoint(epoch=epoch, epochs=epochs, log=[{}] * lines, **good)


def states():
    """A part of a training, its state after a step, and the state of it as it may have been altered."""
    model = nn.Sequential(nn.Linear(2, 3), nn.Linear(3, 1))
    optimizer, schedule = adam(model, 3, (60, 100))
    model(torch.ones(1, 2)).sum().backward()
    optimizer.step()
    return model, optimizer, schedule


def altered(state, *path, to):
    """A state with something else at a place."""
    first, *rest = path
    copied = state.copy()
    if rest:
        copied[first] = altered(state[first], *rest, to=to)
    elif to is None:
        del copied[first]
    else:
        copied[first] = to
    return copied


def test_an_optimizer_takes_its_own_state_only():
    _, optimizer, _ = states()
    state = optimizer.state_dict()
    of_first = state["state"][0]
    runs.restore(optimizer, state)
    runs.restore(optimizer, altered(state, "state", to={}))
    # of weights that had no gradient it keeps nothing
    runs.restore(optimizer, altered(state, "state", 3, to=None))
    for wrong in (
        altered(state, "state", to=[]),
        altered(state, "state", 4, to=of_first),
        altered(state, "state", -1, to=of_first),
        altered(state, "state", 0, to=[1]),
        altered(state, "state", 0, "exp_avg", to=torch.zeros(3, 3)),
        altered(state, "state", 0, "exp_avg", to=torch.zeros(())),
        altered(state, "state", 0, "exp_avg", to=0.5),
        altered(state, "state", 0, "exp_avg", to=None),
        altered(state, "state", 1, to=of_first),
        altered(state, "param_groups", to=[]),
        altered(state, "param_groups", to=state["param_groups"] * 2),
        altered(state, "param_groups", 0, "lr", to="fast"),
        altered(state, "param_groups", 0, "lr", to=None),
        altered(state, "param_groups", 0, "params", to=[0, 1, 2]),
        altered(state, "more", to=1),
    ):
        with pytest.raises(ValueError, match="the state is that of another optimizer"):
            runs.restore(optimizer, wrong)
    assert optimizer.state_dict()["state"][0]["step"] == 1


def test_networks_and_schedules_take_their_own_states_only():
    model, _, schedule = states()
    own = model.state_dict(), schedule.state_dict()
    for part, state in zip((model, schedule), own, strict=True):
        runs.restore(part, state)
    weight = own[0]["0.weight"]
    for wrong in (
        altered(own[0], "0.weight", to=None),
        altered(own[0], "0.weight", to=weight.T),
        altered(own[0], "0.weight", to=weight.double()),
        altered(own[0], "0.weight", to=weight.tolist()),
        altered(own[0], "more", to=weight),
    ):
        with pytest.raises(ValueError, match="the state is that of another network or schedule"):
            runs.restore(model, wrong)
    for wrong in (
        altered(own[1], "last_epoch", to=1.5),
        altered(own[1], "base_lrs", to=[]),
        altered(own[1], "base_lrs", to=(0.001,)),
        altered(own[1], "last_epoch", to=None),
    ):
        with pytest.raises(ValueError, match="the state is that of another network or schedule"):
            runs.restore(schedule, wrong)


class Shares(nn.Module):
    """In place of the network that several processes share."""

    def __init__(self, model, **_):
        super().__init__()
        self.model = model

    def forward(self, x):
        return self.model(x)


@pytest.mark.parametrize(
    ("batch", "processes", "left"),
    [(3, 2, None), (4, 2, None), (8, 8, None), (7, 2, 1), (5, 4, 3), (1, 2, 1), (8, 9, 8)],
)
def test_every_process_needs_a_sample_of_every_batch(tmp_path, monkeypatch, batch, processes, left):
    """Of eight samples."""
    monkeypatch.setattr("nvsdata.training.trainer.DistributedDataParallel", Shares)
    here = trainer(tmp_path, epochs=0, batch=batch)
    here.team = Team(torch.device("cpu"), 0, processes)
    if left is None:
        assert here.fit(samples(), lambda epoch: {}) == {}
        return
    with pytest.raises(ValueError, match=f"the last batch has {left} samples for {processes} processes"):
        here.fit(samples(), lambda epoch: {})


def test_lines_are_watched_kept_and_returned(tmp_path):
    here, seen = trainer(tmp_path), []
    here.watch(lambda line: seen.append(line["epoch"]))
    damaged = samples()
    damaged.num_damaged = 2
    last = here.fit(damaged, lambda epoch: {"twice": 2 * epoch})
    assert seen == [1, 2, 3] == [line["epoch"] for line in lines(tmp_path)]
    assert (last["epoch"], last["twice"], last["damaged"]) == (3, 6, 2)
    assert last is here.lines[-1]
    assert (last["seconds"], round(last["seconds"], 2)) == (last["seconds"],) * 2
    # who comes later is told what was
    late = []
    here.watch(lambda line: late.append(line["epoch"]))
    assert late == [1, 2, 3]
    assert here.fit(samples(), lambda epoch: {}) is last
    assert "damaged" not in trainer(tmp_path / "b").fit(samples(), lambda epoch: {})


def test_the_first_process_alone_writes(tmp_path, capsys):
    model = models.RGCNN(2, channels=(2, 2), clusters=((4, 4), (17, 17)))
    optimizer, schedule = adam(model, 1, (60, 100))
    for rank, expected in ((1, set()), (0, {"log.jsonl", "model.safetensors"})):
        team = Team(torch.device("cpu"), rank, 2)
        here = Trainer(model, optimizer, schedule, tmp_path, data=DATA, epochs=1, batch=8, team=team)
        here.publish(["a", "b"], None, {"test_accuracy": 0.5})
        seen = []
        here.lines = [{"epoch": 1}]
        here.watch(seen.append)
        assert seen == [{"epoch": 1}] * (rank == 0)
        assert {path.name for path in tmp_path.iterdir()} == expected
        assert (capsys.readouterr().out != "") == (rank == 0)
    found = models.load(tmp_path / "model.safetensors")
    assert (found.classes, found.metrics) == (("a", "b"), {"test_accuracy": 0.5})
    assert found.data == DATA | {"batch": 8, "smoothing": 0.0}


def chosen(out, accuracies, stop=None, **options):
    """A trainer after training with the given validation accuracies, and the weights of each epoch."""
    here, weights = trainer(out, epochs=len(accuracies), **options), {}

    def evaluate(epoch):
        if epoch == stop:
            raise KeyboardInterrupt
        weights[epoch] = {name: value.clone() for name, value in here.model.state_dict().items()}
        return {"validation_accuracy": accuracies[epoch - 1]}

    return here, weights, evaluate


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


@pytest.mark.parametrize(("accuracies", "best"), [((0.2, 0.9, 0.9, 0.5), 3), ((0.9, 0.1), 1), ((0.1, 0.2), 2)])
def test_the_network_ends_with_the_weights_of_the_best_epoch(tmp_path, accuracies, best):
    here, weights, evaluate = chosen(tmp_path, accuracies)
    assert here.fit(samples(), evaluate)["epoch"] == best
    assert same(here.model.state_dict(), weights[best])
    # and a run that is done restores them
    again, _, evaluate = chosen(tmp_path, accuracies)
    assert again.fit(samples(), evaluate)["epoch"] == best
    assert same(again.model.state_dict(), weights[best])


def test_a_resumed_run_selects_as_one_without_a_stop(tmp_path):
    accuracies = (0.4, 0.8, 0.1, 0.7, 0.6)
    here, weights, evaluate = chosen(tmp_path / "whole", accuracies)
    here.fit(samples(), evaluate)
    stopped, _, evaluate = chosen(tmp_path / "stopped", accuracies, stop=4)
    with pytest.raises(KeyboardInterrupt):
        stopped.fit(samples(), evaluate)
    resumed, later, evaluate = chosen(tmp_path / "stopped", accuracies)
    assert resumed.fit(samples(), evaluate)["epoch"] == 2
    assert list(later) == [4, 5]
    assert same(resumed.model.state_dict(), weights[2])
    assert same(later[5], weights[5])


@pytest.mark.parametrize(("patience", "epochs"), [(None, 6), (1, 3), (2, 4), (3, 6), (9, 6)])
def test_patience_stops_a_training_that_no_longer_improves(tmp_path, patience, epochs):
    here, _, evaluate = chosen(tmp_path, (0.3, 0.6, 0.5, 0.6, 0.7, 0.7))
    last = here.fit(samples(), evaluate, patience)
    assert here.done == epochs
    assert last["validation_accuracy"] == (0.6 if epochs < 6 else 0.7)


def test_a_best_epoch_that_is_none_of_the_runs_is_damage(tmp_path):
    here, _, evaluate = chosen(tmp_path, (0.3, 0.6))
    here.fit(samples(), evaluate)
    path = tmp_path / runs.CHECKPOINT
    state = torch.load(path, weights_only=True)
    for best in ((3, state["best"][1]), (0, state["best"][1]), 7, ()):
        torch.save(state | {"best": best}, path)
        with pytest.raises(FormatError, match="is not a checkpoint of a training, or is damaged"):
            trainer(tmp_path, epochs=2)
    for best in ((1, {}), (1, None)):
        torch.save(state | {"best": best}, path)
        with pytest.raises(ValueError, match="belongs to another network or optimizer"):
            trainer(tmp_path, epochs=2)
