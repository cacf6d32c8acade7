"""Trainer of classifiers with logs, checkpoints and resumption, in one process or several.

Random numbers depend only on the seed, the epoch and the sample. So a resumed run has the results of an uninterrupted
one, and processes that share the batches (torchrun) train like a single process.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from torch import distributed, nn
from torch.nn.functional import cross_entropy
from torch.nn.parallel import DistributedDataParallel

from nvsdata import models
from nvsdata.common.errors import shown
from nvsdata.common.progress import bar
from nvsdata.common.validation import whole
from nvsdata.datasets.sample_blocks import SampleBlocks
from nvsdata.models.distributed import all_reduce_sum
from nvsdata.training import runs
from nvsdata.training.data import loader
from nvsdata.training.processes import Team

VALIDATION = "validation_accuracy"


class Trainer:
    """Trainer of a classifier by cross entropy.

    After each epoch, a line of JSON is appended to `out/log.jsonl`, and the state is written to `out/checkpoint.pt`.
    `fit` also writes it within an epoch if `checkpoint_every` is given.

    Args:
        model: The network, on the team's device.
        optimizer: Optimizer of its parameters.
        schedule: Learning rate schedule, which steps once per epoch.
        out: Folder of the training, which is created.
        data: Description of the training data (see `data_of`) and protocol. Together with `batch` and `smoothing`, it
            is stored in the checkpoint and in the network. A resumed run must have the same description.
        epochs: Total number of epochs; `done` is the number so far.
        batch: Samples per step, over all processes.
        team: The processes that train together.
        seed: Seed of shuffling, transforms and dropout (default 0).
        smoothing: Label smoothing: fraction of a target's probability that is spread over all classes (default 0.0).
        resume: True to continue from the checkpoint, if there is one (default False).

    Raises:
        ValueError: For a checkpoint of a run with other data or settings.
        FormatError: For a damaged checkpoint.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> import torch
        >>> from nvsdata import training
        >>> model = torch.nn.Linear(2, 3)
        >>> optimizer, schedule = training.adam(model, 2, (60, 110))
        >>> dataset = [(torch.zeros(2), 0), (torch.ones(2), 1)]
        >>> with tempfile.TemporaryDirectory() as folder, training.team("cpu") as team:
        ...     out = Path(folder)
        ...     trainer = training.Trainer(model, optimizer, schedule, out, data={}, epochs=2, batch=2, team=team)
        ...     trainer.fit(dataset)["epoch"]  # doctest: +ELLIPSIS
        batch 2, smoothing 0.0
        epoch 1, ...
        2
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
        smoothing: float = 0.0,
        resume: bool = False,
    ) -> None:
        self.smoothing = smoothing
        self.model, self.optimizer, self.schedule = model, optimizer, schedule
        self.out, self.epochs, self.batch, self.seed, self.team = out, epochs, batch, seed, team
        self.data = data | {"batch": batch, "smoothing": smoothing}
        self.lines: list[dict[str, Any]] = []
        self.best: tuple[int, dict[str, Any]] | None = None  # epoch and weights
        self.within: runs.Within | None = None  # state within an epoch, for the first one after a resumption
        self._watchers: list[Callable[[dict[str, Any]], None]] = []
        out.mkdir(parents=True, exist_ok=True)
        if resume and (out / runs.CHECKPOINT).exists():
            self._restore(runs.Checkpoint.read(out, team.device))
        runs.RESUMABLE[out] = self.done > 0 or self.within is not None
        if team.rank == 0:
            runs.write_log(out, self.lines)
        team.print(", ".join(f"{name} {shown(value)}" for name, value in self.data.items()))

    @property
    def done(self) -> int:
        """Number of epochs so far."""
        return len(self.lines)

    @property
    def parts(self) -> dict[str, Any]:
        """Objects whose state a checkpoint contains."""
        return {"model": self.model, "optimizer": self.optimizer, "schedule": self.schedule}

    def fit(
        self,
        train_set: Any,
        evaluate: Callable[[int], dict[str, Any]] | None = None,
        patience: int | None = None,
        checkpoint_every: int | None = None,
        blocks: SampleBlocks | None = None,
    ) -> dict[str, Any]:
        """Train the network, and select its weights by validation accuracy if `evaluate` returns one.

        Args:
            train_set: Dataset of `(input, target)`.
            evaluate: Function from the number of finished epochs to results, which are added to the line of the epoch
                (default: none). If "validation_accuracy" is among them, the network ends with the weights of the epoch
                with the highest value; of several such epochs, the last.
            patience: Number of epochs without a higher validation accuracy after which training stops (default None:
                never).
            checkpoint_every: Number of steps after which a checkpoint is also written within an epoch (default None:
                only after each epoch). The results of a resumed run are bit-identical with the same number of
                processes; with other numbers, as far as sums in another order are.
            blocks: Blocks of the random order, for slow storage; see `SeededBatches` (default None).

        Returns:
            The line of the epoch that the weights belong to.

        Raises:
            ValueError: If the last batch of an epoch has fewer samples than there are processes, or if the loss becomes
                NaN or infinite. The checkpoint before that remains.
        """
        if checkpoint_every is not None:
            whole("checkpoint_every", checkpoint_every, 1)
        left = len(train_set) % self.batch
        if 0 < left < self.team.count or self.batch < self.team.count:
            raise ValueError(f"the last batch has {left or self.batch} samples for {self.team.count} processes")
        steps = -(-len(train_set) // self.batch)
        if self.within is not None and self.within.step >= steps:
            where = self.out / runs.CHECKPOINT
            raise ValueError(f"{where} belongs to an epoch of more than {self.within.step} steps, not {steps}")
        batches: Iterator[Any] = iter(())
        if self.done < self.epochs:
            # the order of an epoch doesn't depend on where it begins
            done: dict[str, Any] = {
                "first": self.done,
                "last": self.epochs,
                "start": self.within.step if self.within else 0,
            }
            batches = iter(
                loader(train_set, self.batch, self.team, seed=self.seed, **done, shuffle=True, blocks=blocks)
            )
        model: nn.Module = self.model
        if self.team.count > 1:
            model = DistributedDataParallel(self.model, broadcast_buffers=False)
        for epoch in range(self.done, self.epochs):
            if self._out_of(patience):
                break
            line: dict[str, Any] = {"epoch": epoch + 1, "learning_rate": self.schedule.get_last_lr()[0]}
            # dropout masks depend on seed and epoch alone, so a resumed run samples the same ones
            torch.manual_seed(self.seed * 1_000_003 + epoch)
            line |= self._epoch(model, batches, steps, checkpoint_every)
            self._equalize()
            self._check_finite(line["loss"])
            self.schedule.step()
            if evaluate is not None:
                line |= evaluate(epoch + 1)
            # recordings that failed in this process and its workers since the training began
            if damaged := getattr(train_set, "num_damaged", 0):
                line["damaged"] = damaged
            self._save(line)
        if self.best is None:
            return self.lines[-1] if self.lines else {}
        epoch, weights = self.best
        self.model.load_state_dict(weights)
        return self.lines[epoch - 1]

    def _equalize(self) -> None:
        """Copy statistics of layers other than nvsdata's from the first process, whose network is evaluated and saved.

        Each process only has those of its parts of the batches.
        """
        if self.team.count > 1:
            for buffer in self.model.buffers():
                distributed.broadcast(buffer, 0)

    def _check_finite(self, loss: float) -> None:
        """Raise ValueError if the loss or a weight is NaN or infinite, so that no such state is saved."""
        healthy = all(bool(weight.isfinite().all()) for weight in self.model.parameters())
        if not (math.isfinite(loss) and healthy):
            what = "a weight became NaN or infinite" if math.isfinite(loss) else f"the loss became {loss}"
            raise ValueError(f"{what} in epoch {self.done + 1}: try a lower learning rate")

    def _out_of(self, patience: int | None) -> bool:
        """Return True if the last `patience` epochs didn't exceed the best validation accuracy of earlier epochs."""
        found = [line[VALIDATION] for line in self.lines if VALIDATION in line]
        return patience is not None and len(found) > patience and max(found[-patience:]) <= max(found[:-patience])

    def watch(self, see: Callable[[dict[str, Any]], None]) -> None:
        """In the first process, call `see` with the line of each epoch so far, and of each later one when it ends."""
        if self.team.rank == 0:
            for line in self.lines:
                see(line)
        self._watchers.append(see)

    def publish(self, classes: list[str], transform: Any, metrics: dict[str, Any]) -> None:
        """Save the network as `out/model.safetensors`, for `models.load`."""
        if self.team.rank == 0:
            kept = {"classes": classes, "transform": transform, "metrics": metrics, "data": self.data}
            models.save(self.model, self.out / "model.safetensors", **kept)

    def _epoch(
        self, model: nn.Module, batches: Iterator[Any], steps: int, checkpoint_every: int | None
    ) -> dict[str, float]:
        """Train for one epoch or for the rest of one, and return mean loss, accuracy and time."""
        model.train()
        device, start = self.team.device, time.perf_counter()
        sums = torch.zeros(3, dtype=torch.float64, device=device)  # sums of losses, correct predictions and samples
        first = 0
        if self.within is not None:
            first, start = self.within.step, start - self.within.seconds
            if self.team.rank == 0:
                sums += sums.new_tensor(self.within.sums)
            self.within.seed(self.team)
            self.within = None
        title = f"epoch {self.done + 1}/{self.epochs}"
        for step in bar(range(first, steps), title, shown=not self.team.rank, leave=False):
            inputs, targets = next(batches)
            inputs, targets = inputs.to(device), targets.to(device)
            scores = model(inputs)
            loss = cross_entropy(scores, targets, reduction="sum", label_smoothing=self.smoothing)
            # gradients are averaged over processes, so the sum is multiplied by their number, then divided by the batch
            count = all_reduce_sum(torch.tensor(float(len(targets)), device=device))
            self.optimizer.zero_grad()
            (loss * (self.team.count / count)).backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            right = (scores.argmax(1) == targets).sum()
            sums += torch.stack((loss.detach().double(), right.double(), sums.new_tensor(len(targets))))
            if checkpoint_every and (step + 1) % checkpoint_every == 0 and step + 1 < steps:
                so_far = all_reduce_sum(sums.clone())
                self._check_finite(float(so_far[0]))
                self._write(runs.Within.of(step + 1, so_far, time.perf_counter() - start, self.team))
        loss_sum, right, seen = all_reduce_sum(sums).tolist()
        seconds = round(time.perf_counter() - start, 2)
        return {"loss": loss_sum / seen, "train_accuracy": right / seen, "seconds": seconds}

    def _restore(self, state: runs.Checkpoint) -> None:
        where = self.out / runs.CHECKPOINT
        if state.epochs != self.epochs:
            raise ValueError(f"{where} belongs to a run of {state.epochs} epochs, not {self.epochs}")
        for name in self.data.keys() | state.data.keys():
            theirs, ours = state.data.get(name), self.data.get(name)
            if theirs != ours:
                raise ValueError(f"{where} belongs to another run, whose {name} is {theirs}, not {ours}")
        try:
            if state.best is not None:
                runs.restore(self.model, state.best[1])
            for name, part in self.parts.items():
                runs.restore(part, getattr(state, name))
            if state.within is not None:
                # tried here, where an error names the file
                self.within, before = runs.Within(**state.within), torch.get_rng_state()
                self.within.seed(self.team)
                torch.set_rng_state(before)
        except Exception:  # any error for a state of another network or optimizer
            raise ValueError(f"{where} belongs to another network or optimizer") from None
        self.lines, self.best = state.log, state.best

    def _save(self, line: dict[str, Any]) -> None:
        """Write and print an epoch's line, and write its checkpoint."""
        self.lines.append(line)
        if VALIDATION in line and (self.best is None or line[VALIDATION] >= self.lines[self.best[0] - 1][VALIDATION]):
            weights = self.model.state_dict()
            self.best = self.done, {name: value.detach().cpu().clone() for name, value in weights.items()}
        if self.team.rank == 0:
            runs.add_to_log(self.out, line)
        self._write()
        if self.team.rank:
            return
        self.team.print(runs.epoch_text(line))
        for see in self._watchers:
            see(line)

    def _write(self, within: runs.Within | None = None) -> None:
        """Write the checkpoint, in the first process."""
        if self.team.rank == 0:
            states = {name: part.state_dict() for name, part in self.parts.items()}
            kept: dict[str, Any] = {"epochs": self.epochs, "data": self.data, "log": self.lines, "best": self.best}
            inside = None if within is None else vars(within)
            runs.Checkpoint(epoch=self.done, **kept, **states, within=inside).write(self.out)
        runs.RESUMABLE[self.out] = True
