"""Find the settings of PIX2NVS that come closest to a real camera: the experiment of Table 3.3, on any pair.

    python recipes/tune_pix2nvs.py --real recording.aedat --video shown.avi --out tuning

The five rows of the table are emulated and compared with the recording, then a search looks for better
settings. A score depends on the settings scored together with it, so all are scored together.
"""

from __future__ import annotations

import argparse
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

# what the table varies
TABLE = {name: SPACE[name] for name in ("t_log", "inhibition", "max_events", "threshold", "new", "exp", "alpha")}
ROWS = [name for name in PRESETS if name.startswith("table-3.3")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", type=Path, required=True, help="recording of the camera")
    parser.add_argument("--video", type=Path, required=True, help="video that was shown to it")
    parser.add_argument("--out", type=Path, default=Path("tuning"))
    parser.add_argument("--seconds", type=float, help="compare only the first N seconds")
    parser.add_argument("--offset", type=int, default=0, help="µs to add to the recording's times")
    parser.add_argument("--trials", type=at_least_1, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=at_least_1, default=1)
    args = parser.parse_args()

    # as the table was made; `nvsdata tune` measures both ways
    pair = TuningPair(nvsdata.open(args.real), args.video, seconds=args.seconds, offset=args.offset, one_way=True)
    args.out.mkdir(parents=True, exist_ok=True)
    with claimed(args.out):
        tuned(pair, args)


def tuned(pair: TuningPair, args: argparse.Namespace) -> None:
    """Score the table's rows, search, and write what was found."""
    rows = [Trial(PRESETS[name], *pair(PRESETS[name])) for name in ROWS]
    note = {"real": str(args.real), "video": str(args.video), "seconds": args.seconds, "offset": args.offset}
    journal = args.out / "trials.jsonl"
    found = search(pair, space=TABLE, trials=args.trials, seed=args.seed, jobs=args.jobs, journal=journal, note=note)

    together = Search([*rows, *found.trials])
    thesis, best = Search(rows), together.best
    camera = pair.real_events
    text = f"Settings of Table 3.3, scored among themselves\n{trials_table(thesis, real=camera)}\n\n"
    text += f"From the worst to the best of these and {args.trials} trials\n"
    text += f"{trials_table(together, rows=8, real=camera)}\n\n"
    share = metrics.score([best.distances, rows[-1].distances])
    text += f"best: {best.settings!r}\nits score is {share[0] / share[1]:.3f} times that of the table's best row\n"
    print(text)
    put(args.out / "table.txt", text.encode())
    plots.save_png(score_curve(found.scores), args.out / "score.png")
    plots.save_png(side_by_side(pair.emulate(best.settings), pair.real, pair.fps, args.offset), args.out / "best.png")


if __name__ == "__main__":
    run(main, "the same command continues")
