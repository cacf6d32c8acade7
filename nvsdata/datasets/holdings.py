"""What a dataset should hold, and what is lacking."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

SHOWN = 3  # names that are told


@dataclass(frozen=True)
class Holding:
    """How many recordings a class has as distributed, in a part such as "train" if there are parts.

    Without a `label` it is of all classes together.

    `stem` is their names without extension where these are known, with a place for each of `numbers`, such as
    "mnist_3_scale04_{:04d}".
    """

    label: str
    count: int
    part: str = ""
    stem: str = ""
    numbers: range = range(0)

    @property
    def stems(self) -> list[str]:
        """The names, without extension; empty where they aren't known."""
        return [self.stem.format(number) for number in self.numbers]


def numbered(label: str, stem: str, numbers: range, part: str = "") -> Holding:
    """A holding of which all names are known."""
    return Holding(label, len(numbers), part, stem, numbers)


class Found(NamedTuple):
    """A recording that is there: its part ("" where there are none), its class, and its name without extension."""

    part: str
    label: str
    stem: str


def lacking(holds: Sequence[Holding], found: Iterable[Found]) -> Iterator[tuple[str, str]]:
    """Which class of which part has fewer or more recordings than it should, and which they are where that is known."""
    there: dict[tuple[str, str], set[str]] = defaultdict(set)
    for part, label, stem in found:
        there[part, label].add(stem)
        there[part, ""].add(stem)
    wanted: dict[tuple[str, str], list[Holding]] = defaultdict(list)
    for holding in holds:
        wanted[holding.part, holding.label].append(holding)
    for (part, label), holdings in wanted.items():
        stems = there[part, label]
        expected = {stem for holding in holdings for stem in holding.stems}
        count = sum(holding.count for holding in holdings)
        where = "/".join(name for name in (part, label) if name)
        if expected and (missing := sorted(expected - stems)):
            yield where, f"{len(missing):,} of {count:,} recordings are missing: {some(missing)}"
        elif not expected and len(stems) < count:
            yield where, f"{count - len(stems):,} of {count:,} recordings are missing"
        if expected and (strange := sorted(stems - expected)):
            yield where, f"{len(strange):,} recordings that the dataset doesn't have: {some(strange)}"
        elif not expected and len(stems) > count:
            yield where, f"{len(stems):,} recordings, though the dataset has {count:,}"


def some(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more:,} more" if more > 0 else "")
