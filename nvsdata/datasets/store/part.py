"""The unfinished store: progress of a packing run, from which the next run continues."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Self

import numpy as np

from nvsdata.common.files import MOST_LINES, append_own, json_line, parsed_line, read_own, remove_link, write_all
from nvsdata.data.events import EVER, LATEST, check_sensor_size
from nvsdata.datasets.base import EventDataset
from nvsdata.datasets.store.reader import COLUMNS, VERSION, crc_of
from nvsdata.kernels.decode.order import is_sorted

JOURNAL = "journal.jsonl"


class Part:
    """A folder with a raw file per column and a journal with a line per recording. To be used in a `with` block.

    The first line of the journal identifies the dataset. The recordings of an earlier run are reused up to the first
    recording that has changed, is missing, or whose events on the disk differ from those that were written.

    Args:
        folder: the folder, made if needed.
        dataset: the dataset that is packed.
        names: names of its recordings.

    Attributes:
        facts: journal lines of the packed recordings.
        skipped: recordings that weren't packed, name to reason.
        events: number of events so far.
    """

    def __init__(self, folder: Path, dataset: EventDataset, names: list[str]) -> None:
        self.folder, self._source = folder, dataset.source
        self.facts: list[dict[str, Any]] = []
        self.events = 0
        reasons = dataset.source.left_out
        self.skipped = {name: reasons.get(name, "empty") for name in dataset.skipped}
        # bytes suffice if all recordings are opened with a small size; if each file states its own, a later one may be
        # larger
        size = dataset.opened_with
        kind = np.dtype(np.uint8 if size is not None and max(size) <= 256 else np.uint16)
        self.kinds = {"t": np.dtype(np.int64), "x": kind, "y": kind, "p": np.dtype(np.uint8)}
        self._head = {
            "version": VERSION,
            "dataset": dataset.info.name,
            "root": str(dataset.root.resolve()),
            "kinds": [kind.str for kind in self.kinds.values()],
            "opened_with": list(dataset.opened_with or ()),
        }
        remove_link(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for name in self.kinds:
            append_own(folder / name).close()
        self._resume(set(names))

    @property
    def done(self) -> set[str]:
        """Names of the recordings that are packed or left out."""
        return {facts["name"] for facts in self.facts} | set(self.skipped)

    def raw(self) -> dict[str, np.ndarray]:
        """Return the columns of all recordings packed so far, in sequence."""
        # an empty file can't be mapped, but without events no store is written
        return {name: np.memmap(self.folder / name, kind, "r") for name, kind in self.kinds.items()}

    def _resume(self, names: set[str]) -> None:
        journal = self.folder / JOURNAL
        lines = read_own(journal, MOST_LINES).splitlines(keepends=True) if journal.exists() else []
        valid = 0  # bytes of the journal
        # a line without its end was cut off
        lines = [line for line in lines if line.endswith(b"\n")]
        if lines and parsed_line(lines[0]) == self._head:
            valid = len(lines[0])
            with ExitStack() as stack:
                columns = [stack.enter_context((self.folder / name).open("rb")) for name in self.kinds]
                for line in lines[1:]:
                    facts = parsed_line(line)
                    if facts is None or not _is_valid(facts, names) or not self._is_intact(facts, columns):
                        break
                    valid += len(line)
                    # recordings left out are tried again, because they may have been repaired
                    if "skipped" not in facts:
                        self._note(facts)
                        names.remove(facts["name"])
        with append_own(journal) as file:
            file.truncate(valid)
            if not valid:
                write_all(file.fileno(), json_line(self._head).encode())
        for name, kind in self.kinds.items():
            os.truncate(self.folder / name, self.events * kind.itemsize)

    def _is_intact(self, facts: dict[str, Any], columns: Sequence[IO[bytes]]) -> bool:
        """Return whether a recording in the journal is unchanged and its events are in the raw files."""
        if "skipped" in facts:
            return True
        try:
            if list(self._source.stamp(facts["name"])) != facts["stamp"]:
                return False
            t, x, y, p = found = self._next(facts["events"], columns)
        except OSError:
            return False
        width, height = facts["size"]
        possible = x.max() < width and y.max() < height and p.max() <= 1 and t[0] == 0 and is_sorted(t)
        return bool(possible and facts["base"] + int(t[-1]) < LATEST and crc_of(found) == facts["crc"])

    def _next(self, count: int, columns: Sequence[IO[bytes]]) -> list[np.ndarray]:
        """Return the next `count` events in the raw files; OSError if there are fewer."""
        found = []
        for file, kind in zip(columns, self.kinds.values(), strict=True):
            if os.fstat(file.fileno()).st_size < (self.events + count) * kind.itemsize:
                raise OSError(f"{file.name} is shorter than its journal says")
            file.seek(self.events * kind.itemsize)
            found.append(np.frombuffer(file.read(count * kind.itemsize), kind))
        return found

    def _note(self, line: dict[str, Any]) -> None:
        if "skipped" in line:
            self.skipped[line["name"]] = line["skipped"]
            return
        self.facts.append(line)
        self.events += line["events"]

    def __enter__(self) -> Self:
        # unbuffered, so that errors of the disk show at once
        self._columns = {name: append_own(self.folder / name) for name in COLUMNS}
        self._journal = append_own(self.folder / JOURNAL)
        return self

    def __exit__(self, *_: object) -> None:
        for file in (*self._columns.values(), self._journal):
            file.close()

    def add(self, name: str, result: tuple[dict[str, Any], list[np.ndarray]] | str) -> None:
        """Append a recording: first its columns, then the journal line that makes it valid.

        Args:
            name: the recording.
            result: its facts and columns, or the reason why it is left out.
        """
        line: dict[str, Any]
        if isinstance(result, str):
            line = {"name": name, "skipped": result}
        else:
            facts, columns = result
            stored = [
                np.ascontiguousarray(values, kind) for values, kind in zip(columns, self.kinds.values(), strict=True)
            ]
            for file, values in zip(self._columns.values(), stored, strict=True):
                write_all(file.fileno(), values.data)
            line = facts | {"crc": crc_of(stored)}
        write_all(self._journal.fileno(), json_line(line).encode())
        self._note(line)


def _is_valid(facts: dict[str, Any], names: set[str]) -> bool:
    """Return whether a line of the journal has valid facts about one of the recordings `names`."""
    if not isinstance(facts.get("name"), str) or facts["name"] not in names:
        return False
    if "skipped" in facts:
        return isinstance(facts["skipped"], str)
    try:
        check_sensor_size(facts["size"])
        numbers = [
            *facts["size"],
            *facts["stamp"],
            *facts["time"],
            *(facts[name] for name in ("events", "bytes", "crc")),
        ]
        return (
            all(type(number) is int and EVER[0] <= number <= EVER[1] for number in (*numbers, facts["base"]))
            and -LATEST < facts["base"] < LATEST
            and facts["events"] > 0
            and facts["bytes"] >= 0
            and len(facts["time"]) == 2
            and isinstance(facts["format"], str)
        )
    except (KeyError, TypeError, ValueError):
        return False
