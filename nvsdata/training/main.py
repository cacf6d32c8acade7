"""The end of a recipe's command line: in one line, whatever ended it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from nvsdata.common.errors import shown
from nvsdata.common.signals import end_of, ending_by_signals, exit_code
from nvsdata.common.terminal import escaped_output
from nvsdata.training.runs import FINISHED


def run(main: Callable[[], None], hint: str | None = None) -> None:
    """Call a recipe's `main`; end in one line if it is interrupted, or if data or settings won't do.

    `hint` says how to continue after an interrupt (default: that `--resume` does, if an epoch of a `Trainer` was
    finished).
    """
    try:
        with ending_by_signals(), escaped_output():
            main()
    except KeyboardInterrupt as error:
        hint = _hint() if hint is None else hint
        print(f"{end_of(error)}: {hint}" if hint else end_of(error), file=sys.stderr)
        sys.exit(exit_code(error))
    except (OSError, ValueError, ImportError) as error:
        text = str(error)
        # a loader's worker sends its traceback, whose last line tells
        if text.startswith("Caught "):
            text = text.rstrip().splitlines()[-1].partition(": ")[2]
        sys.exit(f"{Path(sys.argv[0]).name}: {shown(text)}")


def _hint() -> str:
    """Return how to continue, by the checkpoints that this process has written."""
    if any(FINISHED.values()):
        return "--resume continues from the last epoch"
    return "no epoch was finished, so that there is nothing to continue from" if FINISHED else ""
