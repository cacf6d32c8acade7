"""Random damage to files of every format, for as long as you like; not part of the suite.

    python tests/fuzz.py --minutes 10 --seed 0

Each round damages a sample file by a number that is printed if the round fails, so that
`--only NUMBER` does it again: random bytes of it, words of time, records and sizes (`damage.py`), or links, headers
and values (`structures.py`). A round fails if reading neither gives valid Events nor raises FormatError, if a window
or the span says otherwise than the whole file, or if it takes more than five seconds of CPU time, or memory beyond a
few times the file's size.
The round in hand is kept in `nvsdata-fuzz-round` in the system's folder for temporary files, in
case the process dies of it; a round that hangs is ended, and the process with it, after a minute.
"""

from __future__ import annotations

import argparse
import faulthandler
import io
import os
import re
import resource
import sys
import tempfile
import time
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import trees
from damage import KINDS, damage, disagreement, file_of
from judging import Judging
from lookalikes import (
    AEDAT3_HEADER,
    MATLAB_73,
    aedat3_packet,
    aedat4_bytes,
    evt2_bytes,
    evt3_bytes,
    hdf5_bytes,
    matlab_bytes,
)
from metavision_files import metavision_bytes
from structures import BY_SUFFIX

import nvsdata
from nvsdata import FormatError
from nvsdata.formats import atis, npy, text
from nvsdata.formats.hdf5 import columns as hdf5_columns
from nvsdata.formats.hdf5 import layouts as hdf5

SLOW_S, HANGING_S = 5.0, 60.0  # s of CPU time, s
COSTLY = (".h5", "v73.mat")
FRESH = 2  # windows that are read of a recording of their own
WARM = 200  # rounds in which libraries and kernels are loaded
MEMORY = 256 << 20  # bytes that reading a file of some kB may add to the most the process had


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--rounds", type=int, default=sys.maxsize, help="at most (default: as many as come)")
    parser.add_argument("--judges", metavar="PYTHON", help="compare with other packages, which this Python has")
    parser.add_argument("--seed", type=int, default=0, help="number of the first round")
    parser.add_argument("--only", type=int, help="do this round only")
    parser.add_argument("--kinds", metavar="TEXT", help="only kinds with this in their name")
    args = parser.parse_args()
    # it uses what is here
    import fuzz_side_files as side_files

    warnings.simplefilter("ignore")
    read_in_small_pieces()
    end = time.monotonic() + 60 * args.minutes
    in_hand = Path(tempfile.gettempdir(), "nvsdata-fuzz-round")
    with tempfile.TemporaryDirectory() as home:
        samples = make_samples(Path(home))
        side_files.prepare(Path(home))
        judging = Judging(args.judges) if args.judges else None
        # files of HDF5 take ten times as long as others
        kinds = [name for name in samples for _ in range(1 if name.endswith(COSTLY) else 6)]
        kinds += [name for name in side_files.ROUNDS for _ in range(2)]
        if args.kinds:
            kinds = [name for name in kinds if args.kinds in name]
        if judging is not None:
            kinds = [name for name in samples if name.endswith(judging.suffixes)]
        counts = dict.fromkeys(kinds, 0)
        number, failed, most = args.seed if args.only is None else args.only, 0, 0
        last = args.seed + args.rounds if args.only is None else args.only + 1
        while number < last and time.monotonic() < end:
            in_hand.write_text(str(number))
            faulthandler.dump_traceback_later(HANGING_S, exit=True)
            name = kinds[number % len(kinds)]
            if name in samples:
                fault = attempt(number, name, samples[name], Path(home))
            else:
                fault = side_files.attempt(number, name, Path(home))
            used, most = most_memory() - most, most_memory()
            # the first rounds load modules
            if used > MEMORY and sum(counts.values()) > WARM:
                fault = fault or f"took {used >> 20} MiB"
            if not fault and judging is not None:
                fault = judging.fault(Path(home, name))
            counts[name] += 1
            if fault:
                failed += 1
                print(f"round {number} ({name}): {fault}", flush=True)
            number += 1
    print(f"rounds {args.seed} to {number - 1}, {failed} failed; {counts}")
    if judging is not None:
        print(judging.report())
    return 1 if failed else 0


def read_in_small_pieces() -> None:
    """So that files of 400 events are bisected, and read in parts, as long ones are."""
    text.CHUNK, text.PIECE, text.LINE = 300, 2_000, 8
    hdf5_columns.BISECTED, hdf5_columns.SCANNED, hdf5_columns.BLOCK = 8, 64, 128
    hdf5.AROUND = 4
    npy.NpyRecording.block = atis.AtisRecording.block = 32
    atis.SHORT = 0


def make_samples(home: Path) -> dict[str, bytes]:
    """A small sound file of every format, by the name it is to have."""
    ev = trees.some(0, 400, (128, 128))
    samples = {
        "a.raw": evt2_bytes(ev),
        "b.raw": evt3_bytes(ev),
        "a.mat": matlab_bytes(ev),
        "b.mat": matlab_bytes(ev, compress=False),
        "davis.aedat": trees.davis(ev),
        "packets.aedat": AEDAT3_HEADER
        + aedat3_packet(ev[:200])
        + aedat3_packet(ev[:9], kind=3)
        + aedat3_packet(ev[200:]),
    }
    # what no damaged file may make one open: the one waits for ever, the other holds other events
    os.mkfifo(home / "pipe")
    nvsdata.write(trees.some(1, 400, (128, 128)), home / "other.h5")
    for suffix in (".bin", ".dat", ".txt", ".h5", ".npy", ".aedat1", ".aedat", ".aedat3", ".aedat4"):
        nvsdata.write(ev, home / f"w{suffix}")
        samples[f"w{suffix}"] = (home / f"w{suffix}").read_bytes()
    for name, compression in (("plain", 0), ("lz4", 1), ("zstd", 3)):
        samples[f"{name}.aedat4"] = aedat4_bytes(ev, compression)
    # as others write HDF5: without the checksums that ours has
    events = {f"events/{name}": {"data": column} for name, column in ev.columns._asdict().items()}
    zipped = {"chunks": (50,), "compression": "gzip"}
    samples["dsec.h5"] = hdf5_bytes(events)
    samples["zip.h5"] = hdf5_bytes({name: how | zipped for name, how in events.items()})
    samples["own-zip.h5"] = own_zipped(home / "w.h5")
    samples["plain.h5"] = hdf5_bytes({name.removeprefix("events/"): how for name, how in events.items()})
    samples["cd.h5"] = hdf5_bytes({"CD/events": {"data": ev.to_structured(), "chunks": (50,)}})
    samples["ecf.h5"] = metavision_bytes(ev, 50)
    lines = b"".join(b"%d,%d,%d,%d\n" % (e.x, e.y, e.p, e.t) for e in ev.to_structured().view(np.recarray))
    samples["metavision.csv"] = b"%geometry:128,128\n" + lines
    for name, save in (("a.npz", np.savez), ("zip.npz", np.savez_compressed)):
        archive = io.BytesIO()
        save(archive, **ev.columns._asdict())
        samples[name] = archive.getvalue()
    samples["names.csv"] = b"x,y,polarity,timestamp_us\n" + lines
    columns = {"ts": ev.t, "x": ev.x, "y": ev.y, "pol": ev.p}
    samples |= {f"times-{kind}{suffix}": b"" for kind, (suffix, *_) in KINDS.items()}
    samples["v73.mat"] = hdf5_bytes({name: {"data": column} for name, column in columns.items()}, MATLAB_73)
    return samples


def own_zipped(path: Path) -> bytes:
    """Our own file as h5repack makes it smaller."""
    columns: dict[str, dict[str, Any]] = {}
    with h5py.File(path) as file:
        for name in "txyp":
            columns[f"events/{name}"] = {"data": file[f"events/{name}"][()], "chunks": (64,), "compression": "gzip"}
        attributes = dict(file.attrs)
    raw = io.BytesIO(hdf5_bytes(columns))
    with h5py.File(raw, "r+") as file:
        file.attrs.update(attributes)
    return raw.getvalue()


def attempt(number: int, name: str, sample: bytes, home: Path) -> str:
    """Damage the sample of that name and read it in both manners; what went wrong, if anything."""
    rng = np.random.default_rng(number)
    path = home / name
    block = None
    if name.startswith("times-"):
        kind = path.stem.removeprefix("times-")
        header, raw = file_of(kind, int(rng.integers(2, 900)), rng)
        path.write_bytes(sizes_changed(header, rng) + damage(kind, raw, rng))
        block = int(rng.choice((16, 64)))
    else:
        path.write_bytes(damaged(name, sample, rng, home))
    start = time.process_time()
    windows = some_windows(rng)
    for strict in (True, False):
        try:
            check(path, strict, windows)
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            return f"strict={strict}: {type(error).__name__}: {error}"
    try:
        fault = disagreement(path, rng, block)
    except (ArithmeticError, AssertionError, LookupError, OSError, TypeError, ValueError) as error:
        fault = f"{type(error).__name__}: {error}"
    if fault:
        return fault
    # on a busy machine, a round of milliseconds may wait for seconds
    if time.process_time() - start > SLOW_S:
        return f"took {time.process_time() - start:.1f} s"
    return ""


def sizes_changed(header: bytes, rng: np.random.Generator) -> bytes:
    """The header with another number in one of its places, once in a while."""
    places = list(re.finditer(rb"\d+", header))
    if not places or rng.random() < 0.8:
        return header
    where = places[int(rng.integers(0, len(places)))]
    number = rng.choice([b"0", b"1", b"32767", b"32768", b"-5", b"4294967296", b"9" * 30, b"x"])
    return header[: where.start()] + bytes(number) + header[where.end() :]


def damaged(name: str, sample: bytes, rng: np.random.Generator, home: Path) -> bytes:
    """The sample with damage that knows its format, with random damage, or with both."""
    aware = next((how for suffix, how in BY_SUFFIX.items() if name.endswith(suffix)), None)
    if aware is None or rng.random() < 0.4:
        return at_random(bytearray(sample), rng)
    raw = aware(sample, rng, home)
    return at_random(bytearray(raw), rng) if rng.random() < 0.2 else raw


def at_random(raw: bytearray, rng: np.random.Generator) -> bytes:
    """Some bytes changed, set to extremes, inserted, removed or repeated; the tail cut off."""
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(0, max(len(raw), 1)))
        # half of the damage goes to where headers are
        at = at if rng.random() < 0.5 else at % 200
        length = int(rng.integers(1, 9))
        kind = rng.integers(0, 6)
        if kind == 0:
            raw[at : at + 1] = bytes([int(rng.integers(0, 256))])
        elif kind == 1:
            raw[at : at + length] = bytes([int(rng.choice((0, 1, 0x7F, 0x80, 0xFF)))]) * length
        elif kind == 2:
            raw[at:at] = rng.bytes(length)
        elif kind == 3:
            del raw[at : at + length]
        elif kind == 4:
            raw[at:at] = raw[at : at + 8 * length]
        else:
            del raw[at:]
    return bytes(raw)


def some_windows(rng: np.random.Generator) -> list[tuple[int, int]]:
    """Windows within the samples' times, at their edges, and of everything."""
    edges = np.sort(rng.integers(-1_000, 130_000, (3, 2)))
    some = [*map(tuple, edges.tolist()), (-(2**63), 2**63 - 1), (0, 1 << 32)]
    return [some[i] for i in rng.permutation(len(some))]


def check(path: Path, strict: bool, windows: list[tuple[int, int]]) -> None:
    """Read it whole and in windows; AssertionError if Events aren't valid, or a window isn't that of the whole."""
    whole = outcome(path, strict)
    fresh = windows[:FRESH]
    found = [outcome(path, strict, *window) for window in fresh]
    with suppress(FormatError):
        # and one after the other of a recording, which remembers
        recording = nvsdata.open(path, strict=strict)
        found += [recording.read(*window) for window in windows[1:]]
    windows = fresh + windows[1:]
    for window, events in zip(windows, found, strict=False):
        if events is not None:
            valid(events)
            assert not len(events) or window[0] <= events.t[0] <= events.t[-1] < window[1], f"outside {window}"
        if whole is not None:
            assert events is not None, f"{window} is refused, the whole is not"
            expected = whole.window(*window)
            assert events == expected, f"{window}: {events}, the whole has {expected}"
    if whole is not None:
        valid(whole)


def outcome(path: Path, strict: bool, *window: int) -> nvsdata.Events | None:
    """The Events, None if the file is refused."""
    try:
        return nvsdata.read(path, *window, strict=strict)
    except FormatError:
        return None


def valid(ev: nvsdata.Events) -> None:
    width, height = ev.sensor_size
    assert (np.diff(ev.t) >= 0).all(), "times fall"
    assert not len(ev) or -(2**62) < ev.t[0] <= ev.t[-1] < 2**62, "times beyond 2^62"
    assert ((ev.x >= 0) & (ev.x < width) & (ev.y >= 0) & (ev.y < height) & (ev.p <= 1)).all(), "outside the sensor"


def most_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    sys.exit(main())
