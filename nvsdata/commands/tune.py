"""`nvsdata tune`: search for the settings of an emulator whose events are nearest to a real recording."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from nvsdata import formats, plots
from nvsdata.commands.emulation_settings import BuiltInEmulator, add_settings, changes_of, emulator_from, write_settings
from nvsdata.commands.options import UsageError, add_jobs, add_json, at_least_1, fraction, path, positive
from nvsdata.common.errors import message_of, shown
from nvsdata.common.files import claimed, put
from nvsdata.common.terminal import tell
from nvsdata.data.recording import Recording
from nvsdata.emulation import DVS
from nvsdata.emulation.tuning.objective import TuningPair, measured_on
from nvsdata.emulation.tuning.report import trials_table, unseen_table
from nvsdata.emulation.tuning.search import search
from nvsdata.emulation.tuning.space import space_of
from nvsdata.plots.charts import score_curve
from nvsdata.plots.sheets import side_by_side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = (
        "Search for the settings of an emulator whose events are nearest to a real recording. "
        "Settings that --set gives stay fixed; the others are searched."
    )
    add = parser.add_argument
    for name, metavar, text in (
        ("--real", "REC", "recording of a camera in front of the video; for several pairs, repeat --real and --video"),
        ("--video", "VID", "video that was recorded, or a folder of images with times, or a recording with frames"),
    ):
        add(name, type=path, required=True, action="append", metavar=metavar, help=text)
    add("--out", type=path, default=Path("tuning"), metavar="DIR", help="folder for trials, table and plots")
    add("--trials", type=at_least_1, default=100, metavar="N", help="number of settings to try")
    add("--seconds", type=positive, help="compare the first seconds only (default: all)")
    add("--fps", type=positive, help="frames per second, in place of the video's own times (default: the video's)")
    add("--offset", type=int, default=0, metavar="US", help="µs to add to the recording's times")
    add(
        "--one-way",
        action="store_true",
        help="measure distances from emulated to real events only, as in the thesis; they favor too few events",
    )
    add(
        "--unseen",
        type=fraction,
        default=0.25,
        metavar="FRACTION",
        help="last fraction of each pair, which the search doesn't use; the report measures it (0 for none)",
    )
    add_jobs(add, "number of trials at the same time")
    add_json(add)
    add("--seed", type=int, default=0, help="seed of the search")
    add_settings(parser)


def run(args: argparse.Namespace) -> int:
    """Search, and print the result."""
    base = emulator_from(args)
    fixed = changes_of(args, base)
    if not space_of(base).keys() - fixed.keys():
        raise UsageError("--set gives every setting: there is nothing to search")
    if len(args.real) != len(args.video):
        raise UsageError(f"{len(args.real)} --real and {len(args.video)} --video: each recording needs its video")
    options = {
        name: getattr(args, name)
        for name in ("trials", "fps", "seconds", "offset", "one_way", "unseen", "jobs", "seed")
    }
    text, facts = tune_files(args.real, args.video, args.out, base, fixed=fixed, **options)
    tell(text, facts, as_json=args.json)
    return 0


def tune_files(
    real: Sequence[Path],
    video: Sequence[Path],
    out: Path,
    base: BuiltInEmulator,
    *,
    fixed: Collection[str] = (),
    trials: int,
    fps: float | None,
    seconds: float | None,
    offset: int,
    one_way: bool,
    unseen: float,
    seed: int,
    jobs: int,
) -> tuple[str, dict[str, Any]]:
    """Search for the settings of an emulator; return a text with the result, and the best settings by name.

    The search for a DVS begins with the result of `emulation.fit` for the first pair. Trials, table, plots and the best
    settings go to `out`.

    Args:
        real: Recordings of a camera.
        video: Videos that were shown to the camera, in the same order.
        out: Folder of the results.
        base: Emulator to begin with.
        fixed: Names of settings that aren't searched.
        trials: Number of trials.
        fps: Frames per second, or None for the videos' own times.
        seconds: Compare the first seconds only, or None.
        offset: Time in µs that is added to the recordings' times.
        one_way: Whether distances are one-way; see `TuningPair`.
        unseen: Last fraction of each pair that the search doesn't use.
        seed: Seed of the search.
        jobs: Trials at the same time.

    Raises:
        ValueError: No settings gave a finite score, or a pair is too short for an unseen part.
    """
    common: dict[str, Any] = {"fps": fps, "seconds": seconds, "offset": offset, "one_way": one_way}
    pairs = [TuningPair(formats.open(a), _shown(b), **common) for a, b in zip(real, video, strict=True)]
    note = {"real": [*map(str, real)], "video": [*map(str, video)], **common, "unseen": unseen}
    seen, rest = zip(*(pair.split(unseen) for pair in pairs), strict=True) if unseen else (pairs, [])
    left = {*fixed, *(() if all(pair.colored for pair in pairs) else ("hue",))}
    space = {name: choices for name, choices in space_of(base).items() if name not in left}
    if not space:
        raise ValueError("every setting is fixed, and the videos have no hue: there is nothing to search")
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        journal = out / "trials.jsonl"
        start, begun = _start(seen[0], base, space)
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
            raise ValueError("no settings gave events in frames with real events: do both show the same scene?")
        parts = [begun, trials_table(found, real=_events(seen))]
        if rest:
            tried = {"best": found.best.settings, "fit" if start else "as given": start or base}
            parts.append(unseen_table({k: measured_on(rest, s) for k, s in tried.items()}, _events(rest)))
        text = "\n\n".join(part for part in (*parts, repr(found.best.settings)) if part) + "\n"
        put(out / "table.txt", text.encode())
        write_settings(found.best.settings, out / "best.json")
        plots.save_png(score_curve(found.scores), out / "score.png")
        first = pairs[0]
        plots.save_png(
            side_by_side(first.emulate(found.best.settings), first.real, first.fps, offset), out / "best.png"
        )
    message = (
        f"{text}\ntrials, table and plots are in {shown(out)}; "
        f"nvsdata convert-videos IN --settings {shown(out / 'best.json')}"
    )
    best = {"settings": asdict(found.best.settings), "distances": found.best.distances, "events": found.best.events}
    return message, {"best": best, "score": float(np.nanmin(found.scores)), "trials": len(found.trials), "out": out}


def _shown(path: Path) -> Path | Recording:
    """Return a video's path, or a recording that has frames."""
    return formats.open(path) if path.suffix.lower() in formats.suffixes() else path


def _start(pair: TuningPair, base: BuiltInEmulator, space: Collection[str]) -> tuple[DVS | None, str]:
    """Return the settings that a fit of a pair finds, or None, and a message about it."""
    if not isinstance(base, DVS):
        return None, ""
    try:
        fitted = pair.fitted(base)
    except ValueError as error:
        return None, f"began with random settings, because the fit failed: {message_of(error)}"
    lines = [f"began with a fit: events follow the frames by {fitted.delay:,} µs (--offset corrects for it)"]
    values = vars(fitted.settings) | {"delay": fitted.delay}
    lines += [
        f"  {name} {values[name]:.4g} (95% interval {low:.4g} to {high:.4g})"
        for name, (low, high) in fitted.intervals.items()
    ]
    lines += [f"  {name} can't be identified: {reason}" for name, reason in fitted.unidentified.items()]
    return replace(base, **{name: getattr(fitted.settings, name) for name in space}), "\n".join(lines)


def _events(pairs: Sequence[TuningPair]) -> tuple[int, int]:
    """Return the camera's numbers of OFF and of ON events."""
    off, on = (sum(pair.real_events[p] for pair in pairs) for p in (0, 1))
    return off, on
