"""Random damage to files of every format, for as long as you like; not part of the suite.

    python tests/fuzz.py --minutes 10 --seed 0

Each round damages a sample file by a number that is printed if the round fails, so that
`--only NUMBER` does it again. A round fails if reading neither gives valid Events nor raises
FormatError, takes longer than five seconds, or takes memory beyond a few times the file's size.
The round in hand is kept in `nvsdata-fuzz-round` in the system's folder for temporary files, in
case the process dies of it; a round that hangs is ended, and the process with it, after a minute.
"""

from __future__ import annotations

import argparse
import faulthandler
import resource
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import trees
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

import nvsdata
from nvsdata import FormatError

SLOW_S, HANGING_S = 5.0, 60.0
MEMORY = 256 << 20  # bytes that reading a file of some kB may add to the most the process had


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=0, help="number of the first round")
    parser.add_argument("--only", type=int, help="do this round only")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    end = time.monotonic() + 60 * args.minutes
    in_hand = Path(tempfile.gettempdir(), "nvsdata-fuzz-round")
    with tempfile.TemporaryDirectory() as home:
        samples = make_samples(Path(home))
        counts = dict.fromkeys(samples, 0)
        number, failed = args.seed if args.only is None else args.only, 0
        while time.monotonic() < end:
            in_hand.write_text(str(number))
            faulthandler.dump_traceback_later(HANGING_S, exit=True)
            name, fault = attempt(number, samples, Path(home))
            counts[name] += 1
            if fault:
                failed += 1
                print(f"round {number} ({name}): {fault}", flush=True)
            number += 1
            if args.only is not None:
                break
    print(f"rounds {args.seed} to {number - 1}, {failed} failed; {counts}")
    return 1 if failed else 0


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
    for suffix in (".bin", ".dat", ".txt", ".h5", ".npy", ".aedat1", ".aedat", ".aedat3"):
        nvsdata.write(ev, home / f"w{suffix}")
        samples[f"w{suffix}"] = (home / f"w{suffix}").read_bytes()
    for name, compression in (("plain", 0), ("lz4", 1), ("zstd", 3)):
        samples[f"{name}.aedat4"] = aedat4_bytes(ev, compression)
    # as others write HDF5: without the checksums that ours has
    events = {f"events/{name}": {"data": column} for name, column in ev.columns._asdict().items()}
    zipped = {"chunks": (50,), "compression": "gzip"}
    samples["dsec.h5"] = hdf5_bytes(events)
    samples["zip.h5"] = hdf5_bytes({name: how | zipped for name, how in events.items()})
    samples["cd.h5"] = hdf5_bytes({"CD/events": {"data": ev.to_structured(), "chunks": (50,)}})
    columns = {"ts": ev.t, "x": ev.x, "y": ev.y, "pol": ev.p}
    samples["v73.mat"] = hdf5_bytes({name: {"data": column} for name, column in columns.items()}, MATLAB_73)
    return samples


def attempt(number: int, samples: dict[str, bytes], home: Path) -> tuple[str, str]:
    """Damage a file and read it in both manners; the sample's name and what went wrong, if anything."""
    rng = np.random.default_rng(number)
    name = list(samples)[number % len(samples)]
    path = home / name
    path.write_bytes(damaged(bytearray(samples[name]), rng))
    before, start = most_memory(), time.monotonic()
    for strict in (True, False):
        try:
            check(nvsdata.open(path, strict=strict), rng)
        except FormatError:
            pass
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            return name, f"strict={strict}: {type(error).__name__}: {error}"
    if time.monotonic() - start > SLOW_S:
        return name, f"took {time.monotonic() - start:.1f} s"
    if most_memory() - before > MEMORY:
        return name, f"took {(most_memory() - before) >> 20} MiB"
    return name, ""


def damaged(raw: bytearray, rng: np.random.Generator) -> bytes:
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


def check(recording: nvsdata.Recording, rng: np.random.Generator) -> None:
    """Read it whole and a window of it; AssertionError if the Events aren't valid or the window isn't theirs."""
    start = int(rng.integers(0, 1_000_000))
    try:
        window = recording.read(start, start + 100_000)
    except FormatError:
        window = None
    ev = recording.read()
    width, height = ev.sensor_size
    assert (np.diff(ev.t) >= 0).all(), "times fall"
    assert ((ev.x >= 0) & (ev.x < width) & (ev.y >= 0) & (ev.y < height) & (ev.p <= 1)).all(), "outside the sensor"
    if window is not None:
        assert (np.diff(window.t) >= 0).all(), "times of a window fall"
        assert not len(window) or start <= window.t[0] <= window.t[-1] < start + 100_000, "outside the window"


def most_memory() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    sys.exit(main())
