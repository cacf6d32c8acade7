"""`nvsdata tune`: the settings of PIX2NVS that come closest to a real recording."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

import numpy as np

from nvsdata import formats, plots
from nvsdata.commands.emulation_settings import add_settings, given, settings_of
from nvsdata.commands.options import UsageError, add_jobs, at_least_1, path, positive
from nvsdata.common.files import claimed, put
from nvsdata.emulation import PIX2NVS
from nvsdata.emulation.tuning.objective import Pair, table
from nvsdata.emulation.tuning.search import SPACE, search
from nvsdata.plots.comparison import score_curve, side_by_side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = "Settings that are given stay as they are; the others are searched."
    add = parser.add_argument
    add("--real", type=path, required=True, metavar="REC", help="what a camera saw of the video")
    add("--video", type=path, required=True, metavar="VID", help="the video that was shown to it")
    add("--out", type=path, default=Path("tuning"), metavar="DIR", help="folder for trials, table and pictures")
    add("--trials", type=at_least_1, default=100, metavar="N", help="number of settings to try")
    add("--seconds", type=positive, help="compare the first seconds only (default: all)")
    add("--fps", type=positive, help="frames per second, whatever the video says (default: as it says)")
    add("--offset", type=int, default=0, metavar="US", help="µs to add to the recording's times")
    add_jobs(add, "trials at once")
    # the seed of the imperfections stays the preset's
    add_settings(parser, skip=("seed",), searched=SPACE)
    add("--seed", type=int, default=0, help="seed of the search")


def run(args: argparse.Namespace) -> int:
    """Search, and print what was found."""
    seed = vars(args).pop("seed")
    held = given(args)
    if not SPACE.keys() - held.keys():
        raise UsageError("every setting is given: there is nothing to search for")
    options = {name: getattr(args, name) for name in ("trials", "fps", "seconds", "offset", "jobs")}
    print(tune_files(args.real, args.video, args.out, settings_of(args), held=held, seed=seed, **options))
    return 0


def tune_files(
    real: Path,
    video: Path,
    out: Path,
    base: PIX2NVS,
    *,
    held: Collection[str] = (),
    trials: int,
    fps: float | None,
    seconds: float | None,
    offset: int,
    seed: int,
    jobs: int,
) -> str:
    """Search for all settings except those `held`; return a table of what was found.

    Trials, table and pictures go to `out`. ValueError if no settings gave a finite score.
    """
    pair = Pair(formats.open(real), video, fps=fps, seconds=seconds, offset=offset)
    note = {"real": str(real), "video": str(video), "fps": fps, "seconds": seconds, "offset": offset}
    space = {name: choices for name, choices in SPACE.items() if name not in held}
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        found = search(
            pair, space=space, base=base, trials=trials, seed=seed, jobs=jobs, journal=out / "trials.jsonl", note=note
        )
        if not np.isfinite(found.scores).any():
            raise ValueError("no settings gave events in a frame that has real ones, too: is it the same scene?")
        text = f"{table(found)}\n\n{found.best.settings!r}\n"
        put(out / "table.txt", text.encode())
        plots.save(score_curve(found.scores), out / "score.png")
        best = pair.emulate(found.best.settings)
        plots.save(side_by_side(best, pair.real, pair.fps, offset), out / "best.png")
    return f"{text}\ntrials, table and pictures are in {out}"
