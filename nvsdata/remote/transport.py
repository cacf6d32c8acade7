"""Requests to remote file systems, by fsspec: repeated after failures, up to a deadline."""

from __future__ import annotations

import errno
import logging
import os
import random
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from email.utils import parsedate_to_datetime
from threading import Thread
from typing import Any, NoReturn, TypeVar

from nvsdata.common.errors import FormatError, line_of, shown
from nvsdata.remote.url import WEB, Url

T = TypeVar("T")

log = logging.getLogger(__name__)
DEADLINE = 120.0  # s until a request and all its repetitions must have succeeded
PAUSE, LONGEST_PAUSE = 0.1, 10.0  # s before the next try; each is twice as long as the one before, and random by half
LONG = 1.0  # s of trouble, after which the reason is logged once
SILENCE = 5.0  # s without an answer, before the first try is given up; each later try gets twice as long
SLOWEST = 2 << 20  # bytes/s that are added to this time
TRIES = 3  # requests of a range that a server must ignore, before it counts as a server without ranges
WRONG = 8  # answers of another length, after which the file is considered damaged
AGAIN = (408, 425, 429, 500, 502, 503, 504)  # HTTP statuses that may be temporary
REFUSED = (401, 403)
MISSING = (404, 410)
BEYOND = 416  # the range is beyond the end of the file
FINAL = (ImportError, NotImplementedError, ValueError, TypeError, AttributeError, IsADirectoryError)


class WrongLength(Exception):
    """A server sent more or fewer bytes than the range has, such as a page that reports an error."""


class _Silence(Exception):
    """A server didn't answer in time."""


def read_range(url: Url, begin: int, end: int, until: float | None = None) -> bytes:
    """Return bytes `begin` to `end` - 1 of a file.

    Args:
        url: the file.
        begin: the first byte.
        end: the byte after the last one.
        until: time of `time.monotonic` when it must have succeeded (default: `DEADLINE` from now).

    Raises:
        FileNotFoundError: there is no such file.
        PermissionError: the server refuses access.
        TimeoutError: all tries failed until the deadline.
        FormatError: the file is too short.
        ImportError: the package for this kind of URL isn't installed.
    """

    def read(system: Any, path: str) -> bytes:
        raw: bytes = system.cat_file(path, start=begin, end=end)
        if len(raw) != end - begin:
            raise WrongLength(f"the server sent {len(raw):,} bytes in place of {end - begin:,}")
        return raw

    return repeated(url, read, end - begin, until)


def check_ranges(url: Url) -> None:
    """Raise OSError if the server sends entire files only, which would be read again for each block."""
    if url.scheme not in WEB:
        return

    def second_byte(system: Any, path: str) -> bool:
        # fsspec's file object gives up before it reads an entire file; reads by `cat_file` don't
        with system.open(path, "rb", size=2, block_size=1, cache_type="none") as file:
            file.seek(1)
            try:
                return bool(file.read(1))
            except ValueError as error:
                if type(error) is not ValueError:
                    raise
                return False

    for number in range(TRIES):
        if repeated(url, second_byte):
            return
        # it may have been a page that reports an error
        time.sleep(PAUSE * number)
    reason = "the server has no range requests, and sends entire files only: download the store by other means"
    raise OSError(errno.ENOTSUP, reason, str(url))


def repeated(url: Url, act: Callable[[Any, str], T], size: int = 0, until: float | None = None) -> T:
    """Return `act(file system, path)`, tried again after failures that may be temporary.

    Args:
        url: the file.
        act: what to do; it must be safe to do it twice.
        size: bytes that it transfers.
        until: see `read_range`.

    Raises:
        OSError, ValueError, ImportError: see `read_range`.
    """
    until = time.monotonic() + DEADLINE if until is None else until
    reported = time.monotonic() + LONG
    pause, patience, wrong, reason = PAUSE, SILENCE + size / SLOWEST, 0, ""
    while True:
        try:
            return _within(min(patience, until - time.monotonic()), lambda: act(*_system(url)))
        except Exception as error:
            wrong += isinstance(error, WrongLength)
            _raise_final(url, error, wrong)
            wait = max(pause * random.uniform(0.5, 1.5), _wished_pause(error))
            # what a server answered says more than silence, which the deadline may have cut short
            reason = reason if reason and isinstance(error, _Silence) else _reason(url, error)
            if time.monotonic() + wait >= until:
                late = f"no success within {DEADLINE:g} s: {reason}"
                # a TimeoutError
                raise OSError(errno.ETIMEDOUT, late, str(url)) from None
            if time.monotonic() + wait >= reported:
                reported = until
                left = until - time.monotonic()
                log.warning("%s: %s; trying again, up to %.0f s", shown(url), shown(reason), left)
        time.sleep(wait)
        pause, patience = min(2 * pause, LONGEST_PAUSE), 2 * patience


def _system(url: Url) -> tuple[Any, str]:
    """Return the file system of a URL, which is the same for all URLs of a server, and the path in it."""
    from fsspec.core import url_to_fs

    # folders of this computer, which aren't made on writing by default as those of object stores are
    options = {"auto_mkdir": True} if url.scheme == "file" else {}
    found: tuple[Any, str] = url_to_fs(url.address, **options)
    return found


def _within(seconds: float, act: Callable[[], T]) -> T:
    """Return `act()`, which runs in another thread; _Silence if it takes longer. It isn't stopped then."""
    done: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            done.append(act())
        except BaseException as error:
            failed.append(error)

    # a daemon: the process can end while it waits
    thread = Thread(target=run, name="nvsdata-remote", daemon=True)
    thread.start()
    seconds = max(seconds, 0.001)
    thread.join(seconds)
    if done:
        return done[0]
    raise failed[0] if failed else _Silence(f"no answer for {seconds:.3g} s")


def _raise_final(url: Url, error: Exception, wrong: int) -> None:
    """Raise the error that the user sees, unless another try may succeed."""
    if isinstance(error, ImportError):
        raise _not_installed(url, error) from None
    status = _status(error)
    if status in REFUSED or isinstance(error, PermissionError) or _is_about_credentials(error):
        _fail(url, errno.EACCES, "the server refuses access: check the credentials", status)
    if status in MISSING or isinstance(error, FileNotFoundError):
        _fail(url, errno.ENOENT, "no such file", status)
    if status == BEYOND or wrong >= WRONG:
        raise FormatError(str(url), f"is shorter than it states: {_reason(url, error)}") from None
    if any(isinstance(one, socket.gaierror) and one.errno == socket.EAI_NONAME for one in _chain(error)):
        _fail(url, errno.ENXIO, "no such server", status)
    if isinstance(error, FINAL) or "validation" in type(error).__name__.lower():
        known = "Protocol not known" not in str(error)
        reason = _reason(url, error) if known else f"fsspec has no protocol {url.scheme}://"
        raise FormatError(str(url), reason) from None
    if status and status not in AGAIN and status >= 400:
        _fail(url, errno.EIO, "the server refuses the request", status)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EROFS, errno.EMFILE, errno.ENFILE):
        raise error


def _fail(url: Url, number: int, reason: str, status: int) -> NoReturn:
    raise OSError(number, f"{reason} (HTTP {status})" if status else reason, str(url)) from None


def _not_installed(url: Url, error: ImportError) -> ImportError:
    if (error.name or "").partition(".")[0] == "fsspec":
        return ImportError(f"{url}: pip install 'nvsdata[remote]'")
    return ImportError(f"{url}: {line_of(error)} (pip install 'nvsdata[remote]' has what http:// and https:// need)")


def _is_about_credentials(error: BaseException) -> bool:
    return any("credential" in type(one).__name__.lower() for one in _chain(error))


def _chain(error: BaseException) -> Iterator[BaseException]:
    """Yield an error and its causes."""
    found: BaseException | None = error
    for _ in range(10):
        if found is None:
            return
        yield found
        found = found.__cause__ or found.__context__ or getattr(found, "os_error", None)


def _status(error: BaseException) -> int:
    """Return the HTTP status that caused an error; 0 if there is none.

    It is an attribute of aiohttp's errors, of the answer in those of requests, and in a dict in those of botocore.
    """
    for one in _chain(error):
        if type(one).__module__ == "aiohttp.http_exceptions":
            # a body that was cut has the code 400 there
            continue
        answer = getattr(one, "response", None)
        if isinstance(answer, Mapping):
            found = answer.get("ResponseMetadata", {}).get("HTTPStatusCode")
        else:
            found = getattr(answer, "status_code", None) or getattr(one, "status", None) or getattr(one, "code", None)
        if str(found).isdecimal():
            return int(str(found))
    return 0


def _wished_pause(error: BaseException) -> float:
    """Return the s that a server asks to wait before the next request; 0 if it doesn't."""
    for one in _chain(error):
        answer = getattr(one, "response", None)
        found = getattr(one, "headers", None) or getattr(answer, "headers", None)
        if isinstance(answer, Mapping):
            found = answer.get("ResponseMetadata", {}).get("HTTPHeaders")
        if isinstance(found, Mapping):
            wish = next((str(value) for name, value in found.items() if str(name).lower() == "retry-after"), "")
            return _seconds(wish.strip())
    return 0.0


def _seconds(wish: str) -> float:
    """Return the s that a header Retry-After states: a number, or a date."""
    if wish.isdecimal():
        return float(wish[:9])
    try:
        return max(parsedate_to_datetime(wish).timestamp() - time.time(), 0.0)
    except (ValueError, TypeError, OverflowError):
        return 0.0


def _reason(url: Url, error: BaseException) -> str:
    """Return why a try failed, without the address, which may have a password."""
    if isinstance(error, WrongLength | _Silence):
        return str(error)
    if status := _status(error):
        return f"HTTP {status}"
    kind = type(error).__name__
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    return kind if url.has_secrets or not str(error) else f"{line_of(error)} ({kind})"
