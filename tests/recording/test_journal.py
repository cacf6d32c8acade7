"""A journal of a recording by itself."""

import errno

import pytest

from nvsdata.recording import journal
from nvsdata.recording.journal import StreamJournal, left_over_message


def test_a_journal_holds_its_head_and_blocks_and_is_settled_each_second(tmp_path, monkeypatch):
    now, settled = [10.0], []
    monkeypatch.setattr(journal.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(journal.os, "fdatasync", lambda handle: settled.append(now[0]), raising=False)
    kept = StreamJournal(tmp_path / "a.h5", b"head")
    for now[0] in (10.5, 11.0, 11.25, 12.0, 12.25, 12.5):
        kept.write(b"ab")
    assert settled == [11.25, 12.5]
    assert kept.size == 12
    kept.close()
    kept.close()
    path = tmp_path / "a.h5.davis"
    assert path.read_bytes() == b"head" + 6 * b"ab"
    with pytest.raises(FileExistsError, match="is a recording that wasn't finished: `nvsdata convert "):
        StreamJournal(tmp_path / "a.h5", b"head")
    # one without a block is none, nor is one whose recording is whole
    StreamJournal(tmp_path / "b.h5", b"head").close()
    other = StreamJournal(tmp_path / "c.h5", b"head")
    other.write(b"ab")
    other.remove()
    assert [each.name for each in tmp_path.iterdir()] == ["a.h5.davis"]
    assert left_over_message(path.with_name("a b.h5.davis")).endswith(f"{path.with_name('a b.h5')}'` finishes it")


def test_a_journal_is_written_whole_or_is_none(tmp_path, monkeypatch):
    real, sizes = journal.os.write, []

    def little(handle, data):
        sizes.append(len(data))
        if len(sizes) > 4:
            raise OSError(errno.ENOSPC, "full")
        return real(handle, data[:3])

    monkeypatch.setattr(journal.os, "write", little)
    with pytest.raises(OSError, match="full"):
        StreamJournal(tmp_path / "a.h5", bytes(20))
    assert sizes == [20, 17, 14, 11, 8]
    assert list(tmp_path.iterdir()) == []
