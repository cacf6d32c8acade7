"""Commands that repeat the tables of the thesis (thesis_tables.py), and the published values (thesis_tables.json)."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import thesis_results as results

PLACEHOLDER = re.compile(r"(?<= )[A-Z][A-Z0-9-]+(?=[ /]|$)")
ALTERNATIVES = re.compile(r"\{([\w,+-]+)\}")
STATES = ("real", "look-alike", "not to be had")
ABLATION = "recipes/ablation.py --dataset n-mnist --root N-MNIST --out OUT --only default"
COUNTS = "recipes/complexity.py --out OUT/complexity.json --only"


@dataclass(frozen=True)
class Command:
    """A command line, and how its result is read.

    Args:
        line: Recipe and options; `OUT` is a folder for results, other words in capitals are data, or a folder of them.
            `{a,b}` stands for one command for each of the words.
        result: File that the command writes, relative to OUT.
        read: Returns rows from that file.
        journal: Whether the file grows while the command runs, so that it doesn't show that the command is done.
    """

    line: str
    result: str
    read: results.Reader
    journal: bool = False

    @property
    def data(self) -> tuple[str, ...]:
        """Placeholders of data."""
        return tuple(name for name in dict.fromkeys(PLACEHOLDER.findall(self.line)) if name != "OUT")


@dataclass(frozen=True)
class Table:
    """A table of the thesis.

    Args:
        state: One of `STATES`: whether the table's own data can be had, or other data take their place.
        note: The data, in words.
        commands: Commands that repeat it.
    """

    state: str
    note: str
    commands: tuple[Command, ...] = ()


def trained(line: str, name: str, row: str, column: str) -> Command:
    """Return a training whose accuracy of single windows is a cell of the table."""
    return Command(f"{line} --out OUT/{name}", f"{name}/report.json", results.accuracy(row, column))


def each_network(
    line: str, folder: str, result: str, read: Callable[[str], results.Reader], *, journal: bool = False
) -> Command:
    """Return a command for each of the networks `{a,b}` in `line`, with a folder of its own; `read` takes the row."""
    words = ALTERNATIVES.search(line)
    assert words
    out = f"{folder}{words[0]}"
    return Command(f"{line} --out OUT/{out}", f"{out}/{result}", results.by_network(read), journal)


def actions(options: str, column: str, *kinds: str) -> tuple[Command, ...]:
    """Return trainings on actions of kinds of networks, whose accuracies are a column of the table."""
    folder = column.lower().replace(" ", "").replace(",", "-").replace("=", "")
    line, read = f"recipes/train_actions.py {options}", partial(results.accuracy, column=column)
    return tuple(each_network(f"{line} {kind}", f"{folder}/", "report.json", read) for kind in kinds)


def ablation(group: str, setting: str, default: str) -> Command:
    """Return a group of the ablation study, whose rows are values of a setting."""
    return Command(f"{ABLATION} {group}", "runs.jsonl", results.ablation(setting, default), journal=True)


def counts(number: str) -> Command:
    """Return a count of operations."""
    return Command(f"{COUNTS} {number}", "complexity.json", results.complexity(number))


@cache
def values() -> dict[str, Any]:
    """Return the published tables: caption, columns and rows of each."""
    found: dict[str, Any] = json.loads(Path(__file__).with_name("thesis_tables.json").read_bytes())
    return found


def published(number: str, row: object, column: str) -> Any:
    """Return a published value: a number, None if the table has none, or a list of alternatives.

    KeyError or ValueError if there is no such row or column.
    """
    table = values()[number]
    return table["rows"][str(row)][table["columns"].index(column)]


def expanded(command: Command) -> list[Command]:
    """Return a command for each word of `{a,b}`, or the command itself."""
    words = ALTERNATIVES.search(command.line)
    if words is None:
        return [command]
    return [
        replace(command, line=command.line.replace(words[0], word), result=command.result.replace(words[0], word))
        for word in words[1].split(",")
    ]
