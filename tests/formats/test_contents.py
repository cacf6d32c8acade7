"""The bytes of files, from memory and from the disk, and the lines that headers begin with."""

import numpy as np
import pytest
import trees

import nvsdata
from nvsdata import FormatError
from nvsdata.formats import contents
from nvsdata.formats.contents import HEAD, Contents, header_lines

LONG, SHORT = HEAD + 1_000, 1_000


@pytest.fixture(params=[SHORT, HEAD - 1, HEAD, LONG])
def opened(tmp_path, request):
    """The contents of a file, and all of its bytes."""
    raw = np.random.default_rng(0).integers(0, 256, request.param, np.uint8).tobytes()
    (tmp_path / "a").write_bytes(raw)
    return Contents(str(tmp_path / "a"), raw[:HEAD]), raw


def test_any_bytes_are_read(opened):
    found, raw = opened
    end = len(raw)
    assert found.size == end
    assert (found.stamp is None) == (end < HEAD)
    for start, stop in ((0, 0), (0, 1), (3, 500), (0, end), (end - 1, end), (end, end), (min(end, HEAD) - 9, end)):
        read = found.read(start, stop)
        assert read.tobytes() == raw[start:stop]
        assert not read.flags.writeable
        assert b"".join(piece.tobytes() for piece in found.pieces(start, stop, 7_001)) == raw[start:stop]
        for step, size in ((40, 1), (100, 3), (101, 1), (99, 99)):
            rows = found.samples(start, stop - size + 1, step, size)
            assert rows.tobytes() == b"".join(raw[at : at + size] for at in range(start, stop - size + 1, step))
            assert rows.shape == (len(range(start, stop - size + 1, step)), size)
    ranges = [(5, 9), (2, 2), (0, 700), (end - 3, end)]
    pieces = [(piece.tobytes(), piece.flags.writeable) for piece in found.ranges(ranges)]
    assert pieces == [(raw[start:stop], False) for start, stop in ranges]


def test_a_piece_longer_than_the_kept_buffers(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "PIECE", 100)
    monkeypatch.setattr(contents, "_BUFFERS", [])
    raw = np.random.default_rng(0).integers(0, 256, LONG, np.uint8).tobytes()
    (tmp_path / "a").write_bytes(raw)
    found = Contents(str(tmp_path / "a"), raw[:HEAD])
    found.drop_head()
    for step, kept in ((99, 1), (100, 1), (101, 1)):
        assert b"".join(piece.tobytes() for piece in found.pieces(0, 1_000, step)) == raw[:1_000]
        assert [room.size for room in contents._BUFFERS] == [100] * kept
    # two at a time have a buffer each
    for a, b in zip(found.pieces(0, 500, 50), found.pieces(500, 1_000, 50), strict=True):
        assert a.tobytes() + b.tobytes() in (raw[k : k + 50] + raw[k + 500 : k + 550] for k in range(0, 500, 50))
    assert [room.size for room in contents._BUFFERS] == [100, 100]


def test_samples_of_a_file_cut_meanwhile_name_the_first_missing_byte(tmp_path, monkeypatch):
    raw = bytes(LONG)
    (tmp_path / "a").write_bytes(raw)
    found = Contents(str(tmp_path / "a"), raw[:HEAD])
    monkeypatch.setattr(type(found._file), "check", lambda self, status: (tmp_path / "a").write_bytes(raw[:250]))
    with pytest.raises(FormatError, match="truncated while it was read") as caught:
        found.samples(10, 1_000, 100, 5)
    assert caught.value.offset == 310


def slow_lines(data, mark, printable):
    """Line by line: those that begin with the mark and are printable, the byte after them, whether more may follow."""
    lines, end = [], 0
    for line in data.splitlines(keepends=True):
        if not line.startswith(mark) or any(byte not in printable for byte in line.rstrip(b"\n")):
            return lines, end, False
        if not line.endswith(b"\n"):
            return lines, end, True
        lines.append(line.decode("latin-1").rstrip("\r\n"))
        end += len(line)
        if lines[-1].lower() in ("#end of ascii header", "#!end-header", "% end"):
            return lines, end, False
    return lines, end, True


ASCII = {*b"\t\r", *range(32, 127)}


@pytest.mark.parametrize("mark", [b"#", b"%"])
@pytest.mark.parametrize(
    "data",
    [
        b"@ a\r\n@ b\n@ c",
        b"@ a\r\n@ b\n",
        b"@ a\r\n@ b\nevents",
        b"@\n@\n\n@ a\n",
        b"@ a\x07\n@ b\n",
        b"@ a\n@ b\x00",
        b"@ \tall \x20\x7e\n@ \x1f\n",
        b"@ a\n@ \x7f\n",
        b"@ a\n@ \x80\n@ \xff\n@ b\n",
        b"# a\n#End Of ASCII Header\r\n# b\n",
        b"# a\n#!END-HEADER\r\n# b\n",
        b"% a\n% end\n% b\n",
        b"",
        b"x",
    ],
)
def test_lines_of_a_header(mark, data):
    data = data.replace(b"@", mark)
    printable = ASCII if mark == b"#" else ASCII | set(range(128, 256))
    assert header_lines(data, mark) == slow_lines(data, mark, printable)


@pytest.mark.parametrize("length", [10, HEAD - 30, HEAD - 5, HEAD, 4 * HEAD + 3, 9 * HEAD])
@pytest.mark.parametrize("after", [b"", b"#!END-HEADER\r\n# no line", b"\0\1"])
def test_headers_longer_than_what_is_read_first(tmp_path, length, after):
    line = b"# " + b"x" * 1_000 + b"\r\n"
    raw = (line * (length // len(line) + 1))[:length] + b"\r\n" + after
    raw = raw.replace(b"\r\r\n", b"\r\n")
    (tmp_path / "a").write_bytes(raw)
    lines, end, _ = slow_lines(raw, b"#", ASCII)
    assert Contents(str(tmp_path / "a"), raw[:HEAD]).header(b"#") == (lines, end)


def test_a_header_without_end_is_refused(tmp_path, monkeypatch):
    """Each line takes more memory than it has bytes, and time."""
    monkeypatch.setattr(contents, "MOST_HEADER", 2 * HEAD)
    raw = b"#\n" * 4 * HEAD
    (tmp_path / "a").write_bytes(raw)
    with pytest.raises(FormatError, match=f"the header has more than {2 * HEAD} bytes"):
        Contents(str(tmp_path / "a"), raw[:HEAD]).header(b"#")
    raw = b"#\n" * HEAD + b"events"
    (tmp_path / "a").write_bytes(raw)
    assert Contents(str(tmp_path / "a"), raw[:HEAD]).header(b"#")[1] == 2 * HEAD


@pytest.mark.parametrize("kind", [".aedat", ".aedat1", ".dat", ".evt3.raw"])
@pytest.mark.parametrize("strict", [True, False])
def test_text_of_a_header_that_is_cut_off_is_no_event(tmp_path, kind, strict):
    path = tmp_path / f"a{kind}"
    nvsdata.write(trees.some(0, 60, (128, 128)), path)
    raw = path.read_bytes()
    # within the second line
    path.write_bytes(raw[: raw.index(b"\n") + 14])
    with pytest.raises(FormatError, match="cut off within a line of its header"):
        nvsdata.read(path, strict=strict)
