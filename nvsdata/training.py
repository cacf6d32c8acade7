"""What the training recipes share: epochs that log, checkpoint and resume, alone or in several processes.

Every draw depends on the seed, the epoch and the sample, so a resumed run is the same as one that wasn't
stopped, and processes that share the batches (torchrun) train as one process does.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch
from torch import distributed, nn
from torch.nn.functional import cross_entropy
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader
from tqdm import tqdm

from nvsdata import models, runs
from nvsdata.common.files import claimed
from nvsdata.common.processes import end_with_parent
from nvsdata.common.signals import ENDING, end_of, ending_by_signals, exit_code
from nvsdata.data.batching import collate
from nvsdata.datasets import ASLANDVS, EventFolder, SeededBatches, SeededDataset, dataset_named, stratified
from nvsdata.models.shared import total


def run(main: Callable[[], None], hint: str = "--resume goes on from the last epoch") -> None:
    """Call a recipe's `main`; end in one line if it is interrupted, or if data or settings won't do.

    `hint` tells who interrupted it how to go on.
    """
    try:
        with ending_by_signals():
            main()
    except KeyboardInterrupt as error:
        print(f"{end_of(error)}: {hint}", file=sys.stderr)
        sys.exit(exit_code(error))
    except (OSError, ValueError) as error:
        text = str(error)
        # a loader's worker sends its traceback, whose last line tells
        if text.startswith("Caught "):
            text = text.rstrip().splitlines()[-1].partition(": ")[2]
        sys.exit(f"{Path(sys.argv[0]).name}: {text}")


@dataclass(frozen=True)
class Team:
    """The processes that train together, seen from one of them. Rank 0 writes and prints."""

    device: torch.device
    rank: int = 0
    count: int = 1

    @property
    def workers(self) -> int:
        """Processes that prepare samples; they and torch's threads share the cores."""
        return max(1, min(4, (os.cpu_count() or 2) // (2 * self.count)))

    def wait(self) -> None:
        """Until all have come here."""
        if self.count > 1:
            distributed.barrier()

    @contextmanager
    def claiming(self, out: Path) -> Iterator[None]:
        """Make the folder `out` and write to it alone while the block runs; what killed runs left there is swept.

        Raises OutputInUse if another run writes to it.
        """
        if self.rank:
            yield
            return
        out.mkdir(parents=True, exist_ok=True)
        with claimed(out):
            yield

    def say(self, text: str) -> None:
        """Print, once for all."""
        if self.rank == 0:
            print(text, flush=True)


@contextmanager
def team(device: str | None = None) -> Iterator[Team]:
    """Join the processes that torchrun started, or be alone. Without `device` a GPU if there is one, else the CPU."""
    name = device or ("cuda" if torch.cuda.is_available() else "cpu")
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        alone = Team(torch.device(name))
        torch.set_num_threads(max(1, (os.cpu_count() or 2) - alone.workers))
        yield alone
        return
    if name == "cuda":
        name = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
        torch.cuda.set_device(name)
    distributed.init_process_group("nccl" if name.startswith("cuda") else "gloo")
    try:
        yield Team(torch.device(name), distributed.get_rank(), count)
    finally:
        distributed.destroy_process_group()


def loader(
    dataset: Any,
    batch: int,
    team: Team,
    *,
    seed: int = 0,
    first: int = 0,
    last: int = 1,
    shuffle: bool = False,
) -> DataLoader[Any]:
    """This process's share of the seeded batches of the epochs first..last (excluded)."""
    seeded = SeededDataset(dataset, seed)
    seeded[0, 0]  # compiles the kernels once, before workers are forked
    part = team.rank, team.count
    batches = SeededBatches(len(dataset), batch, first=first, last=last, shuffle=shuffle, seed=seed, part=part)
    return DataLoader(
        seeded,
        batch_sampler=batches,
        num_workers=team.workers,
        collate_fn=collate,
        persistent_workers=True,
        worker_init_fn=_begin_worker,
    )


def _begin_worker(_: int) -> None:
    # or what a killed training left would go on, and hold its folder
    end_with_parent()
    for number in ENDING:
        # the loader ends its workers so, and no handler of Python's runs within a kernel
        signal.signal(number, signal.SIG_DFL)


class Halves:
    """A dataset's recordings for training and for testing.

    By its own split; where it has none, a fifth of each class is held back, by `seed`. `errors` says what becomes of
    damaged recordings, as for datasets. ValueError for pairs.
    """

    def __init__(self, name: str, root: Path, *, fold: int | None = None, seed: int = 0, errors: str = "raise") -> None:
        kind: Any = dataset_named(name)
        if issubclass(kind, ASLANDVS):
            raise ValueError(f"{name} is of pairs of recordings, not of classes: see recipes/similarity_aslan.py")
        try:
            self._train, self._test = (kind(root, split, fold=fold, errors=errors) for split in ("train", "test"))
        except FileNotFoundError:
            split = "all" if kind is EventFolder else "train"
            whole = kind(root, split, fold=fold, errors=errors)
            self._train, self._test = map(whole.subset, stratified(whole.names, 0.2, seed=seed))
        self.classes: list[str] = self._train.classes
        self.sensor_size: tuple[int, int] = self._train.sensor_size or (240, 180)
        self.data = data_of(self._train, self._test, seed)

    def train(self, transform: Any) -> Any:
        """The dataset to train on."""
        return _with(self._train, transform)

    def test(self, transform: Any) -> Any:
        """The dataset to test on."""
        return _with(self._test, transform)


def _with(dataset: Any, transform: Any) -> Any:
    """The dataset, listed once, with another transform."""
    changed = copy(dataset)
    changed.transform = transform
    return changed


def data_of(train: Any, test: Any, seed: int) -> dict[str, Any]:
    """What is trained and tested on, for `Trainer`: dataset, split, fold, the run's seed, hashes of both sets."""
    hashes = {"hash": train.split_hash, "test_hash": test.split_hash}
    return {"dataset": train.info.name, "split": train.split, "fold": train.fold, "seed": seed, **hashes}


class Trainer:
    """Trains a classifier by cross entropy, a JSON line an epoch in `out/log.jsonl` and its state in `checkpoint.pt`.

    `schedule` steps once an epoch. `batch` counts over all processes. `data` (of `data_of`) is kept with checkpoint
    and model. With `resume` it goes on from the checkpoint, if there is one; `done` is the number of epochs so far.
    ValueError for a checkpoint of another run or of other data, FormatError for a damaged one.
    """

    def __init__(
        self,
        model: nn.Module,
        optimizer: torch.optim.Optimizer,
        schedule: Any,
        out: Path,
        *,
        data: dict[str, Any],
        epochs: int,
        batch: int,
        team: Team,
        seed: int = 0,
        resume: bool = False,
    ) -> None:
        self.model, self.optimizer, self.schedule = model, optimizer, schedule
        self.out, self.epochs, self.batch, self.seed, self.team = out, epochs, batch, seed, team
        self.data = data
        self.lines: list[dict[str, Any]] = []
        out.mkdir(parents=True, exist_ok=True)
        if resume and (out / runs.CHECKPOINT).exists():
            self._restore(runs.Checkpoint.read(out, team.device))
        if team.rank == 0:
            runs.write_log(out, self.lines)
        team.say(", ".join(f"{name} {value}" for name, value in data.items()))

    @property
    def done(self) -> int:
        """Epochs so far."""
        return len(self.lines)

    @property
    def parts(self) -> dict[str, Any]:
        """What a checkpoint holds the state of."""
        return {"model": self.model, "optimizer": self.optimizer, "schedule": self.schedule}

    def fit(self, train_set: Any, evaluate: Callable[[int], dict[str, Any]]) -> dict[str, Any]:
        """Train on `train_set`, whose samples are `(input, target)`; the last epoch's line.

        `evaluate` is given the number of epochs done, after each, and what it says goes into the line.
        ValueError if the last batch of an epoch has fewer samples than there are processes, or the loss becomes NaN or
        infinite: then the checkpoint is the last one before.
        """
        left = len(train_set) % self.batch
        if 0 < left < self.team.count or self.batch < self.team.count:
            raise ValueError(f"the last batch has {left or self.batch} samples for {self.team.count} processes")
        steps = -(-len(train_set) // self.batch)
        batches: Iterator[Any] = iter(())
        if self.done < self.epochs:
            shared = loader(
                train_set, self.batch, self.team, seed=self.seed, first=self.done, last=self.epochs, shuffle=True
            )
            batches = iter(shared)
        model: nn.Module = self.model
        if self.team.count > 1:
            model = DistributedDataParallel(self.model, broadcast_buffers=False)
        for epoch in range(self.done, self.epochs):
            start = time.perf_counter()
            line: dict[str, Any] = {"epoch": epoch + 1, "learning_rate": self.schedule.get_last_lr()[0]}
            # what dropout draws depends on the epoch alone, so that a resumed run draws the same
            torch.manual_seed(self.seed * 1_000_003 + epoch)
            line |= self._epoch(model, batches, steps, f"epoch {epoch + 1}/{self.epochs}")
            if not math.isfinite(line["loss"]):
                raise ValueError(f"the loss became {line['loss']} in epoch {epoch + 1}: try a lower learning rate")
            self.schedule.step()
            line["seconds"] = round(time.perf_counter() - start, 2)
            line |= evaluate(epoch + 1)
            # what this process and its workers met since training began
            if damaged := getattr(train_set, "num_damaged", 0):
                line["damaged"] = damaged
            self._save(line)
        return self.lines[-1] if self.lines else {}

    def publish(self, classes: list[str], transform: Any, metrics: dict[str, Any]) -> None:
        """Keep the network in `out/model.safetensors`, for `models.load`."""
        if self.team.rank == 0:
            kept = {"classes": classes, "transform": transform, "metrics": metrics, "data": self.data}
            models.save(self.model, self.out / "model.safetensors", **kept)

    def _epoch(self, model: nn.Module, batches: Iterator[Any], steps: int, title: str) -> dict[str, float]:
        """One pass over the training set: mean loss and accuracy."""
        model.train()
        device = self.team.device
        sums = torch.zeros(3, dtype=torch.float64, device=device)  # loss, right, seen
        for _ in tqdm(range(steps), title, leave=False, disable=True if self.team.rank else None):
            inputs, targets = next(batches)
            inputs, targets = inputs.to(device), targets.to(device)
            scores = model(inputs)
            loss = cross_entropy(scores, targets, reduction="sum")
            # gradients are averaged over the processes: of a sum, times their number, over the whole batch
            count = total(torch.tensor(float(len(targets)), device=device))
            self.optimizer.zero_grad()
            (loss * (self.team.count / count)).backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            right = (scores.argmax(1) == targets).sum()
            sums += torch.stack((loss.detach().double(), right.double(), sums.new_tensor(len(targets))))
        loss_sum, right, seen = total(sums).tolist()
        return {"loss": loss_sum / seen, "train_accuracy": right / seen}

    def _restore(self, state: runs.Checkpoint) -> None:
        where = self.out / runs.CHECKPOINT
        if state.epochs != self.epochs:
            raise ValueError(f"{where} belongs to a run of {state.epochs} epochs, not {self.epochs}")
        for name in self.data.keys() | state.data.keys():
            theirs, ours = state.data.get(name), self.data.get(name)
            if theirs != ours:
                raise ValueError(f"{where} belongs to a run of other data: its {name} is {theirs}, not {ours}")
        try:
            for name, part in self.parts.items():
                runs.restore(part, getattr(state, name))
        except Exception:  # whatever they make of another's
            raise ValueError(f"{where} belongs to another network or optimizer") from None
        self.lines = state.log

    def _save(self, line: dict[str, Any]) -> None:
        """Write and print an epoch's line, and write its checkpoint."""
        self.lines.append(line)
        if self.team.rank:
            return
        runs.add_to_log(self.out, line)
        states = {name: part.state_dict() for name, part in self.parts.items()}
        runs.Checkpoint(epoch=self.done, epochs=self.epochs, data=self.data, log=self.lines, **states).write(self.out)
        self.team.say(json.dumps(line))


@torch.no_grad()
def outputs(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], team: Team
) -> tuple[torch.Tensor, torch.Tensor]:
    """What a model gives for all batches, in order: [N, ...] and targets [N], the same in all processes."""
    if isinstance(model, nn.Module):
        model.eval()
    mine = [(model(inputs.to(team.device)).cpu(), targets) for inputs, targets in batches]
    everyone: list[Any] = [mine]
    if team.count > 1:
        everyone = [None] * team.count
        distributed.all_gather_object(everyone, mine)
    # a batch's shares lie in order of rank; the last batch may have none for some
    pairs = [pair for shares in zip_longest(*everyone) for pair in shares if pair is not None]
    return torch.cat([given for given, _ in pairs]), torch.cat([targets for _, targets in pairs])


def accuracies(
    model: Callable[[Any], torch.Tensor], batches: DataLoader[Any], windows: int, team: Team, rounds: int = 1
) -> tuple[float, float]:
    """Accuracy of one window (mean over all), and of the `windows` windows of a recording together.

    A vote adds up log-probabilities. The batches hold every recording once, then again, and so on, for `rounds`
    times `windows`; every round votes anew.
    """
    scores, targets = outputs(model, batches, team)
    voters = scores.log_softmax(1).view(rounds, windows, -1, scores.shape[1])
    wanted = targets.chunk(rounds * windows)[0]

    def share(named: torch.Tensor) -> float:
        # NaN names no class, although argmax gives one
        right = (named.argmax(-1) == wanted) & ~named.isnan().any(-1)
        return right.double().mean().item()

    return share(voters), share(voters.sum(1))


def sgd(
    model: nn.Module, rate: float, every: int, epochs: int, *, decay: float = 0.0
) -> tuple[torch.optim.Optimizer, Any]:
    """Gradient descent with momentum 0.9, its rate decayed tenfold `every` so many epochs, and weight decay."""
    optimizer = torch.optim.SGD(model.parameters(), lr=rate, momentum=0.9, weight_decay=decay)
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, list(range(every, epochs, every)))


def adam(model: nn.Module, epochs: int, milestones: tuple[int, int]) -> tuple[torch.optim.Optimizer, Any]:
    """Adam with a rate of 1e-3, decayed tenfold at `milestones` out of 150, stretched to `epochs`."""
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    at = [round(epochs * milestone / 150) for milestone in milestones]
    return optimizer, torch.optim.lr_scheduler.MultiStepLR(optimizer, at)
