"""Other packages' decoders of the same files, for `fuzz.py --judges`: a process of its own, because some of them crash.

    python tests/judges.py      # reads paths from stdin, answers each with a line of JSON

Decoders that aren't installed, refuse the file or crash have no opinion. The packages are aedat, evlib, evutils,
expelliarmus and faery; `--judges PYTHON` names an environment that has them.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

LIMIT_S = 20.0  # for the opinions of all decoders on one file


def _aedat(path: str) -> Any:
    import aedat

    packets = [packet["events"] for packet in aedat.Decoder(path) if "events" in packet]
    return np.concatenate(packets) if packets else None


def _evlib(path: str) -> Any:
    import evlib

    frame = evlib.load_events(path, sort=False).collect()
    return {"t": frame["t"].cast(int), "x": frame["x"], "y": frame["y"], "p": frame["polarity"] > 0}


def _evutils(path: str) -> Any:
    from evutils.io import EventReader

    found = EventReader(path, mode="all", index=False).read()
    return {name: np.asarray(getattr(found, name)) for name in "txyp"}


def _mirrored(width: int, height: int, *, inverted: bool = False) -> Callable[[str], Any]:
    """As evutils reads AEDAT: places as jAER counts them, from the lower right, and a DVS128's polarity as stored."""

    def run(path: str) -> Any:
        found = {name: column.astype(np.int64) for name, column in _evutils(path).items()}
        p = 1 - found["p"] if inverted else found["p"]
        return {"t": found["t"], "x": width - 1 - found["x"], "y": height - 1 - found["y"], "p": p}

    return run


def _expelliarmus(kind: str) -> Callable[[str], Any]:
    def run(path: str) -> Any:
        from expelliarmus import Wizard

        return Wizard(kind).read(path)

    return run


def _faery(path: str) -> Any:
    import faery

    return faery.events_stream_from_file(path).to_array()


JUDGES: dict[str, dict[str, Callable[[str], Any]]] = {
    ".dat": {"evutils": _evutils, "expelliarmus": _expelliarmus("dat")},
    "evt2": {"evlib": _evlib, "evutils": _evutils, "faery": _faery, "expelliarmus": _expelliarmus("evt2")},
    "evt21": {"evlib": _evlib, "evutils": _evutils, "faery": _faery},
    "evt3": {"evlib": _evlib, "evutils": _evutils, "faery": _faery, "expelliarmus": _expelliarmus("evt3")},
    ".aedat4": {"aedat": _aedat, "faery": _faery, "evlib": _evlib},
    "davis240": {"evutils": _mirrored(240, 180)},
    ".aedat1": {"evutils": _mirrored(128, 128, inverted=True)},
    ".aedat3": {"evutils": _evutils},
}
NAMES = {"t": ("t", "ts", "timestamp"), "x": ("x",), "y": ("y",), "p": ("p", "on", "polarity")}


def kind_of(path: Path) -> str:
    """The key of `JUDGES` for a file: its extension or, where that isn't enough, what its header says."""
    head = path.read_bytes()[:400]
    if path.suffix == ".aedat":
        # evutils reads all of AEDAT 2 as DAVIS, also a DVS128's
        is_davis = head.startswith(b"#!AER-DAT2.0") and b"DAVIS240C" in head
        return ".aedat3" if head.startswith(b"#!AER-DAT3") else "davis240" if is_davis else ""
    if path.suffix != ".raw":
        return path.suffix
    # of a header that is damaged, each makes something else
    for kind, line in (("evt2", b"% evt 2.0\n"), ("evt21", b"% evt 2.1\n"), ("evt3", b"% evt 3.0\n")):
        if line in head:
            return kind
    return ""


def opinion(t: Any, x: Any, y: Any, p: Any) -> list[Any]:
    """The number of events, and two fingerprints: of all columns, and of x, y and p; the order of the events, such as
    of those of one time, has no influence.
    """
    columns = [np.asarray(column).astype(np.int64) for column in (t, x, y, p)]
    prints = []
    for some in (columns, columns[1:]):
        order = np.lexsort(some[::-1])
        prints.append(hashlib.sha256(np.stack(some)[:, order].tobytes()).hexdigest()[:16])
    return [len(columns[0]), *prints]


def opinions(path: str) -> dict[str, list[Any]]:
    """The `opinion` of each decoder that takes the file."""
    found = {}
    for name, run in JUDGES.get(kind_of(Path(path)), {}).items():
        # Rust's panics aren't Exceptions
        with contextlib.suppress(BaseException):
            events = run(path)
            keys = events if isinstance(events, dict) else events.dtype.names
            found[name] = opinion(*(events[next(k for k in keys if k in NAMES[c])] for c in "txyp"))
    return found


class Judges:
    """The process that decodes; it is started again after a crash.

    - `python`: the interpreter of an environment with the packages
    """

    def __init__(self, python: str) -> None:
        self.python = python
        self.crashes = 0
        self._process: subprocess.Popen[bytes] | None = None

    def opinions(self, path: Path) -> dict[str, list[Any]]:
        """Those on the file; none if the process crashes or hangs."""
        if self._process is None or self._process.poll() is not None:
            pipe = subprocess.PIPE
            self._process = subprocess.Popen(
                [self.python, __file__], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(f"{path}\n".encode())
            self._process.stdin.flush()
            if select.select([self._process.stdout], [], [], LIMIT_S)[0]:
                line = self._process.stdout.readline()
                if line:
                    return dict(json.loads(line))
        self._process.kill()
        self._process.wait()
        self.crashes += 1
        return {}


def main() -> None:
    # what decoders print must not mix with the answers
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin:
        try:
            answer = opinions(line.rstrip("\n"))
        except BaseException:
            # Rust's panics aren't Exceptions
            answer = {}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
