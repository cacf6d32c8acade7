import errno
import os
import re
import sys
import time
from email.utils import formatdate
from types import SimpleNamespace

import fsspec
import pytest
from remote_server import FAULTS, serving

from nvsdata import FormatError
from nvsdata.remote import transport
from nvsdata.remote.transport import check_ranges, read_range
from nvsdata.remote.url import Url

CONTENT = bytes(range(256)) * 100


@pytest.fixture
def server(tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "files/a.bin").write_bytes(CONTENT)
    with serving(tmp_path / "files") as server:
        yield server


@pytest.fixture
def pauses(monkeypatch):
    """The pauses between tries, which take no time; the clock moves on by them."""
    found = []
    clock = SimpleNamespace(sleep=found.append, monotonic=lambda: time.monotonic() + sum(found), time=time.time)
    monkeypatch.setattr(transport, "time", clock)
    return found


def url(server, query=""):
    return Url(f"{server.url}/a.bin{query}")


def first(*faults):
    """The first requests have these faults."""
    return lambda number: faults[number] if number < len(faults) else None


def test_a_range_is_read(server):
    assert read_range(url(server), 1_000, 3_000) == CONTENT[1_000:3_000]
    assert server.done == {"requests": 1, "bytes": 2_000}


# altered bytes have the right length: the checksums of the store find them
@pytest.mark.parametrize("fault", [fault for fault in FAULTS if fault != "altered"] + ["whole", "500", "429", "408"])
def test_requests_are_repeated_after_each_fault(server, fault, monkeypatch):
    if fault == "delay":
        server.late = 30.0
        monkeypatch.setattr(transport, "SILENCE", 0.2)
    server.faults = first(fault, fault)
    assert read_range(url(server), 1_000, 3_000) == CONTENT[1_000:3_000]
    # on a busy computer, an answer may be late without a fault
    assert server.done["requests"] == 3 or fault == "delay"


def test_pauses_grow_up_to_a_limit_and_are_random(server, pauses, monkeypatch):
    monkeypatch.setattr(transport, "PAUSE", 0.1)
    server.faults = first(*["503"] * 10)
    read_range(url(server), 0, 10)
    assert len(pauses) == 10
    for number, pause in enumerate(pauses):
        usual = min(0.1 * 2**number, transport.LONGEST_PAUSE)
        assert usual / 2 <= pause <= 1.5 * usual
    assert len({round(pause / 0.1 / 2**number, 6) for number, pause in enumerate(pauses[:6])}) == 6


@pytest.fixture
def messages(monkeypatch):
    """The messages that are logged."""
    found = []
    monkeypatch.setattr(transport.log, "warning", lambda text, *given: found.append(text % given))
    return found


@pytest.mark.parametrize(("failures", "reported"), [(2, 0), (3, 1), (9, 1)])
def test_trouble_that_lasts_is_reported_once(server, pauses, messages, monkeypatch, failures, reported):
    # pauses of 6, 10, 10 ... s; a busy computer adds less than to the next one
    monkeypatch.setattr(transport, "PAUSE", 6.0)
    monkeypatch.setattr(transport, "LONG", 25.0)
    monkeypatch.setattr(transport.random, "uniform", lambda low, high: (low + high) / 2)
    server.faults = first(*["503"] * failures)
    read_range(url(server), 0, 10)
    assert len(messages) == reported
    for message in messages:
        assert re.fullmatch(rf"{re.escape(str(url(server)))}: .*503.*; trying again, up to \d+ s", message)


def test_silence_is_reported_after_the_first_try(server, pauses, messages, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.2)
    monkeypatch.setattr(transport, "LONG", 0.1)
    server.faults = first("delay")
    read_range(url(server), 0, 10)
    assert len(messages) == 1
    assert "no answer for 0.2 s" in messages[0]


def test_what_is_reported_is_safe_for_a_terminal(pauses, messages, monkeypatch):
    monkeypatch.setattr(transport, "LONG", 0.0)
    errors = iter([OSError("\x1b[31m of a server")])

    def act(system, path):
        for error in errors:
            raise error

    transport.repeated(Url("http://localhost/\x1b.nvs"), act)
    assert re.fullmatch(r"http://localhost/\\x1b\.nvs: \\x1b\[31m of a server \(OSError\); .*", *messages)


def test_a_long_pause_that_the_server_asks_for_is_reported(server, pauses, messages):
    server.faults, server.retry_after = first("busy"), "17"
    read_range(url(server), 0, 10)
    assert len(messages) == 1


def test_the_pause_that_the_server_asks_for_is_kept(server, pauses):
    server.faults, server.retry_after = first("busy"), "17"
    read_range(url(server), 0, 10)
    assert pauses == [17]


def test_the_pause_may_be_given_as_a_date(server, pauses):
    server.faults, server.retry_after = first("busy"), formatdate(time.time() + 30, usegmt=True)
    read_range(url(server), 0, 10)
    assert 20 < pauses[0] <= 30
    server.count, server.retry_after = iter(range(100)), "soon"
    read_range(url(server), 0, 10)
    assert pauses[1] < 1


def test_a_pause_beyond_the_deadline_is_not_waited_for(server, pauses):
    server.faults, server.retry_after = first("busy"), "3600"
    with pytest.raises(TimeoutError, match=r"no success within 120 s: HTTP 503") as raised:
        read_range(url(server), 0, 10)
    assert not pauses
    assert raised.value.errno == errno.ETIMEDOUT
    assert raised.value.filename == str(url(server))


@pytest.mark.parametrize("fault", ["drop", "page", "busy", "delay"])
def test_nothing_takes_longer_than_the_deadline(server, fault, monkeypatch):
    monkeypatch.setattr(transport, "DEADLINE", 0.4)
    monkeypatch.setattr(transport, "WRONG", 10_000)
    server.late, server.faults = 30.0, lambda number: fault
    with pytest.raises(TimeoutError, match=r"no success within 0\.4 s"):
        read_range(url(server), 0, 10)
    # after a delay, the server would have sent them
    assert "bytes" not in server.done


@pytest.mark.parametrize(
    ("fault", "kind", "reason"),
    [
        ("401", PermissionError, r"check the credentials \(HTTP 401\)"),
        ("403", PermissionError, r"check the credentials \(HTTP 403\)"),
        ("404", FileNotFoundError, "no such file"),
        ("410", FileNotFoundError, "no such file"),
        ("400", OSError, r"refuses the request \(HTTP 400\)"),
        ("416", FormatError, "is shorter than it states"),
        ("page", FormatError, "is shorter than it states: the server sent 64 bytes in place of 10"),
    ],
)
def test_what_another_try_cannot_change_is_reported_without_secrets(server, fault, kind, reason, pauses):
    server.faults = lambda number: fault
    with pytest.raises(kind, match=reason) as raised:
        read_range(url(server, "?signature=secret"), 0, 10)
    assert server.done["requests"] == (1 if fault.isdecimal() else transport.WRONG)
    assert "secret" not in str(raised.value)
    assert "a.bin?..." in str(raised.value)


def test_an_unknown_error_is_named_by_its_kind_if_the_url_has_secrets(monkeypatch, pauses):
    class Odd(Exception):
        pass

    def fail(*_, **__):
        raise Odd("no way to https://me:secret@host")

    monkeypatch.setattr(transport, "_system", lambda url: (fail(), ""))
    with pytest.raises(TimeoutError, match="Odd") as raised:
        read_range(Url("https://me:secret@host/a"), 0, 10)
    assert "secret" not in str(raised.value)
    with pytest.raises(TimeoutError, match=r"no way to .* \(Odd\)"):
        read_range(Url("s3://host/a"), 0, 10)


def test_invalid_parameters_are_no_reason_to_try_again(pauses):
    class ParamValidationError(Exception):
        pass

    def act(system, path):
        raise ParamValidationError("no key")

    with pytest.raises(FormatError, match="no key"):
        transport.repeated(Url("memory://a"), act)
    assert not pauses


def test_missing_credentials_are_no_reason_to_try_again(monkeypatch, pauses):
    class NoCredentialsError(Exception):
        pass

    def fail(url):
        raise NoCredentialsError("key=secret")

    monkeypatch.setattr(transport, "_system", fail)
    with pytest.raises(PermissionError, match="check the credentials") as raised:
        read_range(Url("s3://bucket/a"), 0, 10)
    assert "secret" not in str(raised.value)
    assert not pauses


def test_the_status_and_pause_of_errors_of_botocore_and_requests_are_understood(pauses):
    class Slow(Exception):
        def __init__(self):
            self.response = {"ResponseMetadata": {"HTTPStatusCode": 503, "HTTPHeaders": {"retry-after": "7"}}}

    class Answer:
        status_code, headers = 429, {"Retry-After": "9"}

    class Many(Exception):
        response = Answer()

    wrapped = OSError("slow down")
    wrapped.__cause__ = Slow()
    left = [wrapped, Many()]

    def act(system, path):
        if left:
            raise left.pop(0)
        return 5

    assert transport.repeated(Url("memory://a"), act) == 5
    assert pauses == [7, 9]


def test_servers_without_ranges_are_refused(server):
    check_ranges(url(server))
    server.faults = first("whole", "whole")
    # a page that reports an error may come in place of a range
    check_ranges(url(server))
    server.faults = lambda number: "whole"
    os.truncate(server.root / "a.bin", 1 << 30)
    with pytest.raises(OSError, match="has no range requests"):
        check_ranges(url(server))
    # the file isn't read
    assert server.done["bytes"] < 1 << 30


def test_unknown_protocols_and_missing_packages_are_named(monkeypatch):
    with pytest.raises(FormatError, match="s9://a/b: fsspec has no protocol s9://"):
        read_range(Url("s9://a/b"), 0, 10)
    fsspec.register_implementation("s8", "nowhere.File", clobber=True, errtxt="Install nowhere")
    with pytest.raises(ImportError, match="s8://a/b: Install nowhere"):
        read_range(Url("s8://a/b"), 0, 10)
    for name in ("fsspec", "fsspec.core"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r"s8://a/b: pip install 'nvsdata\[remote\]'"):
        read_range(Url("s8://a/b"), 0, 10)


def test_an_unknown_server_is_no_reason_to_try_again(pauses):
    with pytest.raises(OSError, match="no such server"):
        read_range(Url("http://nowhere.invalid/a"), 0, 10)
    assert not pauses
