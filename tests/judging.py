"""Our strict reading of files compared with that of other packages, for `fuzz.py --judges`.

    python tests/judging.py PYTHON FILE...      # what each says of these files

All must find the same events, except where the format leaves room, or a judge is known to be wrong:

- Times that fall. We sort such events; faery raises times to the latest one before, evutils and expelliarmus take a
  step back as a wrap of the clock (`data/samples/evt3_sample.raw` has steps of 11 µs: expelliarmus ends 45 ms late, evlib
  and evutils agree with us). Then only evlib's times are compared, which sorts as well.
- EVT2 and EVT3: events before the first words of time, and of EVT3 before the first row, are at no known time or place.
  We and evlib leave them out, others assume 0.
- EVT3: events after a new high part of the time, before its low part. We and faery take 0 for it, others the low part
  of before.
- AEDAT 3.1 in which no event is marked as valid: we take all of them, evutils none.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from judges import JUDGES, Judges, kind_of, opinion

import nvsdata
from nvsdata import FormatError
from nvsdata.formats.file_recording import FileRecording

ALL, PLACES = slice(0, 3), slice(0, 3, 2)  # of an opinion: what is compared


class Judging:
    """Counts what the judges say; see `judges.py`."""

    suffixes = (*(kind for kind in JUDGES if kind.startswith(".")), ".raw", ".aedat")

    def __init__(self, python: str) -> None:
        self.judges = Judges(python)
        self.counts: Counter[tuple[str, str, str]] = Counter()

    def fault(self, path: Path) -> str:
        """What judges found otherwise than we did, and no exception explains."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                recording = nvsdata.open(path)
                events = recording.read()
                assert isinstance(recording, FileRecording)
                in_order = bool((np.diff(recording.decode().t) >= 0).all())
        except FormatError:
            return ""
        kind = kind_of(path)
        ours = opinion(*events.columns)
        against = {}
        for name, theirs in self.judges.opinions(path).items():
            what = compared(path, kind, name, in_order)
            agrees = what is not None and ours[what] == theirs[what]
            said = "not compared" if what is None else "against" if not agrees else "agrees" if what == ALL else "agrees on all but times"
            self.counts[kind, name, said] += 1
            if said == "against":
                against[name] = theirs
        return f"we read {ours}, {against}" if against else ""

    def report(self) -> str:
        """A line for each kind of file and judge, of how often it agreed."""
        lines = [f"{kind}, {name}: {what} {count:,}" for (kind, name, what), count in sorted(self.counts.items())]
        return "\n".join([*lines, f"crashes of the judges: {self.judges.crashes}"])


def compared(path: Path, kind: str, judge: str, in_order: bool) -> slice | None:
    """What of a judge's opinion must be ours; None if nothing of it."""
    begins, whole = True, True
    if kind in ("evt2", "evt3"):
        begins, whole = _told_times(path, kind)
    if not begins and judge != "evlib":
        return None
    if not whole and judge != "faery":
        return PLACES
    return ALL if in_order or judge == "evlib" else PLACES


def _told_times(path: Path, kind: str) -> tuple[bool, bool]:
    """Whether words of time (and row) come before the first event, and of EVT3 a low part after each new high part."""
    raw = path.read_bytes()
    at = 0
    while raw[at : at + 2] == b"% ":
        at = raw.find(b"\n", at) + 1 or len(raw)
    size = 4 if kind == "evt2" else 2
    words = np.frombuffer(raw[at : len(raw) - (len(raw) - at) % size], f"<u{size}")
    seen = {8} if kind == "evt2" else {0, 6, 8}
    known: set[int] = set()
    begins, whole, high, fresh = True, True, -1, False
    for word in words.tolist():
        what = word >> (8 * size - 4)
        if what in seen:
            known.add(what)
            if what == 8 and word != high:
                high, fresh = word, True
            elif what == 6:
                fresh = False
        elif what in ((0, 1) if kind == "evt2" else (2, 4, 5)):
            begins &= known == seen
            whole &= kind == "evt2" or not fresh
    return begins, whole
