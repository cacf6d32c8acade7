"""A training changes weights as its text says: against a loop of formulas, by heart, and the same when resumed."""

import contextlib
import json
import math
from copy import deepcopy

import numpy as np
import pytest
import torch
from learning import share_right
from lookalikes import saccade
from torch.utils.data import Dataset

from nvsdata import Events, collate, models
from nvsdata.training import Team, Trainer, adam, sgd, votes
from nvsdata.training.objects import Objects
from nvsdata.training.optimizers import one_cycle

HERE = Team(torch.device("cpu"))
COUNT, CLASSES = 16, 4
TINY = {"channels": (4, 6), "clusters": ((4, 4), (17, 17)), "hidden": 8}


class Recordings(Dataset):
    """Sixteen bars that sweep the sensor at four angles, which are their classes."""

    def __init__(self, transform):
        self.transform = transform

    def __len__(self):
        return COUNT

    def __getitem__(self, index):
        columns = saccade(np.random.default_rng(index), 2 * (index % CLASSES), 200)
        return self.transform(Events(*columns, (34, 34))), index % CLASSES


WHOLE = Objects("n-mnist", window=100_000, features=(), augment=False, smoothing=0.0, width=0.25)


@pytest.fixture(scope="module")
def samples():
    """All of them as graphs."""
    recordings = Recordings(WHOLE.pipeline(training=False))
    return [recordings[n] for n in range(COUNT)]


@pytest.mark.parametrize(("network", "schedule"), [("rgcnn", "steps"), ("gcnn", "one-cycle")])
def test_sixteen_recordings_are_learnt_by_heart(tmp_path, samples, network, schedule):
    protocol = Objects(**vars(WHOLE) | {"network": network, "schedule": schedule})
    known = {"recordings": COUNT, "sensor_size": (34, 34), "classes": CLASSES, "data": {}}
    torch.manual_seed(0)
    trainer = protocol.trainer(tmp_path, **known, team=HERE, epochs=30, batch=8)
    trainer.model.dropout.p = 0.0
    batch = collate(samples)
    batches = [collate(samples[:10]), collate(samples[10:])]
    recordings = Recordings(protocol.pipeline(training=True))
    last = trainer.fit(recordings, lambda epoch: {"accuracy": votes(trainer.model, batches, 1, HERE).single.value})
    assert trainer.lines[0]["loss"] > 1
    assert last["loss"] < 0.05
    assert last["train_accuracy"] == last["accuracy"] == 1
    assert share_right(trainer.model, *batch) == 1
    assert torch.nn.functional.cross_entropy(trainer.model(batch.inputs), batch.targets) < 0.05


def order(epoch):
    """An order of the samples for each epoch."""
    return [(5 * n + 3 * epoch) % COUNT for n in range(COUNT)]


@pytest.fixture
def in_turn(monkeypatch):
    """The loader takes samples in `order`, in this process."""

    def loader(dataset, batch, team, *, first, last, **_):
        for epoch in range(first, last):
            for at in range(0, COUNT, batch):
                yield collate([dataset[n] for n in order(epoch)[at : at + batch]])

    monkeypatch.setattr("nvsdata.training.trainer.loader", loader)


EPOCHS, BATCH = 7, 6  # the last batch of an epoch has four samples
OPTIMIZERS = {
    "adam": lambda model: adam(model, EPOCHS, (60, 110)),
    "sgd": lambda model: sgd(model, 0.05, 3, EPOCHS, decay=0.02, decayed=[model.hidden]),
    "sgd of all": lambda model: sgd(model, 0.05, 2, EPOCHS, decay=0.02),
    "one-cycle": lambda model: one_cycle(model, EPOCHS, 0.01),
}


def rate_of(name, epoch):
    """Learning rate of an epoch, from the text: 60 and 110 of 150 are 3 and 5 of 7."""
    if name == "adam":
        return 1e-3 * 0.1 ** sum(epoch >= milestone for milestone in (3, 5))
    if name.startswith("sgd"):
        return 0.05 * 0.1 ** (epoch // (3 if name == "sgd" else 2))
    middle = (epoch + 0.5) / 7
    if middle < 0.3:
        return 0.01 * (0.04 + 0.96 * (0.5 - 0.5 * math.cos(math.pi * middle / 0.3)))
    return 0.01 * (0.5 + 0.5 * math.cos(math.pi * (middle - 0.3) / 0.7))


class Adam:
    """Kingma and Ba 2015, algorithm 1."""

    def __init__(self):
        self.first, self.second, self.steps = {}, {}, 0

    def __call__(self, name, rate, weight, gradient):
        self.first[name] = 0.9 * self.first.get(name, 0) + 0.1 * gradient
        self.second[name] = 0.999 * self.second.get(name, 0) + 0.001 * gradient**2
        first, second = self.first[name] / (1 - 0.9**self.steps), self.second[name] / (1 - 0.999**self.steps)
        return weight - rate * first / (second.sqrt() + 1e-8)


class Momentum:
    """Gradient descent with momentum 0.9, and weight decay 0.02 of some weights."""

    def __init__(self, decayed):
        self.velocity, self.decayed, self.steps = {}, decayed, 0

    def __call__(self, name, rate, weight, gradient):
        gradient = gradient + 0.02 * weight if name.startswith(self.decayed) else gradient
        self.velocity[name] = 0.9 * self.velocity[name] + gradient if name in self.velocity else gradient
        return weight - rate * self.velocity[name]


RULES = {"sgd": lambda: Momentum("hidden."), "sgd of all": lambda: Momentum("")}


def by_hand(name, model, samples, smoothing):
    """Loss and accuracy of each epoch; the model is changed."""
    rule, lines = RULES.get(name, Adam)(), []
    model.train()
    for epoch in range(EPOCHS):
        losses, right = [], 0
        for at in range(0, COUNT, BATCH):
            inputs, targets = collate([samples[n] for n in order(epoch)[at : at + BATCH]])
            scores = model(inputs)
            logs = scores - scores.exp().sum(1, keepdim=True).log()
            wanted = torch.full_like(logs, smoothing / CLASSES)
            for n, target in enumerate(targets.tolist()):
                wanted[n, target] += 1 - smoothing
                right += int(scores[n].argmax()) == target
            each = -(wanted * logs).sum(1)
            losses += each.tolist()
            named = dict(model.named_parameters())
            gradients = torch.autograd.grad(each.mean(), named.values())
            rule.steps += 1
            with torch.no_grad():
                for (key, weight), gradient in zip(named.items(), gradients, strict=True):
                    weight.copy_(rule(key, rate_of(name, epoch), weight, gradient))
        lines.append((sum(losses) / COUNT, right / COUNT))
    return lines


def trainer_of(name, out, model, **options):
    optimizer, schedule = OPTIMIZERS[name](model)
    settings = {"data": {}, "epochs": EPOCHS, "batch": BATCH, "team": HERE}
    return Trainer(model, optimizer, schedule, out, **settings | options)


@pytest.mark.parametrize("smoothing", [0.0, 0.2])
@pytest.mark.parametrize("name", OPTIMIZERS)
def test_a_training_is_the_loop_of_its_formulas(tmp_path, in_turn, samples, name, smoothing):
    model = models.RGCNN(CLASSES, **TINY, dropout=0.0).double()
    other, start = deepcopy(model), deepcopy(model.state_dict())
    trainer = trainer_of(name, tmp_path, model, smoothing=smoothing)
    trainer.fit(samples, lambda epoch: {})
    expected = by_hand(name, other, samples, smoothing)
    for line, (loss, accuracy), epoch in zip(trainer.lines, expected, range(EPOCHS), strict=True):
        assert line["learning_rate"] == pytest.approx(rate_of(name, epoch))
        assert line["loss"] == pytest.approx(loss, abs=1e-6)
        assert line["train_accuracy"] == accuracy
    weights = other.state_dict()
    for key, weight in model.state_dict().items():
        torch.testing.assert_close(weight, weights[key], rtol=0, atol=1e-6)
    moved = {key: (weight - start[key]).abs().max() for key, weight in model.named_parameters()}
    # by far more than what is tolerated; a normalization takes away any bias before it
    assert min(far for key, far in moved.items() if not key.endswith(("conv.bias", "shortcut.bias"))) > 1e-5


@pytest.mark.parametrize("name", OPTIMIZERS)
def test_a_resumed_training_has_the_same_bits(tmp_path, in_turn, samples, name):
    """With dropout, whose draws depend on the epoch alone."""

    def run(out, stop=None, resume=False):
        torch.manual_seed(3 if resume else 0)  # a resumed network starts from what was kept
        trainer = trainer_of(name, tmp_path / out, models.RGCNN(CLASSES, **TINY), resume=resume)

        def evaluate(epoch):
            torch.rand(7)  # an evaluation may draw
            if epoch == stop:
                raise KeyboardInterrupt
            return {"epoch squared": epoch**2}

        trainer.fit(samples, evaluate)
        return trainer

    whole = run("whole")
    for stop in (3, 5):
        with pytest.raises(KeyboardInterrupt):
            run("stopped", stop, resume=stop == 5)
    resumed = run("stopped", resume=True)
    for part in ("model", "optimizer", "schedule"):
        assert same(whole.parts[part].state_dict(), resumed.parts[part].state_dict()), part
    logs = [(tmp_path / out / "log.jsonl").read_text().splitlines() for out in ("whole", "stopped")]
    assert [[timeless(json.loads(line)) for line in log] for log in logs] == [[timeless(x) for x in whole.lines]] * 2


def timeless(line):
    return {key: value for key, value in line.items() if key != "seconds"}


def same(a, b):
    if isinstance(a, torch.Tensor):
        return torch.equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return a == b


class Numbers(Dataset):
    def __len__(self):
        return COUNT

    def __getitem__(self, index):
        return torch.tensor([float(index), torch.rand(()).item()]), index % 2


def test_every_epoch_takes_every_sample_once_in_an_order_and_with_draws_of_its_own(tmp_path):
    def seen(out, epochs=4, seed=5, resume=False):
        """Samples of each epoch [epochs, COUNT, 2], and what the network draws for each batch [epochs, 3]."""
        model, taken, drawn = torch.nn.Linear(2, 2), [], []

        def look(_, given):
            taken.append(given[0].clone())
            drawn.append(torch.rand(()))  # as dropout does

        model.register_forward_pre_hook(look)
        optimizer, schedule = adam(model, 4, (60, 110))
        settings = {"data": {}, "epochs": 4, "batch": BATCH, "team": HERE, "seed": seed, "resume": resume}

        def stop(epoch):
            if epoch == epochs and epochs < 4:
                raise KeyboardInterrupt
            return {}

        with contextlib.suppress(KeyboardInterrupt):
            Trainer(model, optimizer, schedule, tmp_path / out, **settings).fit(Numbers(), stop)
        assert [len(batch) for batch in taken] == [6, 6, 4] * (len(taken) // 3)
        return torch.cat(taken).view(-1, COUNT, 2), torch.stack(drawn).view(-1, 3)

    whole, drawn = seen("whole")
    orders = whole[..., 0].long().tolist()
    assert len(orders) == 4
    assert all(sorted(one) == list(range(COUNT)) for one in orders)
    assert len({tuple(one) for one in orders}) == 4
    assert len(whole[..., 1].unique()) == 4 * COUNT
    assert len(drawn.unique()) == 4 * 3
    stopped = seen("stopped", 2)
    # the second epoch was stopped before it was kept
    resumed = seen("stopped", resume=True)
    for of_whole, of_stopped, of_resumed in zip((whole, drawn), stopped, resumed, strict=True):
        assert torch.equal(of_stopped, of_whole[:2])
        assert torch.equal(of_resumed, of_whole[1:])
    others = seen("other seed", 1, seed=6)
    assert others[0][0, :, 0].tolist() != whole[0, :, 0].tolist()
    assert not set(others[0][..., 1].flatten().tolist()) & set(whole[..., 1].flatten().tolist())
    assert not set(others[1].flatten().tolist()) & set(drawn.flatten().tolist())


@pytest.mark.parametrize(("network", "smoothing"), [("rgcnn", 0.2), ("resnet50", 0.0)])
def test_a_protocol_s_smoothing_reaches_its_trainer(tmp_path, network, smoothing):
    """That of images is the thesis's: none."""
    protocol = Objects("n-mnist", network, smoothing=0.2)
    known = {"recordings": 640, "sensor_size": (34, 34), "classes": 10, "data": {}}
    trainer = protocol.trainer(tmp_path, **known, team=HERE, seed=4)
    assert (trainer.smoothing, trainer.batch, trainer.seed, trainer.epochs) == (smoothing, 64, 4, 400)
