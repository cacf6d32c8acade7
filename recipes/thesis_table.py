"""Repeat a table of the thesis, and print its numbers next to the published ones.

    python recipes/thesis_table.py                                     # the tables, their data, and whether they exist
    python recipes/thesis_table.py 4.8 --list                          # the commands of a table
    python recipes/thesis_table.py 4.10
    python recipes/thesis_table.py 4.1 --root N-MNIST
    python recipes/thesis_table.py 4.8 --data N-CARS=n-cars.nvs N-MNIST=N-MNIST
    python recipes/thesis_table.py 5.1 --data LOOK-ALIKES=actions      # emulates the recordings, if there are none
    python recipes/thesis_table.py 5.1 --data LOOK-ALIKES=actions --epochs 1

The commands of docs/thesis.md, trainings included, run one after the other, in the same settings as there: a training
takes minutes to hours. --epochs shortens trainings of recipes that count epochs, not steps (as those of Tables 3.4 and
3.5 do), to try the commands; OUT has a separate folder for them. A
command whose data aren't given is left out. A command whose result exists in OUT doesn't run again, and an interrupted
training continues. --root is short for --data if a table takes one kind of data. Accuracies are those of single windows
with 95% intervals over recordings, or means and deviations (±) over seeds.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

from thesis_commands import Command, expanded, values
from thesis_tables import TABLES, where

from nvsdata.commands.options import at_least_1
from nvsdata.common.text import aligned
from nvsdata.training import run

HERE = Path(__file__).parent
# recipes that take --resume
RESUMED = {
    *("train_objects.py", "train_actions.py", "transfer_digits.py", "transfer_emulated.py"),
    *("sign_language.py", "scenes_yupenn.py"),
}

# recipes that take --epochs
SHORTENED = {"train_objects.py", "train_actions.py", "transfer_digits.py", "scenes_yupenn.py", "ablation.py"}
# recipes that emulate data, by their placeholders, and the last files that they write
EMULATED = {
    "LOOK-ALIKES": ("recipes/emulate_actions.py", "aslan_pairs.csv"),
    "SIGNS": ("recipes/emulate_signs.py", "letters.txt"),
}
SETTINGS = "settings.txt"  # the first file of both


def main() -> None:
    args = arguments()
    if args.number is None:
        print(overview())
    elif args.list:
        print(description(args.number))
    else:
        out = args.out / (f"{args.number}-epochs-{args.epochs}" if args.epochs else args.number)
        for name, path in args.data.items():
            emulate(name, Path(path))
        found = [
            row
            for command in TABLES[args.number].commands
            for one in known(command, out, args.data)
            for row in result(one, out, args.data, args.epochs)
        ]
        print(f"\n{comparison(args.number, found)}")
        if args.epochs:
            print(f"trained for {args.epochs} {'epoch' if args.epochs == 1 else 'epochs'} only")


def overview() -> str:
    """Return a table of all tables."""
    rows = [["table", "subject", "state", "data"]]
    rows += [[number, values()[number]["caption"], table.state, table.note] for number, table in TABLES.items()]
    return aligned(rows, left=True)


def description(number: str) -> str:
    """Return the commands of a table, and where its data can be had."""
    table = TABLES[number]
    lines = [head(number), *(command.line for command in table.commands)]
    lines += [f"{name}: {where(name)}" for name in data_of(number)]
    return "\n".join(lines)


def head(number: str) -> str:
    """Return the subject, the state and the data of a table."""
    table = TABLES[number]
    return f"Table {number}, {values()[number]['caption']}: {table.state} ({table.note})"


def data_of(number: str) -> list[str]:
    """Return the placeholders of data in the commands of a table."""
    return list(dict.fromkeys(name for command in TABLES[number].commands for name in command.data))


def emulate(name: str, path: Path) -> None:
    """Emulate the data of a placeholder unless they exist or nvsdata has no recipe for them."""
    # without its settings, a folder isn't the recipe's
    if name not in EMULATED or (path.exists() and not (path / SETTINGS).exists()):
        return
    recipe, last = EMULATED[name]
    # an interrupted run continues
    if not (path / last).exists():
        start([recipe, "--out", str(path)])


def start(words: list[str]) -> None:
    """Run a recipe. ChildProcessError if it fails."""
    print(shlex.join(["python", *words]), flush=True)
    code = subprocess.run([sys.executable, str(HERE.parent / words[0]), *words[1:]]).returncode
    if code:
        raise ChildProcessError(f"{words[0]} ended with exit code {code}: run the command again to continue")


def known(command: Command, out: Path, data: dict[str, str]) -> list[Command]:
    """Return the commands that a line stands for, or only the line if its data are missing and no result exists."""
    each = expanded(command)
    usable = set(command.data) <= set(data) or any((out / one.result).exists() for one in each)
    return each if usable else [command]


def result(command: Command, out: Path, data: dict[str, str], epochs: int | None = None) -> list[tuple[str, str, str]]:
    """Run a command unless its result exists, and return its rows; none if data are missing.

    ChildProcessError if the command fails.
    """
    path, missing = out / command.result, [name for name in command.data if name not in data]
    if path.exists() and (missing or not command.journal):
        print(f"{path} exists: {command.line}")
    elif missing:
        print(f"left out: {command.line}")
        print("\n".join(f"  give --data {name}=PATH: {where(name)}" for name in missing))
        return []
    else:
        words = command_words(command, out, data, epochs)
        # a table of networks can be repeated with some of them
        if absent := [word for word in words if word.endswith(".safetensors") and not Path(word).exists()]:
            print(f"left out: {command.line}\n  {absent[0]} doesn't exist")
            return []
        path.parent.mkdir(parents=True, exist_ok=True)
        start(words)
    return command.read(path)


def command_words(command: Command, out: Path, data: dict[str, str], epochs: int | None = None) -> list[str]:
    """Return the words of a command line, with folders and data in place of their names."""
    places, words = {"OUT": str(out)} | data, []
    for word in command.line.split():
        name, slash, rest = word.partition("/")
        words.append(f"{places.get(name, name)}{slash}{rest}")
    recipe = Path(words[0]).name
    # without an interrupted run, --resume has no effect
    words += ["--resume"] * (recipe in RESUMED)
    return words + (["--epochs", str(epochs)] if epochs and recipe in SHORTENED else [])


def comparison(number: str, found: list[tuple[str, str, str]]) -> str:
    """Return our values next to the published ones; without ours, all published ones."""
    table = values()[number]
    ours = {(row, column): value for row, column, value in found}
    columns = [one for one in table["columns"] if any(column == one for _, column in ours)] or table["columns"]
    columns = list(dict.fromkeys([*columns, *(column for _, column in ours)]))
    texts = thesis_texts(number)
    lines = [["row", "column", "nvsdata", "thesis"]]
    for row in in_order([*table["rows"], *(row for row, _ in ours)]):
        for cell in ((row, column) for column in columns):
            if cell in ours or cell in texts:
                lines.append([*cell, ours.get(cell, ""), texts.get(cell, "")])
    return f"{head(number)}\n{aligned(lines, left=True)}" if len(lines) > 1 else head(number)


def in_order(rows: list[str]) -> list[str]:
    """Return each row once, by value if all are numbers."""
    once = list(dict.fromkeys(rows))
    try:
        return sorted(once, key=float)
    except ValueError:
        return once


def thesis_texts(number: str) -> dict[tuple[str, str], str]:
    """Return the published values as text, with equal numbers of decimals in a column."""
    table = values()[number]
    texts: dict[tuple[str, str], str] = {}
    for n, column in enumerate(table["columns"]):
        cells = {
            row: one[n] if isinstance(one[n], list) else [one[n]]
            for row, one in table["rows"].items()
            if one[n] is not None
        }
        decimals = max(len(f"{value:g}".partition(".")[2]) for one in cells.values() for value in one)
        texts |= {(row, column): " / ".join(f"{value:.{decimals}f}" for value in one) for row, one in cells.items()}
    return texts


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("number", nargs="?", metavar="N", help="number of the table (default: list the tables)")
    add("--root", help="the data, for a table that takes one kind")
    add(
        "--data",
        nargs="+",
        default=[],
        metavar="NAME=PATH",
        help="data by the names that --list prints (default: none)",
    )
    add("--out", type=Path, default=Path("runs/thesis"), help="folder for results (default runs/thesis)")
    text = "epochs of trainings, for a trial (default: those of the commands)"
    add("--epochs", type=at_least_1, help=text)
    add("--list", action="store_true", help="print the commands of the table, and where its data can be had")
    args = parser.parse_args()
    if args.number is not None and args.number not in TABLES:
        raise ValueError(f"no table {args.number}: choose one of {', '.join(TABLES)}")
    names = data_of(args.number) if args.number else []
    pairs = [one.partition("=") for one in args.data]
    if args.root is not None:
        if len(names) != 1:
            raise ValueError(
                f"--root is for tables with one kind of data; use --data with {', '.join(names) or 'none'}"
            )
        pairs.append((names[0], "=", args.root))
    if unknown := [name for name, _, path in pairs if name not in names or not path]:
        raise ValueError(
            f"--data {unknown[0]}: table {args.number} takes NAME=PATH with {', '.join(names) or 'no data'}"
        )
    args.data = {name: path for name, _, path in pairs}
    return args


if __name__ == "__main__":
    run(main, "run the command again to continue")
