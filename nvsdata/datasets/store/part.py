"""The unfinished store: progress of a run, from which the next run continues."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from nvsdata.common.files import MOST_LINES, append_own, json_line, parsed_line, read_own, remove_link, write_all
from nvsdata.data.events import EVER
from nvsdata.datasets.store.index import ALIGNED, BEGIN, VERSION
from nvsdata.formats.ondisk import read_into

JOURNAL, DATA = "journal.jsonl", "data"


@dataclass(frozen=True)
class JournalLine:
    """Line of the journal about a record.

    Attributes:
        name: its recording, or its sample.
        events: number of its events; 0 for a sample.
        length: bytes of the record.
        check: checksum of the record's head and table of blocks, or of the sample.
        bytes: size of the file of which it was made.
        stamp: stamp of this file.
    """

    name: str
    events: int
    length: int
    check: int
    bytes: int
    stamp: list[int]


class Part:
    """A folder with the records of a store and a journal with a line per record. To be used in a `with` block.

    The first line of the journal identifies the run. The records of an earlier run are reused up to the first one whose
    file has changed or is missing, or that is damaged on the disk.

    Args:
        folder: the folder, made if needed.
        run: what the records depend on, for the first line.
        names: names of the records.
        skipped: names that aren't among `names` and have no record, name to reason.
        stamp: function that returns the stamp of a record's file.
        intact: function that returns whether the bytes of a record are those of its line.

    Attributes:
        facts: the records.
        skipped: names without a record, name to reason.
        end: number of bytes of the store so far.
    """

    def __init__(
        self,
        folder: Path,
        run: dict[str, Any],
        names: Sequence[str],
        skipped: dict[str, str],
        stamp: Callable[[str], Sequence[int]],
        intact: Callable[[np.ndarray, JournalLine], bool],
    ) -> None:
        self.folder, self._stamp, self._intact = folder, stamp, intact
        self.facts: list[JournalLine] = []
        self.end = BEGIN
        self.skipped = dict(skipped)
        self._head = {"version": VERSION, **run}
        remove_link(folder)
        folder.mkdir(parents=True, exist_ok=True)
        append_own(self.data).close()
        self._resume(set(names))

    @property
    def data(self) -> Path:
        """The file with the records, which becomes the store."""
        return self.folder / DATA

    @property
    def done(self) -> set[str]:
        """Names that have a record or are left out."""
        return {facts.name for facts in self.facts} | set(self.skipped)

    def _resume(self, names: set[str]) -> None:
        journal = self.folder / JOURNAL
        lines = read_own(journal, MOST_LINES).splitlines(keepends=True) if journal.exists() else []
        valid = 0  # bytes of the journal
        # a line without its end was cut off
        lines = [line for line in lines if line.endswith(b"\n")]
        if lines and parsed_line(lines[0]) == self._head:
            valid = len(lines[0])
            with self.data.open("rb") as file:
                for line in lines[1:]:
                    given = parsed_line(line)
                    if given is None or not self._is_valid(given, names, file.fileno()):
                        break
                    valid += len(line)
                    # what was left out is tried again, because its file may have been repaired
                    if "skipped" not in given:
                        self._note(JournalLine(**given))
                        names.remove(given["name"])
        with append_own(journal) as file:
            file.truncate(valid)
            if not valid:
                write_all(file.fileno(), json_line(self._head).encode())
        with append_own(self.data) as file:
            # a longer or shorter one
            file.truncate(self.end)

    def _is_valid(self, given: dict[str, Any], names: set[str], handle: int) -> bool:
        """Return whether a line of the journal is of an unchanged file whose record is on the disk."""
        if not isinstance(given.get("name"), str) or given["name"] not in names:
            return False
        if "skipped" in given:
            return isinstance(given["skipped"], str)
        try:
            facts = JournalLine(**given)
            numbers = [facts.events, facts.length, facts.check, facts.bytes, *facts.stamp]
            if not all(type(number) is int and EVER[0] <= number <= EVER[1] for number in numbers):
                return False
            return list(self._stamp(facts.name)) == facts.stamp and self._is_intact(facts, handle)
        except (OSError, TypeError, ValueError, KeyError):
            return False

    def _is_intact(self, facts: JournalLine, handle: int) -> bool:
        """Return whether the next record on the disk is that of a line, and intact."""
        room = os.fstat(handle).st_size - self.end
        if not 0 < facts.length <= room or facts.length % ALIGNED or facts.bytes < 0:
            return False
        raw = np.empty(facts.length, np.uint8)
        read_into(handle, str(self.data), self.end, raw)
        return self._intact(raw, facts)

    def _note(self, facts: JournalLine) -> None:
        self.facts.append(facts)
        self.end += facts.length

    def __enter__(self) -> Self:
        # unbuffered, so that errors of the disk show at once
        self._data, self._journal = append_own(self.data), append_own(self.folder / JOURNAL)
        return self

    def __exit__(self, *_: object) -> None:
        self._data.close()
        self._journal.close()

    def add(self, name: str, result: tuple[JournalLine, bytes] | str) -> None:
        """Append a record, then the journal line that makes it valid.

        Args:
            name: its name.
            result: its line and bytes, or the reason why it is left out.
        """
        if isinstance(result, str):
            self.skipped[name] = result
            line: dict[str, Any] = {"name": name, "skipped": result}
        else:
            facts, record = result
            write_all(self._data.fileno(), record)
            line = asdict(facts)
            self._note(facts)
        write_all(self._journal.fileno(), json_line(line).encode())
