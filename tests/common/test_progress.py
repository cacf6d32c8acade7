"""Progress bars on terminals, as a pseudo-terminal shows them."""

import os
import struct
import sys
from contextlib import suppress

import pytest

from nvsdata.common import progress

termios = pytest.importorskip("termios", reason="terminals as POSIX has them")


def shown_on_a_terminal(columns, monkeypatch):
    """What a bar draws on a terminal that reports so many columns."""
    import fcntl

    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    with open(theirs, "w") as stream:
        monkeypatch.setattr(sys, "stderr", stream)
        with progress.bar(None, "recording", total=4) as shown:
            shown.update(2)
            shown.refresh()
        monkeypatch.undo()
        os.set_blocking(ours, False)
        drawn = b""
        with suppress(OSError):
            while part := os.read(ours, 1 << 16):
                drawn += part
    os.close(ours)
    return [part for part in drawn.decode().replace("\n", "").split("\r") if part]


@pytest.mark.parametrize(("columns", "width"), [(0, 80), (100, 100)])
def test_a_terminal_without_a_size_has_progress_too(monkeypatch, columns, width):
    drawn = shown_on_a_terminal(columns, monkeypatch)
    assert "2/4" in drawn[-1]
    assert all(part.startswith("recording: ") for part in drawn)
    assert all(width - 2 <= len(part) <= width for part in drawn)
