"""What `nvsdata compare` and `nvsdata tune` print and draw."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from nvsdata import formats, metrics, plots
from nvsdata.common.errors import shown
from nvsdata.common.files import claimed, put
from nvsdata.data.events import Events
from nvsdata.emulation.pix2nvs import PIX2NVS
from nvsdata.emulation.tuning.objective import Pair, aligned, table
from nvsdata.emulation.tuning.search import SPACE, Search, search

SHOTS = 6  # frames that a picture shows of a sequence
LEAST_WIDTH = 160  # pixels; smaller sensors are drawn larger


def compare_files(
    emulated: Path, real: Path, picture: Path, *, fps: float, offset: int = 0, size: tuple[int, int] | None = None
) -> str:
    """Distances of two recordings, as a table; both are drawn side by side to `picture`.

    `size` is the sensor's, for files that don't state it.
    """
    a, b = (formats.read(path, sensor_size=size) for path in (emulated, real))
    found = metrics.compare(a, b, fps, offset=offset)
    rows = [("distance", "value", "frames", "empty in A", "empty in B")]
    for name, distance in (
        ("Chamfer", found.chamfer),
        ("e-repeatability", found.repeatability),
        ("EMD", found.emd),
    ):
        rows.append(
            (name, f"{distance.value:.4f}", str(distance.used), str(distance.empty_emulated), str(distance.empty_real))
        )
    plots.save(side_by_side(a, b, fps, offset), picture)
    return f"A  {shown(emulated)}  {a}\nB  {shown(real)}  {b}\n{aligned(rows)}\ndrawn in {shown(picture)}"


def side_by_side(a: Events, b: Events, fps: float, offset: int = 0) -> np.ndarray:
    """Both sequences at the same moments, in two rows; uint8 [H, W, 3]."""
    origins = (a.start, b.start - offset)
    span = max(events.end - origin for events, origin in zip((a, b), origins, strict=True))
    length = round(1e6 / fps)
    starts = np.linspace(0, max(span - length, 0), SHOTS).astype(int).tolist()
    zoom = max(1, LEAST_WIDTH // a.sensor_size[0])
    rows = [
        (name, [plots.event_image(events.window(origin + s, origin + s + length), zoom) for s in starts])
        for name, events, origin in zip("AB", (a, b), origins, strict=True)
    ]
    return plots.contact_sheet(rows, margin=24)


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
    """Search for settings but those `held`; the table of what was found. Trials, table and pictures go to `out`."""
    pair = Pair(formats.open(real), video, fps=fps, seconds=seconds, offset=offset)
    note = {"real": str(real), "video": str(video), "fps": fps, "seconds": seconds, "offset": offset}
    space = {name: choices for name, choices in SPACE.items() if name not in held}
    if not space:
        raise ValueError("every setting is given: there is nothing to search for")
    out.mkdir(parents=True, exist_ok=True)
    with claimed(out):
        found = search(
            pair, space=space, base=base, trials=trials, seed=seed, jobs=jobs, journal=out / "trials.jsonl", note=note
        )
        if not np.isfinite(found.scores).any():
            raise ValueError("no settings gave events in a frame that has real ones, too: is it the same scene?")
        text = f"{table(found)}\n\n{found.best.settings!r}\n"
        put(out / "table.txt", text.encode())
        plots.save(score_curve(found), out / "score.png")
        best = pair.emulate(found.best.settings)
        plots.save(side_by_side(best, pair.real, pair.fps, offset), out / "best.png")
    return f"{text}\ntrials, table and pictures are in {out}"


def score_curve(found: Search) -> np.ndarray:
    """Score against trial, of each and of the best so far; uint8 [H, W, 3]."""
    scores = found.scores
    highest = float(scores[np.isfinite(scores)].max())
    each = np.minimum(scores, highest)
    lines = [("each trial", each.tolist()), ("best so far", np.minimum.accumulate(each).tolist())]
    return plots.curves(lines, "weighted score (lower is closer)", "trial", highest=highest)
