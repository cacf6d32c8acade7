"""Decide whether two recordings show the same action (thesis section 5.3.2, Table 5.5).

    python recipes/train_actions.py --dataset ucf101-dvs --root UCF101-DVS --graphs 16 --out runs/ucf101
    python recipes/similarity_aslan.py --root ASLAN-DVS --model runs/ucf101/model.safetensors --out runs/aslan

A network trained to recognize actions gives two features per recording: the last pooling and its global average,
L2-normalized. For a pair, the 12 similarities of Table 5.4 of each feature go into a support vector machine with a
radial kernel, trained on nine of View 2's ten subsets and tested on the tenth. OUT receives the features (computed
once, so a stopped run continues), a line per subset in `log.jsonl`, and the ROC curve over all subsets, `roc.png`.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch.nn.functional import normalize

from nvsdata import collate, models, plots
from nvsdata.common.files import claimed, put
from nvsdata.common.progress import bar
from nvsdata.datasets import ASLANDVS, SeededDataset
from nvsdata.metrics import area_under_roc, roc, similarities
from nvsdata.training import run


def main() -> None:
    args = arguments()
    trained = models.load(args.model, device=args.device)
    if not hasattr(trained.model, "features") or trained.transform is None:
        raise SystemExit(f"{args.model} gives no features of sequences: train a network with train_actions.py")
    pairs = ASLANDVS(args.root, "all")
    # features of different networks are kept apart
    where = args.out / "features" / hashlib.sha256(args.model.read_bytes()).hexdigest()[:16]
    where.mkdir(parents=True, exist_ok=True)
    with claimed(args.out):
        compared(args, pairs, trained, where)


def compared(args: argparse.Namespace, pairs: ASLANDVS, trained: models.Trained, where: Path) -> None:
    """Classify pairs by features kept in `where`, and write the accuracies."""
    extract(pairs, trained, where, args)
    described = np.stack([description(pair, where) for pair in bar(pairs.samples, "similarities")])
    same, folds = np.array(pairs.targets), np.array(pairs.folds)
    scores, lines = np.zeros(len(same)), []
    for fold in sorted(set(pairs.folds)):
        held = folds == fold
        scores[held] = machine(described[~held], same[~held], described[held], args.seed)
        lines.append({"fold": fold, "pairs": int(held.sum()), **figures(scores[held], same[held])})
        print(json.dumps(lines[-1]))
    lines.append({"folds": len(lines), **over_folds(lines, "accuracy"), **over_folds(lines, "auc")})
    print(json.dumps(lines[-1]))
    put(args.out / "log.jsonl", "".join(json.dumps(line) + "\n" for line in lines).encode())
    draw(scores, same, args.out / "roc.png")


def extract(pairs: ASLANDVS, trained: models.Trained, where: Path, args: argparse.Namespace) -> None:
    """Write the features of each recording of a pair unless they exist: last pooling, and its global average."""
    names = sorted({name for pair in pairs.samples for name in (pair.a, pair.b)})
    recordings = SeededDataset(_Recordings(pairs, names, trained.transform), args.seed)
    device = next(trained.model.parameters()).device
    for index, name in enumerate(bar(names, "features")):
        file = where / _file(name)
        if not file.exists():
            batch = recordings[0, index]
            with torch.no_grad():
                maps = trained.model.features(batch.to(device)).cpu()
            pooled = maps.flatten(2).mean(2)
            kept = io.BytesIO()
            np.savez(kept, *(normalize(values.flatten(1)).numpy()[0] for values in (maps, pooled)))
            put(file, kept.getbuffer())


class _Recordings:
    """The network's inputs from recordings by name, in batches of one."""

    def __init__(self, pairs: ASLANDVS, names: list[str], transform: Any) -> None:
        self.pairs, self.names, self.transform = pairs, names, transform

    def __getitem__(self, index: int) -> Any:
        return collate([(self.transform(self.pairs.open_recording(self.names[index])), 0)])[0]


def description(pair: Any, where: Path) -> np.ndarray:
    """The 24 similarities of a pair."""
    a, b = (np.load(where / _file(name)) for name in (pair.a, pair.b))
    with a, b:
        return np.concatenate([similarities(a[key], b[key]) for key in a.files])


def _file(name: str) -> str:
    return name.replace("/", "+") + ".npz"


def machine(train: np.ndarray, same: np.ndarray, test: np.ndarray, seed: int) -> np.ndarray:
    """Scores of `test`, above 0 for the same action, by a support vector machine with C and gamma chosen on `train`."""
    center, spread = train.mean(0), train.std(0)
    train, test = (((part - center) / np.where(spread > 0, spread, 1)).astype(np.float32) for part in (train, test))
    cv2.setRNGSeed(seed)
    svm = cv2.ml.SVM.create()
    svm.setType(cv2.ml.SVM_C_SVC)
    svm.setKernel(cv2.ml.SVM_RBF)
    svm.trainAuto(train, cv2.ml.ROW_SAMPLE, same.astype(np.int32), kFold=5)
    raw = svm.predict(test, flags=cv2.ml.StatModel_RAW_OUTPUT)[1].ravel()
    named = svm.predict(test)[1].ravel()
    # OpenCV doesn't define which class has positive values
    sign = 1.0 if ((raw > 0) == (named > 0)).mean() > 0.5 else -1.0
    return sign * raw


def figures(scores: np.ndarray, same: np.ndarray) -> dict[str, Any]:
    """Accuracy, and area under the ROC curve, which needs pairs of both kinds."""
    area = area_under_roc(scores, same) if 0 < same.sum() < len(same) else None
    return {"accuracy": float(((scores > 0) == (same == 1)).mean()), "auc": area}


def over_folds(lines: list[dict[str, Any]], name: str) -> dict[str, float]:
    """Mean and standard deviation over the subsets."""
    values = [line[name] for line in lines if line.get(name) is not None]
    return {name: float(np.mean(values)), f"{name}_deviation": float(np.std(values))}


def draw(scores: np.ndarray, same: np.ndarray, path: Path) -> None:
    """Draw the ROC curve and that of chance."""
    rate = np.linspace(0, 1, 201)
    false, true = roc(scores, same)
    lines = [("12 x 2 similarities", np.interp(rate, false, true).tolist()), ("chance", rate.tolist())]
    picture = plots.curves(lines, "true positive rate", "false positive rate", (560, 520), ends=(0.0, 1.0))
    plots.save_png(picture, path)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--root", required=True, type=Path, help="ASLAN-DVS, with View2.mat or aslan_pairs.csv")
    add("--model", required=True, type=Path, help="model.safetensors of train_actions.py")
    add("--out", required=True, type=Path, help="folder for features, log and picture")
    add("--seed", type=int, default=0)
    add("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    return parser.parse_args()


if __name__ == "__main__":
    run(main, "the same command continues")
