"""Train and evaluate a residual graph CNN on event recordings (thesis section 4.4.2).

    python recipes/train_objects.py --dataset n-mnist --root N-MNIST --out runs/n-mnist

One random 30 ms window a sample, non-uniform sampling, radius graph, augmentation, Adam with
learning rate 1e-3 decayed tenfold at 60/150 and 110/150 of the epochs, batches of 64. Where the
data has no test split, a fifth of each class is held back. OUT receives `log.jsonl` (a line an
epoch) and `checkpoint.pt`; a run that was stopped goes on with --resume, as if it hadn't been.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from torch.nn.functional import cross_entropy
from torch.utils.data import ConcatDataset, DataLoader, Subset
from tqdm import tqdm

from nvsdata import collate, models
from nvsdata import transforms as T
from nvsdata.datasets import DATASETS, SeededBatches, SeededDataset, stratified
from nvsdata.files import atomic

BATCH = 64
WORKERS = max(1, min(4, (os.cpu_count() or 2) // 2))  # they and torch's threads share the cores
THESIS_EPOCHS = 150
# below this many steps 150 epochs are too few to converge: a small dataset is passed more often
LEAST_STEPS = 9_000


def main() -> None:
    args = arguments()
    torch.manual_seed(args.seed)
    torch.set_num_threads(max(1, (os.cpu_count() or 2) - WORKERS))
    train_set, test_on, classes, sensor_size = datasets(args)
    steps = -(-len(train_set) // BATCH)
    epochs = args.epochs or max(THESIS_EPOCHS, -(-LEAST_STEPS // steps))
    model = network(args.dataset, sensor_size, len(classes)).to(args.device)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    milestones = [round(epochs * 60 / 150), round(epochs * 110 / 150)]
    schedule = torch.optim.lr_scheduler.MultiStepLR(optimizer, milestones)
    parts = {"model": model, "optimizer": optimizer, "schedule": schedule}
    args.out.mkdir(parents=True, exist_ok=True)
    first = resume(args, parts, epochs)
    batches = iter(loader(train_set, args.seed, first, epochs, shuffle=True))
    test_set = test_on((0.0, 1.0))
    test_batches = loader(test_set, args.seed)
    print(f"{len(train_set)} recordings to train on, {len(test_set)} to test on, epochs {first + 1} to {epochs}")
    for epoch in range(first, epochs):
        start = time.perf_counter()
        line: dict[str, Any] = {"epoch": epoch + 1, "learning_rate": schedule.get_last_lr()[0]}
        # what dropout draws depends on the epoch alone, so that a resumed run draws the same
        torch.manual_seed(args.seed * 1_000_003 + epoch)
        line |= train(model, optimizer, batches, steps, args.device, f"epoch {epoch + 1}/{epochs}")
        schedule.step()
        line["seconds"] = round(time.perf_counter() - start, 2)
        if epoch + 1 < epochs:
            line["test_accuracy"] = accuracies(model, test_batches, 1, args.device)[0]
        else:
            windows = loader(test_set, args.seed, last=args.votes)
            line["test_accuracy"] = accuracies(model, windows, args.votes, args.device)[0]
            # voters spread over the recording know more than voters that may stand together
            shares = [test_on((v / args.votes, (v + 1) / args.votes)) for v in range(args.votes)]
            spread = loader(ConcatDataset(shares), args.seed)
            line["test_accuracy_votes"] = accuracies(model, spread, args.votes, args.device)[1]
        save(args, parts, epoch + 1, epochs, line)
        print(json.dumps(line))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--dataset", required=True, choices=sorted(DATASETS), help="folder: class folders of recordings"
    )
    parser.add_argument("--root", required=True, type=Path, help="where the recordings are")
    parser.add_argument("--out", required=True, type=Path, help="where log and checkpoint go")
    parser.add_argument("--epochs", type=int, help=f"default: {THESIS_EPOCHS}, or {LEAST_STEPS} steps if that is more")
    parser.add_argument("--window", type=int, default=30_000, help="µs of a window (default 30000)")
    parser.add_argument("--votes", type=int, default=5, help="windows that vote in the last evaluation (default 5)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint in OUT")
    return parser.parse_args()


def pipeline(args: argparse.Namespace, *, training: bool, within: tuple[float, float] = (0.0, 1.0)) -> T.Compose:
    """From a recording to a graph, augmented for training."""
    window, graph = T.RandomWindow(args.window, within), T.RadiusGraph()
    if args.dataset == "n-mnist":
        # a digit is small: it needs every event, and its mirror image is no digit
        augment = [T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=2)] if training else []
        return T.Compose([window, *augment, graph])
    augment_graph = [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()] if training else []
    return T.Compose([window, T.NonUniformSample(8), graph, *augment_graph])


def datasets(args: argparse.Namespace) -> tuple[Any, Callable[..., Any], list[str], tuple[int, int]]:
    """Training set, test set for a share of the windows, class names and sensor size."""
    kind: Any = DATASETS[args.dataset]
    try:
        train = kind(args.root, "train", transform=pipeline(args, training=True))
        split, kept, held = kind(args.root, "test").split, None, None
    except FileNotFoundError:
        split = "all" if args.dataset == "folder" else "train"
        train = kind(args.root, split, transform=pipeline(args, training=True))
        kept, held = stratified(train.targets, 0.2, seed=args.seed)

    def test_on(within: tuple[float, float]) -> Any:
        test = kind(args.root, split, transform=pipeline(args, training=False, within=within))
        return test if held is None else Subset(test, held)

    kept_of_train = train if kept is None else Subset(train, kept)
    return kept_of_train, test_on, train.classes, train.sensor_size or (240, 180)


def network(dataset: str, sensor_size: tuple[int, int], classes: int) -> models.RGCNN:
    """The thesis's network for the dataset, or for the smallest sensor of its that holds this one."""
    if dataset in models.CONFIGURATIONS:
        return models.rgcnn(dataset, classes)
    side = max(sensor_size)
    return models.rgcnn("n-mnist" if side <= 34 else "cifar10-dvs" if side <= 128 else "asl-dvs", classes)


def loader(dataset: Any, seed: int, first: int = 0, last: int = 1, *, shuffle: bool = False) -> DataLoader[Any]:
    """Seeded batches of the epochs first..last."""
    seeded = SeededDataset(dataset, seed)
    seeded[0, 0]  # compiles the kernels once, before workers are forked
    batches = SeededBatches(len(dataset), BATCH, first=first, last=last, shuffle=shuffle, seed=seed)
    return DataLoader(seeded, batch_sampler=batches, num_workers=WORKERS, collate_fn=collate, persistent_workers=True)


def train(model: Any, optimizer: Any, batches: Any, steps: int, device: str, title: str) -> dict[str, float]:
    """One pass over the training set: mean loss and accuracy."""
    model.train()
    loss_sum = right = seen = 0.0
    for _ in tqdm(range(steps), title, leave=False, disable=None):
        graphs, targets = next(batches)
        targets = targets.to(device)
        scores = model(graphs.to(device))
        loss = cross_entropy(scores, targets)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        loss_sum += loss.item() * len(targets)
        right += (scores.argmax(1) == targets).sum().item()
        seen += len(targets)
    return {"loss": loss_sum / seen, "train_accuracy": right / seen}


@torch.no_grad()
def accuracies(model: Any, batches: DataLoader[Any], windows: int, device: str) -> tuple[float, float]:
    """Accuracy of one window (mean over all), and of the `windows` windows of a recording together.

    A vote adds up log-probabilities. The batches hold every recording once, then again, and so on.
    """
    model.eval()
    outputs = [(model(graphs.to(device)).log_softmax(1).cpu(), targets) for graphs, targets in batches]
    scores = torch.stack(torch.cat([score for score, _ in outputs]).chunk(windows))
    targets = torch.cat([target for _, target in outputs]).chunk(windows)[0]
    single = (scores.argmax(2) == targets).double().mean().item()
    return single, (scores.sum(0).argmax(1) == targets).double().mean().item()


def resume(args: argparse.Namespace, parts: dict[str, Any], epochs: int) -> int:
    """Load the checkpoint if asked to, and cut the log to it; the number of epochs done."""
    log, checkpoint = args.out / "log.jsonl", args.out / "checkpoint.pt"
    done = 0
    if args.resume and checkpoint.exists():
        state = torch.load(checkpoint, map_location=args.device, weights_only=True)
        if state["epochs"] != epochs:
            raise SystemExit(f"{checkpoint} belongs to a run of {state['epochs']} epochs, not {epochs}")
        for name, part in parts.items():
            part.load_state_dict(state[name])
        done = state["epoch"]
    kept = log.read_text().splitlines(keepends=True)[:done] if done else []
    with atomic(log) as temporary:
        temporary.write_text("".join(kept))
    return done


def save(args: argparse.Namespace, parts: dict[str, Any], epoch: int, epochs: int, line: dict[str, Any]) -> None:
    """Write the epoch's line and its checkpoint."""
    with (args.out / "log.jsonl").open("a") as log:
        log.write(json.dumps(line) + "\n")
    with atomic(args.out / "checkpoint.pt") as temporary:
        torch.save(
            {"epoch": epoch, "epochs": epochs, **{name: part.state_dict() for name, part in parts.items()}}, temporary
        )


if __name__ == "__main__":
    main()
