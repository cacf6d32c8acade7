"""The unfinished store: progress of a packing run, from which the next run continues."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from nvsdata.common.files import MOST_LINES, append_own, json_line, parsed_line, read_own, remove_link, write_all
from nvsdata.data.events import EVER
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.store.index import ALIGNED, BEGIN, VERSION
from nvsdata.datasets.store.record import HEAD, events_of, head_of
from nvsdata.formats.ondisk import read_into
from nvsdata.kernels.decode.blocks import blocks_between

JOURNAL, DATA = "journal.jsonl", "data"


@dataclass(frozen=True)
class JournalLine:
    """Line of the journal about a packed recording.

    Attributes:
        name: the recording.
        events: number of its events.
        length: bytes of its record.
        check: checksum of the record's head and table of blocks.
        bytes: size of the packed file.
        stamp: stamp of the packed file.
    """

    name: str
    events: int
    length: int
    check: int
    bytes: int
    stamp: list[int]


class Part:
    """A folder with the records of a store and a journal with a line per recording. To be used in a `with` block.

    The first line of the journal identifies the dataset. The recordings of an earlier run are reused up to the first
    recording that has changed, is missing, or whose record on the disk is damaged.

    Args:
        folder: the folder, made if needed.
        dataset: the dataset that is packed.
        names: names of its recordings.
        compress: whether records are compressed.

    Attributes:
        facts: the packed recordings.
        skipped: recordings that weren't packed, name to reason.
        end: number of bytes of the store so far.
    """

    def __init__(self, folder: Path, dataset: EventDataset, names: list[str], *, compress: bool) -> None:
        self.folder, self._source = folder, dataset.source
        self.facts: list[JournalLine] = []
        self.end = BEGIN
        reasons = dataset.source.left_out
        self.skipped = {name: reasons.get(name, "empty") for name in dataset.skipped}
        self._head = {
            "version": VERSION,
            "dataset": dataset.info.name,
            "root": str(dataset.root.resolve()),
            "opened_with": list(dataset.opened_with or ()),
            "compress": compress,
        }
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
        """Names of the recordings that are packed or left out."""
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
                    # recordings left out are tried again, because they may have been repaired
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
        """Return whether a line of the journal is of an unchanged recording whose record is on the disk."""
        if not isinstance(given.get("name"), str) or given["name"] not in names:
            return False
        if "skipped" in given:
            return isinstance(given["skipped"], str)
        try:
            facts = JournalLine(**given)
            numbers = [facts.events, facts.length, facts.check, facts.bytes, *facts.stamp]
            if not all(type(number) is int and EVER[0] <= number <= EVER[1] for number in numbers):
                return False
            return list(self._source.stamp(facts.name)) == facts.stamp and self._is_intact(facts, handle)
        except (OSError, TypeError, ValueError, KeyError):
            return False

    def _is_intact(self, facts: JournalLine, handle: int) -> bool:
        """Return whether the next record on the disk is that of a line, and intact."""
        room = os.fstat(handle).st_size - self.end
        if not HEAD.size <= facts.length <= room or facts.length % ALIGNED or facts.bytes < 0:
            return False
        raw = np.empty(facts.length, np.uint8)
        try:
            read_into(handle, str(self.data), self.end, raw)
            head = head_of(raw, facts.length)
            first, last, begin, end, most = blocks_between(head.table, head.span[0], *EVER)
            t = events_of(head, first, last, raw[head.bytes :][begin:end], *EVER, most).t
        except ValueError:  # also a FormatError, or a BlockError
            return False
        return head.check == facts.check and t.size == facts.events and (int(t[0]), int(t[-1])) == head.span

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
        """Append a recording: first its record, then the journal line that makes it valid.

        Args:
            name: the recording.
            result: its facts and record, or the reason why it is left out.
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
