"""Our strict reading of files compared with that of other packages, for `fuzz.py --judges`.

    python tests/judging.py PYTHON FILE...      # what each says of these files

A fault is what two judges find and we don't, or what none of them finds; except where the format leaves room, or a
judge is known to be wrong:

- Times that fall. We sort such events; faery raises times to the latest one before, evutils and expelliarmus take a
  step back as a wrap of the clock. Then only evlib's times are compared, which sorts as well. (`evt3_sample.raw` has
  steps of 11 µs: faery's times are up to 11 µs late, expelliarmus ends 45 ms late, evlib and evutils agree with us.)
- EVT2 and EVT3: a high part of the time that falls. What the clock did is unknown: no times are compared.
- EVT2 and EVT3: events before the first words of time and, of EVT3, row and base of a vector, are at no known time or
  place. We leave them out, others assume 0.
- EVT3: events after a new high part of the time, before its low part. We and faery take 0 for it, others the low part
  of before. expelliarmus counts a low part that falls as a wrap, also if the high part says so already: its times of
  EVT3 aren't compared.
- AEDAT 1 and 2 without the last line of the header, or in which the first record begins as such a line: where
  records begin is open. AEDAT 1 with external events (bit 15), which are no events of pixels: evutils keeps them.
- AEDAT 4 whose header has a damaged position of the table: evlib finds nothing.
- `.dat` without a line of its version: that is version 1, which the others don't know.
- AEDAT 3: packets of special events, and those with another capacity than their number of events, or with a size of
  events of their own: evutils takes these for damaged, or goes by them. AEDAT 3.0: y counts from the bottom, which
  evutils doesn't know.
- What we warn of: events of AEDAT 3 that aren't marked as valid in packets that count them so, which we keep.
"""

from __future__ import annotations

import struct
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
                warnings.simplefilter("error", UserWarning)
                recording = nvsdata.open(path)
                events = recording.read()
                assert isinstance(recording, FileRecording)
                in_order = bool((np.diff(recording.decode().t) >= 0).all())
        except (FormatError, UserWarning):
            return ""
        kind, ours, agree, against = kind_of(path), opinion(*events.columns), 0, {}
        for name, theirs in self.judges.opinions(path).items():
            what = compared(path, kind, name, in_order)
            if what is None or (kind == ".aedat4" and name == "evlib" and not theirs[0]):
                said = "not compared"
            elif ours[what] != theirs[what]:
                said, against[name] = "disagrees", theirs
            else:
                said, agree = "agrees" if what == ALL else "agrees but for times, which leave room", agree + 1
            self.counts[kind, name, said] += 1
        several = Counter(map(tuple, against.values())).most_common(1)
        return f"we read {ours}, others {against}" if against and (several[0][1] > 1 or not agree) else ""

    def report(self) -> str:
        """A line for each kind of file and judge, of how often it agreed."""
        lines = [f"{kind}, {name}: {what} {count:,}" for (kind, name, what), count in sorted(self.counts.items())]
        return "\n".join([*lines, f"crashes of the judges: {self.judges.crashes}"])


def compared(path: Path, kind: str, judge: str, in_order: bool) -> slice | None:
    """What of a judge's opinion must be ours; None if nothing of it."""
    if kind == ".dat" and b"% Version 2\n" not in path.read_bytes()[:400]:
        return None
    if kind == ".aedat3" and not _plain_packets(path.read_bytes()):
        return None
    if kind in (".aedat1", "davis240"):
        _, end, records = path.read_bytes().partition(b"#End Of ASCII Header\r\n")
        external = kind == ".aedat1" and any(byte >= 0x80 for byte in records[::6])
        if not end or records[:1] == b"#" or external:
            return None
    if kind not in ("evt2", "evt3"):
        return ALL if in_order else PLACES
    known, rises, low_follows, low_rises = _words(path, kind)
    if not known:
        return None
    if not rises or (judge == "expelliarmus" and kind == "evt3") or not (low_follows or judge == "faery"):
        return PLACES
    return ALL if (in_order and low_rises) or judge == "evlib" else PLACES


def _plain_packets(raw: bytes) -> bool:
    """Whether a file is of AEDAT 3.1, and all of its packets are as full as they may be."""
    at = raw.find(b"#!END-HEADER\r\n") + 14
    while at + 28 <= len(raw):
        kind, _, size, offset, _, capacity, number, valid = struct.unpack_from("<HHIIIIII", raw, at)
        if kind == 0 or (size, offset) != (8, 4) or not capacity == number == valid:
            return False
        at += 28 + size * number
    return raw.startswith(b"#!AER-DAT3.1")


def _words(path: Path, kind: str) -> tuple[bool, bool, bool, bool]:
    """What leaves no room in a file of EVT2 or EVT3: time and place of all events are known, the high part of the time
    rises, a low part comes between a new high part and the next event, the low part rises.
    """
    raw, at = path.read_bytes(), 0
    while raw[at : at + 2] == b"% ":
        at = raw.find(b"\n", at) + 1 or len(raw)
    size = 4 if kind == "evt2" else 2
    words = np.frombuffer(raw[at : len(raw) - (len(raw) - at) % size], f"<u{size}")
    needed = {0: {8}, 1: {8}} if kind == "evt2" else {2: {0, 6, 8}, 4: {0, 3, 6, 8}, 5: {0, 3, 6, 8}}
    seen: set[int] = set()
    known = rises = low_follows = low_rises = True
    high, low = -1, -1
    for word in words.tolist():
        what = word >> (8 * size - 4)
        if what in needed:
            known &= needed[what] <= seen
            low_follows &= kind == "evt2" or low >= 0
        elif what == 8:
            rises &= word >= high
            low = low if word == high else -1
            high = word
        elif what == 6:
            low_rises &= word >= low
            low = word
        seen.add(what)
    return known, rises, low_follows, low_rises


def main() -> None:
    judging = Judging(sys.argv[1])
    for path in map(Path, sys.argv[2:]):
        print(f"{path}: {judging.fault(path) or 'agreed'}")
    print(judging.report())


if __name__ == "__main__":
    main()
