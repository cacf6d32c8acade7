"""What errors, checks, tables and endings say, to the letter and to the last value."""

import errno
import io
import pickle
import signal
import threading

import pytest

from nvsdata import FormatError
from nvsdata.common import validation as check
from nvsdata.common.errors import line_of, shown
from nvsdata.common.signals import ENDING, Ended, end_of, ending_by_signals, exit_code
from nvsdata.common.terminal import Terminal, say
from nvsdata.common.text import aligned

NAN, INF = float("nan"), float("inf")

CHECKS = {
    "positive": (check.positive, (), [5e-324, 1, 1e308], [0, -1, NAN, INF], "must be positive, not {}"),
    "not negative": (check.not_negative, (), [0, 5e-324], [-5e-324, -1, NAN, INF], "must not be negative, not {}"),
    "probability": (
        check.probability,
        (),
        [0, 0.5, 1],
        [-1e-9, 1 + 1e-9, NAN, INF],
        "must be between 0 and 1, not {}",
    ),
    "at least": (check.at_least, (3,), [3, 3.5], [3 - 1e-9, NAN, INF], "must be at least 3, not {}"),
    "whole": (check.whole, (), [0, 1, 2.0], [-1, 0.5, NAN, INF], "must be a whole number of at least 0, not {}"),
    "whole from 3": (check.whole, (3,), [3, 4.0], [2, 3.5], "must be a whole number of at least 3, not {}"),
    "from 1 µs": (check.microseconds, (), [1, 5.0], [0, -3], "must be positive, not {}"),
    "µs": (check.whole_microseconds, (), [0, -3, 5.0, 1000], [NAN, INF, 1000.5, -0.5], "counts whole µs, not {}"),
}


@pytest.mark.parametrize("name", CHECKS)
def test_settings_are_checked_to_the_last_value(name):
    checked, more, taken, refused, message = CHECKS[name]
    for value in taken:
        checked("size", value, *more)
    for value in refused:
        with pytest.raises(ValueError, match="size ") as raised:
            checked("size", value, *more)
        assert str(raised.value) == f"size {message.format(value)}"


@pytest.mark.parametrize(
    ("value", "meant"), [(0.5, "500000"), (999.5, "999500000"), (1e-7 * 6, "1"), (0.0000004, "0"), (0.033333, "33333")]
)
def test_a_fraction_of_a_microsecond_was_meant_in_seconds(value, meant):
    for checked in (check.whole_microseconds, check.microseconds):
        with pytest.raises(ValueError, match="whole") as raised:
            checked("size", value)
        assert str(raised.value) == f"size counts whole µs, not {value} ({value} s are {meant})"


def test_factors_and_transforms_are_checked():
    check.factors(0.5, 0.5)
    check.factors(0.5, 2)
    for low, high, message in (
        (0, 1, "low must be"),
        (1, 0, "high must be p"),
        (2, 1, "high must be at least low, not 1"),
    ):
        with pytest.raises(ValueError, match=f"^{message}"):
            check.factors(low, high)
    check.transform(len)
    with pytest.raises(TypeError, match=r"^a transform must be callable, not 5$"):
        check.transform(5)


def test_names_are_shown_on_one_line():
    assert shown("a b.h5") == "a b.h5"
    assert shown("a\nb\x1bμ\udcff'.h5") == "a\\nb\\x1bμ\\udcff'.h5"


@pytest.mark.parametrize(
    ("given", "offset", "path", "reason", "text"),
    [
        (("a.bin", "cut off"), None, "a.bin", "cut off", "a.bin: cut off"),
        (("a.bin", "cut off"), 0, "a.bin", "cut off", "a.bin: byte 0: cut off"),
        (("a\nb", "cut off"), 7, "a\nb", "cut off", "a\\nb: byte 7: cut off"),
        (("", "cut off"), None, "", "cut off", "cut off"),
        (("all that a worker said",), None, "", "all that a worker said", "all that a worker said"),
    ],
)
def test_what_format_errors_hold_and_say(given, offset, path, reason, text):
    error = FormatError(*given, offset=offset)
    for each in (error, pickle.loads(pickle.dumps(error))):
        assert (each.path, each.reason, each.offset, str(each)) == (path, reason, offset, text)


def test_messages_of_others_become_a_line():
    assert line_of(ValueError("  a\n b\t\tc ")) == "a b c"
    assert line_of(ValueError("x" * 301)) == "x" * 300
    assert line_of(KeyError()) == "KeyError"


def test_tables_are_aligned():
    rows = [("a", "bbb"), ("cc", "d")]
    assert aligned(rows) == " a  bbb\ncc    d"
    assert aligned(rows, left=True) == "a   bbb\ncc  d"


class Closed(io.StringIO):
    """A terminal that was closed."""

    def write(self, text=""):
        raise OSError(errno.EIO, "closed")

    flush = write


def test_messages_go_to_a_terminal_if_there_is_one(capsys):
    say("said")
    assert capsys.readouterr() == ("", "said\n")
    stream = io.StringIO()
    say("said", stream)
    assert stream.getvalue() == "said\n"
    say("lost", Closed())
    assert Terminal(Closed()).write("lost") == 4
    assert Terminal(stream).getvalue() == "said\n"


def test_a_signal_ends_a_command_as_ctrl_c_does():
    usual = [signal.getsignal(number) for number in ENDING]
    for number, name in zip(ENDING, ("SIGTERM", "SIGHUP"), strict=False):
        with pytest.raises(Ended, match=f"^{name}$") as raised, ending_by_signals():  # noqa: PT012  it must be set
            assert signal.getsignal(number) is not signal.SIG_DFL
            signal.raise_signal(number)
        assert raised.value.number == number
        assert exit_code(raised.value) == 128 + number
        assert end_of(raised.value) == f"ended by {name}"
    assert [signal.getsignal(number) for number in ENDING] == usual
    assert exit_code(KeyboardInterrupt()) == 130
    assert end_of(KeyboardInterrupt()) == "interrupted"


def handler(number, frame):
    """A program's own."""


@pytest.mark.parametrize("own", [signal.SIG_IGN, handler])
def test_what_ignores_or_handles_signals_goes_on_doing_so(own):
    number = ENDING[-1]
    before = signal.signal(number, own)
    try:
        with ending_by_signals():
            assert signal.getsignal(number) is own
        assert signal.getsignal(number) is own
    finally:
        signal.signal(number, before)


def test_threads_leave_signals_alone():
    found = []

    def look():
        with ending_by_signals():
            found.append([signal.getsignal(number) for number in ENDING])

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [[signal.getsignal(number) for number in ENDING]]
