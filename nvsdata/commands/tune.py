"""`nvsdata tune`: the settings of an emulator that come closest to a real recording."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata import formats, plots
from nvsdata.commands.emulation_settings import Emulator, add_settings, given, settings_of, write_settings
from nvsdata.commands.options import UsageError, add_jobs, add_json, at_least_1, path, positive, share
from nvsdata.common.errors import message_of, shown
from nvsdata.common.files import claimed, put
from nvsdata.common.terminal import tell
from nvsdata.data.recording import Recording
from nvsdata.emulation import DVS
from nvsdata.emulation.tuning.objective import Pair, measured_on
from nvsdata.emulation.tuning.report import table, unseen_table
from nvsdata.emulation.tuning.search import search
from nvsdata.emulation.tuning.space import SENSOR_SPACE, SPACE, space_of
from nvsdata.plots.charts import score_curve
from nvsdata.plots.sheets import side_by_side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = "Settings that are given stay as they are; the others are searched."
    add = parser.add_argument
    for name, metavar, what in (
        ("--real", "REC", "what a camera saw of the video; once more, with its --video, for several pairs"),
        ("--video", "VID", "the video that was shown to it; a folder of images with times, or a recording with frames"),
    ):
        add(name, type=path, required=True, action="append", metavar=metavar, help=what)
    add("--out", type=path, default=Path("tuning"), metavar="DIR", help="folder for trials, table and pictures")
    add("--trials", type=at_least_1, default=100, metavar="N", help="number of settings to try")
    add("--seconds", type=positive, help="compare the first seconds only (default: all)")
    add("--fps", type=positive, help="frames per second, whatever the video says (default: as it says)")
    add("--offset", type=int, default=0, metavar="US", help="µs to add to the recording's times")
    add(
        "--one-way", action="store_true", help="distances as in the thesis, which choose emulators that fire too little"
    )
    add(
        "--unseen",
        type=share,
        default=0.25,
        metavar="SHARE",
        help="last share of each pair, which the search doesn't see and the report is on; 0 for none (default 0.25)",
    )
    add_jobs(add, "trials at once")
    add_json(add)
    # the seed of the imperfections stays the preset's
    add_settings(parser, skip=("seed",), searched={*SPACE, *SENSOR_SPACE})
    add("--seed", type=int, default=0, help="seed of the search")


def run(args: argparse.Namespace) -> int:
    """Search, and print what was found."""
    seed = vars(args).pop("seed")
    base = settings_of(args)
    held = given(args, base)
    if not space_of(base).keys() - held.keys():
        raise UsageError("every setting is given: there is nothing to search for")
    if len(args.real) != len(args.video):
        raise UsageError(f"{len(args.real)} --real and {len(args.video)} --video: each recording needs its video")
    options = {
        name: getattr(args, name) for name in ("trials", "fps", "seconds", "offset", "one_way", "unseen", "jobs")
    }
    text, facts = tune_files(args.real, args.video, args.out, base, held=held, seed=seed, **options)
    tell(text, facts, as_json=args.json)
    return 0


def tune_files(
    real: Sequence[Path],
    video: Sequence[Path],
    out: Path,
    base: Emulator,
    *,
    held: Collection[str] = (),
    trials: int,
    fps: float | None,
    seconds: float | None,
    offset: int,
    one_way: bool,
    unseen: float,
    seed: int,
    jobs: int,
) -> tuple[str, dict[str, Any]]:
    """Search for all settings except those `held`; return what was found as a table, and the best by name.

    The search for a DVS begins with what `emulation.fit` finds in the first pair. Trials, table, pictures and the best
    settings go to `out`. ValueError if no settings gave a finite score, and for pairs too short for an unseen part.
    """
    common: dict[str, Any] = {"fps": fps, "seconds": seconds, "offset": offset, "one_way": one_way}
    pairs = [Pair(formats.open(a), _shown(b), **common) for a, b in zip(real, video, strict=True)]
    note = {"real": [*map(str, real)], "video": [*map(str, video)], **common, "unseen": unseen}
    seen, rest = zip(*(pair.split(unseen) for pair in pairs), strict=True) if unseen else (pairs, [])
    left = {*held, *(() if all(pair.colored for pair in pairs) else ("hue",))}
    space = {name: choices for name, choices in space_of(base).items() if name not in left}
    if not space:
        raise ValueError("every setting is given, and the videos have no hue: there is nothing to search for")
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        journal = out / "trials.jsonl"
        start, told = _start(seen[0], base, space)
        found = search(
            partial(measured_on, seen),
            space=space,
            base=base,
            start=start,
            trials=trials,
            seed=seed,
            jobs=jobs,
            journal=journal,
            note=note,
        )
        if not np.isfinite(found.scores).any():
            raise ValueError("no settings gave events in a frame that has real ones, too: is it the same scene?")
        parts = [told, table(found, real=_events(seen))]
        if rest:
            tried = {"best": found.best.settings, "fit" if start else "as given": start or base}
            parts.append(unseen_table({k: measured_on(rest, s) for k, s in tried.items()}, _events(rest)))
        text = "\n\n".join(part for part in (*parts, repr(found.best.settings)) if part) + "\n"
        put(out / "table.txt", text.encode())
        write_settings(found.best.settings, out / "best.json")
        plots.save_png(score_curve(found.scores), out / "score.png")
        first = pairs[0]
        compared = side_by_side(first.emulate(found.best.settings), first.real, first.fps, offset)
        plots.save_png(compared, out / "best.png")
    told = (
        f"{text}\ntrials, table and pictures are in {shown(out)}; "
        f"nvsdata convert-videos IN --settings {shown(out / 'best.json')}"
    )
    best = {"settings": asdict(found.best.settings), "distances": found.best.distances, "events": found.best.events}
    return told, {"best": best, "score": float(np.nanmin(found.scores)), "trials": len(found.trials), "out": out}


def _shown(path: Path) -> Path | Recording:
    """A video, or a recording that holds frames."""
    return formats.open(path) if path.suffix.lower() in formats.suffixes() else path


def _start(pair: Pair, base: Emulator, space: Collection[str]) -> tuple[DVS | None, str]:
    """What a fit of a pair begins with, and what is to be said of it; None where nothing can be fitted."""
    if not isinstance(base, DVS):
        return None, ""
    try:
        fitted = pair.fitted(base)
    except ValueError as error:
        return None, f"begun anywhere, because nothing could be fitted: {message_of(error)}"
    told = [f"begun with a fit: events follow the frames by {fitted.delay:,} µs (--offset allows for it)"]
    told += [f"  {name} can't be told: {reason}" for name, reason in fitted.untold.items()]
    return replace(base, **{name: getattr(fitted.settings, name) for name in space}), "\n".join(told)


def _events(pairs: Sequence[Pair]) -> tuple[int, int]:
    """Numbers of OFF and of ON events of the camera."""
    off, on = (sum(pair.real_events[p] for pair in pairs) for p in (0, 1))
    return off, on
