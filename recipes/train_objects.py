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
from pathlib import Path
from typing import Any

import torch
from torch.nn.functional import cross_entropy
from torch.utils.data import DataLoader, Subset
from tqdm import tqdm

from nvsdata import collate, models
from nvsdata import transforms as T
from nvsdata.datasets import DATASETS, SeededBatches, SeededDataset, stratified
from nvsdata.files import atomic

BATCH = 64
THESIS_EPOCHS = 150
# below this many steps 150 epochs are too few to converge: a small dataset is passed more often
LEAST_STEPS = 12_000


def main() -> None:
    args = arguments()
    torch.manual_seed(args.seed)
    train_set, test_set, classes, sensor_size = datasets(args)
    steps = -(-len(train_set) // BATCH)
    epochs = args.epochs or max(THESIS_EPOCHS, -(-LEAST_STEPS // steps))
    model = network(args.dataset, sensor_size, len(classes)).to(args.device)
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3, fused=True)
    milestones = [round(epochs * 60 / 150), round(epochs * 110 / 150)]
    schedule = torch.optim.lr_scheduler.MultiStepLR(optimizer, milestones)
    parts = {"model": model, "optimizer": optimizer, "schedule": schedule}
    args.out.mkdir(parents=True, exist_ok=True)
    first = resume(args, parts, epochs)
    print(f"{len(train_set)} recordings to train on, {len(test_set)} to test on, epochs {first + 1} to {epochs}")
    batches = iter(
        loader(train_set, SeededBatches(len(train_set), BATCH, first=first, last=epochs, shuffle=True, seed=args.seed))
    )
    test_loader = loader(test_set, SeededBatches(len(test_set), BATCH, last=1))
    for epoch in range(first, epochs):
        start = time.perf_counter()
        line: dict[str, Any] = {"epoch": epoch + 1, "learning_rate": schedule.get_last_lr()[0]}
        # what dropout draws depends on the epoch alone, so that a resumed run draws the same
        torch.manual_seed(args.seed * 1_000_003 + epoch)
        line |= train(model, optimizer, batches, steps, args.device, f"epoch {epoch + 1}/{epochs}")
        schedule.step()
        line["seconds"] = round(time.perf_counter() - start, 2)
        if epoch + 1 < epochs:
            line["test_accuracy"], _ = evaluate(model, test_loader, args.device)
        else:
            votes = loader(test_set, SeededBatches(len(test_set), BATCH, last=args.votes))
            line["test_accuracy"], line["test_accuracy_votes"] = evaluate(model, votes, args.device)
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


def pipelines(args: argparse.Namespace) -> tuple[T.Compose, T.Compose]:
    """Transforms for training and for testing."""
    window, graph = T.RandomWindow(args.window), T.RadiusGraph()
    if args.dataset == "n-mnist":
        # a digit is small: it needs every event, and its mirror image is no digit
        augment = T.RandomAffine(scale=(0.85, 1.1), degrees=15, shift=2)
        return T.Compose([window, augment, graph]), T.Compose([window, graph])
    sample = T.NonUniformSample(8)
    augment = [T.RandomScale(), T.RandomFlip(0), T.RandomFlip(1), T.RandomRotate()]
    return T.Compose([window, sample, graph, *augment]), T.Compose([window, sample, graph])


def datasets(args: argparse.Namespace) -> tuple[SeededDataset, SeededDataset, list[str], tuple[int, int]]:
    """Training set, test set, class names and sensor size."""
    kind = DATASETS[args.dataset]
    train_transform, test_transform = pipelines(args)
    try:
        train: Any = kind(args.root, "train", transform=train_transform)
        test: Any = kind(args.root, "test", transform=test_transform)
        classes, size = train.classes, train.sensor_size
    except FileNotFoundError:
        split = "all" if args.dataset == "folder" else "train"
        whole: Any = kind(args.root, split, transform=train_transform)
        same: Any = kind(args.root, split, transform=test_transform)
        kept, held = stratified(whole.targets, 0.2, seed=args.seed)
        train, test = Subset(whole, kept), Subset(same, held)
        classes, size = whole.classes, whole.sensor_size
    return SeededDataset(train, args.seed), SeededDataset(test, args.seed), classes, size or (240, 180)


def network(dataset: str, sensor_size: tuple[int, int], classes: int) -> models.RGCNN:
    """The thesis's network for the dataset, or for the smallest sensor of its that holds this one."""
    if dataset in models.CONFIGURATIONS:
        return models.rgcnn(dataset, classes)
    fitting = [
        name
        for name in ("n-mnist", "cifar10-dvs")
        if max(sensor_size) <= max(models.CONFIGURATIONS[name]["sensor_size"])
    ]
    return models.rgcnn((fitting or ["asl-dvs"])[0], classes)


def loader(dataset: SeededDataset, batches: SeededBatches) -> DataLoader[Any]:
    """A DataLoader that leaves one core to the training."""
    dataset[next(iter(batches))[0]]  # compiles the kernels once, before workers are forked
    workers = max(1, min(4, (os.cpu_count() or 2) - 1))
    return DataLoader(dataset, batch_sampler=batches, num_workers=workers, collate_fn=collate, persistent_workers=True)


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
def evaluate(model: Any, batches: DataLoader[Any], device: str) -> tuple[float, float]:
    """Accuracy of one window (mean over the windows drawn), and of the mean of their probabilities."""
    model.eval()
    outputs = [(model(graphs.to(device)).softmax(1).cpu(), targets) for graphs, targets in batches]
    samples = len(batches.dataset)  # type: ignore[arg-type]
    scores = torch.cat([score for score, _ in outputs]).view(-1, samples, outputs[0][0].shape[1])
    targets = torch.cat([target for _, target in outputs]).view(-1, samples)
    single = (scores.argmax(2) == targets).double().mean().item()
    return single, (scores.mean(0).argmax(1) == targets[0]).double().mean().item()


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
