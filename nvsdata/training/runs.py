"""Files of a training run (checkpoint, log, TensorBoard), and the handling of its errors and interrupts."""

from __future__ import annotations

import io
import json
import math
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import torch
from torch import distributed
from torch.optim import Optimizer

from nvsdata.common.errors import FormatError, line_of, message_of
from nvsdata.common.files import append_own, json_line, named, put, write_all
from nvsdata.common.signals import end_of, ending_by_signals, exit_code
from nvsdata.common.terminal import escaped_output
from nvsdata.training.processes import ProcessFailed, Team

CHECKPOINT, LOG, TENSORBOARD = "checkpoint.pt", "log.jsonl", "tensorboard"
# whether each training of this process, by folder, has a checkpoint from which a later run can resume
RESUMABLE: dict[Path, bool] = {}


@dataclass(frozen=True)
class Within:
    """Training within an epoch.

    `step` is the number of steps so far, `sums` are the sums of losses, correct predictions and samples, and `seconds`
    is the time so far. `generators` has the states of torch's generators (CPU, and GPU if there is one) of each
    process.
    """

    step: int
    sums: tuple[float, float, float]
    seconds: float
    generators: list[list[torch.Tensor]]

    def __post_init__(self) -> None:
        numbers = (*self.sums, self.seconds)
        if len(numbers) != 4 or not all(type(n) is float and math.isfinite(n) and n >= 0 for n in numbers):
            raise ValueError("sums or seconds within an epoch are no positive numbers")
        if type(self.step) is not int or self.step < 1 or not self.sums[1] <= self.sums[2] or self.sums[2] == 0:
            raise ValueError(f"step is {self.step!r:.20}, with {self.sums[1]} of {self.sums[2]} samples correct")
        states = [state for of_one in self.generators for state in of_one]
        if not states or any(state.dtype != torch.uint8 or state.ndim != 1 for state in states):
            raise ValueError("the states of random number generators have wrong types")

    @classmethod
    def of(cls, step: int, sums: torch.Tensor, seconds: float, team: Team) -> Self:
        """Describe the training now. All processes must call it."""
        mine = [torch.get_rng_state()]
        if sums.is_cuda:
            mine.append(torch.cuda.get_rng_state(sums.device))
        everyone: list[Any] = [mine]
        if team.count > 1:
            everyone = [None] * team.count
            distributed.all_gather_object(everyone, mine)
        loss, right, seen = sums.tolist()
        return cls(step, (loss, right, seen), seconds, everyone)

    def seed(self, team: Team) -> None:
        """Continue this process's random numbers; if there are more processes than before, those of the first one."""
        cpu, *gpu = self.generators[team.rank if team.rank < len(self.generators) else 0]
        torch.set_rng_state(cpu.cpu())
        if gpu and team.device.type == "cuda":
            torch.cuda.set_rng_state(gpu[0].cpu(), team.device)


@dataclass(frozen=True)
class Checkpoint:
    """Training after `epoch` of `epochs` epochs, or within the next one.

    `data` describes the training data, `log` has the line of each epoch so far, `best` is the number and network of the
    epoch with the highest validation accuracy, `within` has the fields of `Within` (None after an epoch), and the other
    fields are states of the network, optimizer and schedule.
    """

    epoch: int
    epochs: int
    data: dict[str, Any]
    log: list[dict[str, Any]]
    model: dict[str, Any]
    optimizer: dict[str, Any]
    schedule: dict[str, Any]
    best: tuple[int, dict[str, Any]] | None = None
    within: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        counts, dicts = (self.epoch, self.epochs), (self.data, self.model, self.optimizer, self.schedule)
        if not (all(type(count) is int for count in counts) and 0 <= self.epoch <= self.epochs):
            raise ValueError(f"epoch is {self.epoch!r:.20}, of {self.epochs!r:.20} epochs")
        if not (isinstance(self.log, list) and all(isinstance(part, dict) for part in (*dicts, *self.log))):
            raise ValueError("fields have wrong types")
        if len(self.log) != self.epoch:
            raise ValueError(f"log has {len(self.log)} lines for {self.epoch} epochs")
        if self.best is not None and not 1 <= self.best[0] <= self.epoch:
            raise ValueError(f"best epoch is {self.best[0]!r:.20}, of {self.epoch} epochs")
        if self.within is not None:
            Within(**self.within)
        json.dumps((self.data, self.log))  # TypeError if they contain what JSON can't represent

    def write(self, out: Path) -> None:
        """Replace the previous checkpoint. OSError if the disk is full; the previous one remains then."""
        # for a full disk, torch's own writer raises an unrelated error
        whole = io.BytesIO()
        torch.save(vars(self), whole)
        with whole.getbuffer() as content:
            put(out / CHECKPOINT, content)

    @classmethod
    def read(cls, out: Path, device: torch.device) -> Self:
        """Load a run's checkpoint. FormatError for a file that is damaged or isn't a checkpoint."""
        path = out / CHECKPOINT
        try:
            # torch doesn't verify the checksums
            with zipfile.ZipFile(path) as archive:
                if bad := archive.testzip():
                    raise ValueError(f"the checksum of {bad} differs")
            return cls(**torch.load(path, map_location=device, weights_only=True))
        except Exception as error:  # zipfile, torch and pickle raise many kinds of errors
            raise FormatError(path, f"is not a checkpoint of a training, or is damaged: {line_of(error)}") from None


def restore(part: Any, state: dict[str, Any]) -> None:
    """Restore the state of a network, optimizer or schedule from a file. ValueError for a state that doesn't fit.

    torch checks names and sizes of a network's weights, but accepts any state of optimizers and schedules.
    """
    mine = part.state_dict()
    if isinstance(part, Optimizer):
        # the optimizer itself has no state for its weights yet
        kept, weights = state.get("state"), [weight for group in part.param_groups for weight in group["params"]]
        if not _fits(kept, weights) or not _alike(state, mine | {"state": kept}):
            raise ValueError("the state is that of another optimizer")
    elif not _alike(state, mine):
        raise ValueError("the state is that of another network or schedule")
    part.load_state_dict(state)


def _fits(kept: Any, weights: list[torch.Tensor]) -> bool:
    """Return True if a saved optimizer state fits its weights in number, names and sizes."""
    if not isinstance(kept, dict) or not all(n in range(len(weights)) and isinstance(kept[n], dict) for n in kept):
        return False
    pairs = [(value, weights[n]) for n, of_one in kept.items() for value in of_one.values()]
    if not all(isinstance(v, torch.Tensor) and v.shape in ((), w.shape) for v, w in pairs):
        return False
    return len({frozenset((name, v.ndim == 0) for name, v in of_one.items()) for of_one in kept.values()}) <= 1


def _alike(a: Any, b: Any) -> bool:
    """Return True if two states have the same names, lengths, sizes and types, regardless of their values."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_alike(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple) and type(a) is type(b):
        return len(a) == len(b) and all(map(_alike, a, b))
    if isinstance(a, torch.Tensor) and isinstance(b, torch.Tensor):
        return a.shape == b.shape and a.dtype == b.dtype
    return type(a) is type(b)


def write_log(out: Path, lines: list[dict[str, Any]]) -> None:
    """Write the log of a checkpoint. Later or incomplete lines, which a kill or a full disk left, are removed."""
    put(out / LOG, "".join(map(json_line, lines)).encode())


def epoch_text(line: dict[str, Any]) -> str:
    """Return the log's line of an epoch as text for the terminal.

    Example:
        >>> epoch_text({"epoch": 3, "loss": 0.51234, "train_accuracy": 0.75})
        'epoch 3, loss 0.5123, train accuracy 0.75'
    """
    values = {name: _short(value) if isinstance(value, float) else value for name, value in line.items()}
    return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())


def _short(value: float) -> str:
    return f"{value:.4g}" if abs(value) < 1_000 else f"{value:.0f}"


def add_to_log(out: Path, line: dict[str, Any]) -> None:
    """Append the line of an epoch to the log."""
    with named(out / LOG), append_own(out / LOG) as log:
        write_all(log.fileno(), json_line(line).encode())


def to_tensorboard(out: Path, team: Team) -> Callable[[dict[str, Any]], None]:
    """Return a function for `Trainer.watch` that writes the numbers of each epoch to `out/tensorboard` as scalars.

    TensorBoard no longer shows values of earlier runs in that folder.

    Args:
        out: Folder of the training.
        team: The processes that train together; the first one writes.

    Returns:
        The function, which takes the line of an epoch.

    Raises:
        ImportError: Without `nvsdata[tensorboard]`.

    Example:
        >>> trainer.watch(training.to_tensorboard(out, team))  # doctest: +SKIP
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise ImportError("--tensorboard needs the package: pip install 'nvsdata[tensorboard]'") from None
    if team.rank:
        return lambda line: None  # the trainer calls it in the first process only
    # all epochs so far are written again, so TensorBoard must drop those of earlier runs
    writer = SummaryWriter(str(out / TENSORBOARD), purge_step=1)

    def see(line: dict[str, Any]) -> None:
        for name, value in line.items():
            if name != "epoch":
                writer.add_scalar(name, value, line["epoch"])
        # otherwise, a killed process would lose the last epochs
        writer.flush()

    return see


def run(main: Callable[[], None], hint: str | None = None) -> None:
    """Call the `main` of a recipe, and end with a message of one line if it is interrupted or raises certain errors.

    Args:
        main: The function.
        hint: Message about the continuation after an interrupt (default None: `--resume`, if there is a
            checkpoint).

    Raises:
        SystemExit: After an interrupt, OSError, ValueError or ImportError, such as for invalid data or settings, and
            after an error of another process.

    Example:
        >>> from nvsdata import training
        >>> training.run(lambda: print("trained"))
        trained
    """
    try:
        with ending_by_signals(), escaped_output():
            main()
    except KeyboardInterrupt as error:
        hint = _hint() if hint is None else hint
        print(f"{end_of(error)}: {hint}" if hint else end_of(error), file=sys.stderr)
        sys.exit(exit_code(error))
    except (OSError, ValueError, ImportError, ProcessFailed) as error:
        sys.exit(f"{Path(sys.argv[0]).name}: {message_of(error)}")


def _hint() -> str:
    """Return a message about the continuation from the checkpoints that this process has written."""
    if any(RESUMABLE.values()):
        return "--resume continues from the last checkpoint"
    return "no checkpoint was written, so there is nothing to continue from" if RESUMABLE else ""
