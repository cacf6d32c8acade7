"""A training's log in TensorBoard."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from nvsdata.training.processes import Team

FOLDER = "tensorboard"


def to_tensorboard(out: Path, team: Team) -> Callable[[dict[str, Any]], None]:
    """Return a function for `Trainer.watch` that writes a log to `out/tensorboard`: numbers are scalars of epochs.

    - `out`: the training's folder
    - `team`: the processes that train together, of which the first one writes

    What earlier runs wrote there is no longer shown. ImportError without `nvsdata[tensorboard]`.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise ImportError("--tensorboard needs the package: pip install 'nvsdata[tensorboard]'") from None
    if team.rank:
        return lambda line: None  # the trainer doesn't call it there
    # every epoch so far comes again: TensorBoard drops those that it got before
    writer = SummaryWriter(str(out / FOLDER), purge_step=1)

    def see(line: dict[str, Any]) -> None:
        for name, value in line.items():
            if name != "epoch":
                writer.add_scalar(name, value, line["epoch"])
        # or the last epochs would be lost to a kill
        writer.flush()

    return see
