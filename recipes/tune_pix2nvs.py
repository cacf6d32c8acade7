"""Find the settings of PIX2NVS whose events are closest to a real camera (Table 3.3 of the thesis), on any pair.

    python recipes/tune_pix2nvs.py --real recording.aedat --video shown.avi --out tuning

The settings in the five rows of the table are emulated and compared with the recording. Then a search looks for better
ones. A score is relative to the other settings that are scored, so the rows and the trials are scored together.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import nvsdata
from nvsdata import metrics, plots
from nvsdata.commands.options import at_least_1
from nvsdata.common.files import claimed, put
from nvsdata.emulation import PRESETS
from nvsdata.emulation.tuning.objective import TuningPair
from nvsdata.emulation.tuning.report import trials_table
from nvsdata.emulation.tuning.search import Search, Trial, search
from nvsdata.emulation.tuning.space import SPACE
from nvsdata.plots.charts import score_curve
from nvsdata.plots.sheets import side_by_side
from nvsdata.training import run

# the settings that the table varies
TABLE = {name: SPACE[name] for name in ("t_log", "inhibition", "max_events", "threshold", "new", "exp", "alpha")}
ROWS = [name for name in PRESETS if name.startswith("table-3.3")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, required=True, help="recording of a camera in front of the video")
    parser.add_argument("--video", type=Path, required=True, help="video that was recorded")
    parser.add_argument(
        "--out", type=Path, default=Path("tuning"), help="folder for trials, table and plots (default tuning)"
    )
    parser.add_argument("--seconds", type=float, help="compare the first seconds only (default: all)")
    parser.add_argument("--offset", type=int, default=0, help="µs to add to the recording's times (default 0)")
    parser.add_argument("--trials", type=at_least_1, default=100, help="number of settings to try (default 100)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the search (default 0)")
    parser.add_argument("--jobs", type=at_least_1, default=1, help="trials at the same time (default 1)")
    args = parser.parse_args()

    # distances of the table are one-way; `nvsdata tune` measures both ways
    pair = TuningPair(nvsdata.open(args.real), args.video, seconds=args.seconds, offset=args.offset, one_way=True)
    args.out.mkdir(parents=True, exist_ok=True)
    with claimed(args.out):
        tune(pair, args)


def tune(pair: TuningPair, args: argparse.Namespace) -> None:
    """Score the rows of the table, search for better settings, and write the results."""
    rows = [Trial(PRESETS[name], *pair(PRESETS[name])) for name in ROWS]
    note = {"real": str(args.real), "video": str(args.video), "seconds": args.seconds, "offset": args.offset}
    journal = args.out / "trials.jsonl"
    found = search(pair, space=TABLE, trials=args.trials, seed=args.seed, jobs=args.jobs, journal=journal, note=note)

    ranking = Search([*rows, *found.trials])
    thesis, best = Search(rows), ranking.best
    camera = pair.real_events
    text = f"Settings of Table 3.3, scored among themselves\n{trials_table(thesis, real=camera)}\n\n"
    text += f"From the worst to the best of these and {args.trials} trials\n"
    text += f"{trials_table(ranking, rows=8, real=camera)}\n\n"
    score = metrics.score([best.distances, rows[-1].distances])
    text += f"best: {best.settings!r}\nits score is {score[0] / score[1]:.3f} times that of the table's best row\n"
    print(text)
    put(args.out / "table.txt", text.encode())
    columns = ("Inv. rep", "Chamfer", "EMD", "Score")
    cells = [(*row.distances, score) for row, score in zip(rows, thesis.scores, strict=True)]
    table = {f"row {n}": dict(zip(columns, row, strict=True)) for n, row in enumerate(cells, 1)}
    put(args.out / "rows.json", json.dumps(table, indent=1).encode())
    plots.save_png(score_curve(found.scores), args.out / "score.png")
    plots.save_png(side_by_side(pair.emulate(best.settings), pair.real, pair.fps, args.offset), args.out / "best.png")


if __name__ == "__main__":
    run(main, "run the command again to continue")
