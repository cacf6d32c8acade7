"""A weekend alone: 300 clips, and all that may happen to a camera, a screen, a disk and a computer in the meantime.

Each clip must be recorded rightly, event by event as the camera sent it, or be named with the right reason.
"""

import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from lab import make_video

import nvsdata
from nvsdata.cli import main

LAB = Path(__file__).with_name("weekend.py")
TESTS = Path(__file__).parents[2]
BUSY = "is the computer busy"
# how many clips of a kind there are; what is said of takes that fail, and of recordings to be looked at
HAPPENS = {
    "unplug": (6, "No such device|unplugged|gone|doesn't answer", None),
    "serial": (3, "No such device|unplugged|gone|doesn't answer", None),
    "stall": (3, "the camera sent nothing for", None),
    "reset": (4, "the camera's clock was reset during the recording", None),
    "usb": (4, "USB transfers failed", None),
    "late": (4, None, None),
    "hang": (3, "refused a request", None),
    "drops": (5, "the camera dropped", None),
    "early": (5, None, None),
    "triggers": (6, None, None),
    "wired": (8, None, None),
    "sleep": (4, BUSY, None),
    "kill": (4, None, None),
    "killcut": (4, None, None),
    "interrupt": (2, "KeyboardInterrupt", None),
    "full": (2, "the disk has 0.0 MB left", None),
    "fullcut": (2, "File too large", None),
    "quiet": (9, None, None),
    "cut": (4, None, None),
    "dark": (1, "flash", None),
    "hand": (4, None, "something is in front of it|out of view|of the sensor that sees"),
    "walker": (4, None, "where, or when, nothing moves"),
    "gap": (4, None, "no events for"),
    "noise": (4, None, "Hz of noise per pixel"),
    "bump": (4, None, "pixels from where they were"),
    "flash": (5, "the readout is full", "."),
}
# those that can't be recorded, and why
REFUSED = {
    "broken": (6, "."),
    "fast": (3, "119.*60|120.*60|frames per second"),
    "away": (3, "flash"),
    "faint": (3, "too few"),
}
CLIPS = int(os.environ.get("NVSDATA_WEEKEND", "300"))


def plan(rng, count):
    """A kind for each clip, so many clips that the rest is plain."""
    share = min(1.0, count / 300)
    kinds = [kind for kind, (times, *_) in (HAPPENS | REFUSED).items() for _ in range(max(round(times * share), 1))]
    kinds += ["plain"] * (count - len(kinds))
    return rng.permutation(kinds).tolist()


def make_clip(path, kind, rng):
    """A video of its kind; others show a disc that moves."""
    frames, fps = int(rng.integers(12, 24)), int(rng.choice([24, 25, 30]))
    if kind == "gap":
        frames, fps = 24, 25
    seed = int(rng.integers(1 << 30))
    if kind in ("quiet", "flash"):
        levels = (
            [int(rng.choice([0, 90, 255]))] * frames
            if kind == "quiet"
            else [40 + 160 * (n // 3 % 2) for n in range(frames)]
        )
        write(path, [np.full((60, 120, 3), level, np.uint8) for level in levels], fps)
        return
    make_video(path, frames, 120 if kind == "fast" else fps, (120, 60), seed)
    whole = path.read_bytes()
    if kind == "cut":
        path.write_bytes(whole[: len(whole) * 2 // 3])
    if kind == "broken":
        bad = [
            b"",
            b"RIFF....",
            b"no video at all\n" * 99,
            whole[:300],
            whole[:64] + bytes(len(whole) - 64),
            os.urandom(5_000),
        ]
        path.write_bytes(bad[seed % len(bad)])


def write(path, pictures, fps):
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, pictures[0].shape[1::-1])
    for picture in pictures:
        writer.write(picture)
    writer.release()


def nights(folder):
    """Run the batch, and again with --resume whatever ends it, until it is through; how each run ended."""
    paths = os.pathsep.join((str(TESTS), *sys.path))
    environment = os.environ | {"PYTHONPATH": paths, "SDL_VIDEODRIVER": "dummy"}
    endings = []
    while len(endings) < 40:
        more = ["--resume"] if endings else []
        process = subprocess.run(
            [sys.executable, str(LAB), str(folder), *more],
            env=environment,
            capture_output=True,
            text=True,
            timeout=3 * 3600,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        (folder / f"run-{len(endings)}.txt").write_text(process.stdout + process.stderr)
        assert "Traceback" not in process.stderr, process.stderr
        endings.append(process.returncode)
        if "already existed" in process.stdout:
            return endings
    raise AssertionError(f"{folder}: the batch doesn't come to its end: {endings}")


def lines_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes are stopped and killed")
def test_every_clip_is_right_or_named_with_the_right_reason(tmp_path):
    rng = np.random.default_rng(CLIPS)
    kinds = {f"{n:03d}-{kind}.avi": kind for n, kind in enumerate(plan(rng, CLIPS))}
    for name, kind in kinds.items():
        make_clip(tmp_path / "in" / f"class{int(name[:3]) % 3}" / name, kind, rng)
    endings = nights(tmp_path)
    figures = judged(tmp_path, kinds)
    print(json.dumps(figures | {"endings": endings}))


def judged(folder, kinds):
    """Hold what is there after the weekend to what happened to each clip, by its kind; the figures of it all."""
    out = folder / "out"
    result = {line["video"].split("/")[1]: line for line in lines_of(out / "manifest.jsonl")[1:]}
    takes = [line for line in lines_of(folder / "attempts.jsonl") if "begun" not in line]
    assert sorted(result) == sorted(kinds)

    wrong, counts = [], Counter()
    for name, line in result.items():
        kind, mine = kinds[name], [take for take in takes if take["video"] == name]
        good = [take for take in mine if "same" in take]
        reasons = [take["failed"] for take in mine if "failed" in take]
        if kind in REFUSED:
            wrong += [f"{name}: {line}"] * (
                line["status"] != "failed" or re.search(REFUSED[kind][1], line["reason"]) is None
            )
            counts["refused"] += 1
            continue
        said, looked = HAPPENS.get(kind, (0, None, None))[1:]
        allowed = "|".join(filter(None, (said, BUSY, "flash")))
        wrong += [f"{name}: {reason}" for reason in reasons if re.search(allowed, reason) is None]
        if line["status"] == "failed":
            wrong += [f"{name}: {line['reason']}"] * (said is None or re.search(said, line["reason"]) is None)
            counts["failed"] += 1
            continue
        last = good[-1]
        wrong += [f"{name}: {last}"] * (not last["same"] or abs(last["start"]) > 1_000 or abs(last["drift"]) > 10)
        wrong += [f"{name}: truncated?"] * ((line["status"] == "truncated") != (kind == "cut"))
        doubts = "; ".join(line.get("review", []))
        if looked is None:
            wrong += [f"{name}: looks odd: {doubts}"] * bool(doubts)
        else:
            wrong += [f"{name}: not odd: {doubts}"] * (kind != "flash" and re.search(looked, doubts) is None)
        wrong += [f"{name}: {line['sync']}"] * (kind == "wired" and line["sync"]["by"] != "triggers")
        wrong += [f"{name}: {line['sync']}"] * (kind == "triggers" and "triggers" not in line["sync"])
        wrong += [f"{name}: {last['dropped']}"] * (kind == "early" and not last["dropped"][1] > last["dropped"][0] == 0)
        counts["again" if len(mine) > 1 or line["takes"] > 1 else "at once"] += 1
        counts["looked at"] += bool(doubts)
    right = [take for take in takes if "same" in take]
    figures = {
        "clips": dict(counts),
        "takes": sum("begun" in line for line in lines_of(folder / "attempts.jsonl")),
        "start": [min(take["start"] for take in right), max(take["start"] for take in right)],
        "drift": max(abs(take["drift"]) for take in right),
        "events": sum(line.get("events", 0) for line in result.values()),
        "alarms": len((folder / "alarm").read_text().splitlines()) if (folder / "alarm").exists() else 0,
    }
    assert not wrong, "\n".join(wrong)

    # what is on disk is what the manifest says
    for name, line in result.items():
        if line["status"] != "failed":
            assert (
                len(nvsdata.read(next((out / line["video"]).parent.glob(f"{Path(name).stem}*.h5")))) == line["events"]
            )
    failed = {line["video"] for line in result.values() if line["status"] == "failed"}
    found = main(["record", "--monitor", str(folder / "in"), "--out", str(out), "--verify"])
    assert found == (1 if failed else 0)
    assert not [path for path in out.rglob("*") if path.suffix in (".part", ".davis")]
    assert json.loads((out / "status.json").read_text())["state"] == "verified"
    return figures
