"""What a dataset should contain, and what is missing."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

SHOWN = 3  # names in a message


@dataclass(frozen=True)
class Holding:
    """How many recordings a class has as distributed.

    - `label`: name of the class; "" for all classes together
    - `count`: number of recordings
    - `part`: such as "train"; "" if there are no parts
    - `stem`: pattern of their names without extension, where known, such as "mnist_3_scale04_{:04d}"
    - `numbers`: that fill in the pattern
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
    """A holding whose names are all known."""
    return Holding(label, len(numbers), part, stem, numbers)


class Found(NamedTuple):
    """A recording that was found: its part ("" if there are none), its class, and its name without extension."""

    part: str
    label: str
    stem: str


def lacking(holds: Sequence[Holding], found: Iterable[Found]) -> Iterator[tuple[str, str]]:
    """Parts and classes with fewer or more recordings than they should have: (where, what is wrong).

    The message lists the recordings where their names are known.
    """
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
    """The first `SHOWN` names, and how many more there are."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more:,} more" if more > 0 else "")
