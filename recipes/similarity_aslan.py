"""Decide whether two recordings show the same action (thesis, section 5.3.2, Table 5.5).

    python recipes/train_actions.py --dataset ucf101-dvs --root UCF101-DVS --graphs 16 --out runs/ucf101
    python recipes/similarity_aslan.py --root ASLAN-DVS --model runs/ucf101/model.safetensors --out runs/aslan

A network trained to recognize actions computes two features per recording, each L2-normalized: the output of its last
pooling, and the global average of that output. For a pair of recordings, the 12 similarities of Table 5.4 of each
feature are the input of a support vector machine with a radial basis function kernel. It is trained on nine of the ten
subsets of ASLAN's "View 2", and tested on the tenth. The recipe writes to OUT the features, a line for each subset in
`log.jsonl`, and the ROC curve over all subsets in `roc.png`. An interrupted run continues with the features that are
missing.

    torchrun --nproc-per-node 4 recipes/similarity_aslan.py ...

divides the recordings among 4 processes, with the same features. With --stated-sizes, --root can also be a folder of
emulate_actions.py.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from torch.nn.functional import normalize

from nvsdata import models, plots
from nvsdata.common.files import put
from nvsdata.common.progress import bar
from nvsdata.datasets import ASLANDVS
from nvsdata.metrics import area_under_roc, roc, similarities
from nvsdata.training import Team, loader, predict_batches, run, team


def main() -> None:
    args = arguments()
    # each network has a separate folder of features
    where = args.out / "features" / hashlib.sha256(args.model.read_bytes()).hexdigest()[:16]
    with team(args.device) as here, here.claiming(args.out):
        trained = models.load(args.model, device=here.device)
        if not hasattr(trained.model, "features") or trained.transform is None:
            raise SystemExit(f"{args.model} can't compute features of sequences: train a network with train_actions.py")
        pairs = (PairsOfAnySize if args.stated_sizes else ASLANDVS)(args.root, "all")
        extract(pairs, trained, where, args.seed, here)
        if here.rank == 0:
            classify_pairs(args, pairs, where)


class PairsOfAnySize(ASLANDVS):
    """Pairs like those of ASLAN-DVS of recordings that state the size of their sensor."""

    info = replace(ASLANDVS.info, sensor_size=None)


def classify_pairs(args: argparse.Namespace, pairs: ASLANDVS, where: Path) -> None:
    """Classify pairs by the features in the folder `where`, and write the accuracies."""
    inputs = np.stack([similarities_of(pair, where) for pair in bar(pairs.samples, "similarities")])
    same, folds = np.array(pairs.targets), np.array(pairs.folds)
    scores, lines = np.zeros(len(same)), []
    for fold in sorted(set(pairs.folds)):
        held = folds == fold
        scores[held] = svm_scores(inputs[~held], same[~held], inputs[held], args.seed)
        lines.append({"fold": fold, "pairs": int(held.sum()), **accuracy_and_auc(scores[held], same[held])})
        print(json.dumps(lines[-1]))
    lines.append({"folds": len(lines), **over_folds(lines, "accuracy"), **over_folds(lines, "auc")})
    print(json.dumps(lines[-1]))
    put(args.out / "log.jsonl", "".join(json.dumps(line) + "\n" for line in lines).encode())
    draw(scores, same, args.out / "roc.png")


def extract(pairs: ASLANDVS, trained: models.Trained, where: Path, seed: int, here: Team) -> None:
    """Write the features of each recording: output of the last pooling, and its global average.

    Recordings before the first one without features are left out.
    """
    names = sorted({name for pair in pairs.samples for name in (pair.a, pair.b)})
    # files are written in order by the first process, whose folder counts
    done = here.gather(next((n for n, name in enumerate(names) if not (where / _file(name)).exists()), len(names)))[0]
    recordings = _Recordings(pairs, names, trained.transform)
    batches = loader(recordings, 1, here, seed=seed, start=done, whole_batches=True)
    outputs = predict_batches(trained.model.features, batches, here)
    missing = bar(names[done:], "features", shown=here.rank == 0)
    for name, (maps, _) in zip(missing, outputs, strict=True):
        if here.rank == 0:
            where.mkdir(parents=True, exist_ok=True)
            kept = io.BytesIO()
            pooled = maps.flatten(2).mean(2)
            np.savez(kept, *(normalize(values.flatten(1)).numpy()[0] for values in (maps, pooled)))
            put(where / _file(name), kept.getbuffer())


class _Recordings:
    """Dataset of the network's inputs, one for each recording."""

    def __init__(self, pairs: ASLANDVS, names: list[str], transform: Any) -> None:
        self.pairs, self.names, self.transform = pairs, names, transform

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> tuple[Any, int]:
        return self.transform(self.pairs.open_recording(self.names[index])), 0


def similarities_of(pair: Any, where: Path) -> np.ndarray:
    """Return the 24 similarities of a pair."""
    a, b = (np.load(where / _file(name)) for name in (pair.a, pair.b))
    with a, b:
        return np.concatenate([similarities(a[key], b[key]) for key in a.files])


def _file(name: str) -> str:
    return name.replace("/", "+") + ".npz"


def svm_scores(train: np.ndarray, same: np.ndarray, test: np.ndarray, seed: int) -> np.ndarray:
    """Return scores of `test`, above 0 for the same action, by an SVM whose C and gamma are chosen on `train`."""
    center, spread = train.mean(0), train.std(0)
    train, test = (((part - center) / np.where(spread > 0, spread, 1)).astype(np.float32) for part in (train, test))
    cv2.setRNGSeed(seed)
    svm = cv2.ml.SVM.create()
    svm.setType(cv2.ml.SVM_C_SVC)
    svm.setKernel(cv2.ml.SVM_RBF)
    svm.trainAuto(train, cv2.ml.ROW_SAMPLE, same.astype(np.int32), kFold=5)
    raw = svm.predict(test, flags=cv2.ml.StatModel_RAW_OUTPUT)[1].ravel()
    named = svm.predict(test)[1].ravel()
    # OpenCV doesn't document which class has positive values
    sign = 1.0 if ((raw > 0) == (named > 0)).mean() > 0.5 else -1.0
    return sign * raw


def accuracy_and_auc(scores: np.ndarray, same: np.ndarray) -> dict[str, Any]:
    """Return the accuracy, and the area under the ROC curve, or None if all pairs are of one kind."""
    area = area_under_roc(scores, same) if 0 < same.sum() < len(same) else None
    return {"accuracy": float(((scores > 0) == (same == 1)).mean()), "auc": area}


def over_folds(lines: list[dict[str, Any]], name: str) -> dict[str, float]:
    """Return the mean and standard deviation over the subsets."""
    values = [line[name] for line in lines if line.get(name) is not None]
    return {name: float(np.mean(values)), f"{name}_deviation": float(np.std(values))}


def draw(scores: np.ndarray, same: np.ndarray, path: Path) -> None:
    """Draw the ROC curve, and that of random guesses."""
    rate = np.linspace(0, 1, 201)
    false, true = roc(scores, same)
    lines = [("12 x 2 similarities", np.interp(rate, false, true).tolist()), ("random", rate.tolist())]
    chart = plots.curves(lines, "true positive rate", "false positive rate", (560, 520), ends=(0.0, 1.0))
    plots.save_png(chart, path)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--root", required=True, type=Path, help="folder of ASLAN-DVS, with View2.mat or aslan_pairs.csv")
    add("--model", required=True, type=Path, help="model.safetensors of train_actions.py")
    add("--out", required=True, type=Path, help="folder for features, log and plot")
    text = "take the sensor size that each recording states (default: 240x180, that of ASLAN-DVS)"
    add("--stated-sizes", action="store_true", help=text)
    add("--seed", type=int, default=0, help="seed of the samples and of the SVM (default 0)")
    add("--device", help="device of torch (default: a GPU if there is one, else cpu)")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "run the command again to continue")
