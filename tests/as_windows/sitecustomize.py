"""Python as it is on Windows, as far as Linux can pretend it: for programs that have this folder in PYTHONPATH.

What POSIX alone has is gone from `os`, `signal` and `multiprocessing`, and so are its modules. A file that this process
has open or mapped can't be removed, renamed or replaced, and no new file has a name that Windows refuses.
"""

import multiprocessing
import multiprocessing.context
import multiprocessing.popen_spawn_posix
import os
import re
import signal
import sys

GONE = (
    "fork forkpty pread preadv pwrite pwritev posix_fallocate posix_fadvise sched_getaffinity"
    " sched_setaffinity setsid getpgid fdatasync fchmod fchown chown"
    " lchown O_NOFOLLOW O_NONBLOCK O_DIRECTORY O_CLOEXEC O_DSYNC O_SYNC nice getloadavg"
)
MODULES = "pwd", "grp", "termios", "tty", "pty", "syslog"
SIGNALS = "SIGHUP SIGQUIT SIGUSR1 SIGUSR2 SIGALRM SIGTSTP SIGPIPE"
REFUSED = re.compile(r'[<>:"|?*\\\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE)


def _needed_by_the_standard_library():
    """Import what looks for POSIX when it is imported: it is told apart by sys.platform, which stays as it is."""
    import asyncio  # noqa: F401
    import concurrent.futures.process  # noqa: F401
    import getpass  # noqa: F401
    import multiprocessing.resource_tracker  # noqa: F401
    import pathlib  # noqa: F401
    import pdb  # noqa: F401
    import platform  # noqa: F401
    import random  # noqa: F401
    import selectors  # noqa: F401
    import shutil
    import socketserver  # noqa: F401
    import tempfile  # noqa: F401
    import threading  # noqa: F401
    import uuid  # noqa: F401

    # Windows has no folders by their descriptors
    shutil._use_fd_functions = False


def _take_away():
    _needed_by_the_standard_library()
    for name in GONE.split():
        if hasattr(os, name):
            delattr(os, name)
    for name in SIGNALS.split():
        if hasattr(signal, name):
            delattr(signal, name)
    for name in MODULES:
        sys.modules[name] = None
    contexts = multiprocessing.context._concrete_contexts
    for name in ("fork", "forkserver"):
        contexts.pop(name, None)
    spawn = contexts["spawn"]
    multiprocessing.context._default_context._default_context = spawn
    multiprocessing.context._default_context._actual_context = None
    for one in (multiprocessing, multiprocessing.context._default_context):
        one.get_all_start_methods = lambda: ["spawn"]


def _held(path):
    """Whether this process has a file open, or mapped."""
    try:
        found = os.stat(path)
    except OSError:
        return False
    # nvsdata's own locks are told apart by sys.platform, and tests of theirs pretend that
    if os.path.isdir(path) or path.endswith(".lock"):
        return False
    for number in os.listdir("/proc/self/fd"):
        try:
            one = os.stat(f"/proc/self/fd/{number}")
        except OSError:
            continue
        if (one.st_dev, one.st_ino) == (found.st_dev, found.st_ino):
            return True
    with open("/proc/self/maps") as maps:
        return any(line.rstrip("\n").endswith(os.path.realpath(path)) for line in maps)


def _full(path, folder):
    path = os.fsdecode(path)
    return os.path.join(os.readlink(f"/proc/self/fd/{folder}"), path) if folder >= 0 else path


def _watch(event, args):
    if event == "os.remove":
        paths = [_full(args[0], args[1])]
    elif event == "os.rename":
        paths = [_full(args[0], args[2]), _full(args[1], args[3])]
        _check_name(paths[1])
    elif event == "os.mkdir":
        return _check_name(_full(args[0], args[2]))
    elif event == "open" and isinstance(args[0], str | bytes) and isinstance(args[2], int) and args[2] & os.O_CREAT:
        return _check_name(os.fsdecode(args[0]))
    else:
        return None
    for path in paths:
        if _held(path):
            raise PermissionError(13, "as on Windows: it is open in this process", path)
    return None


def _check_name(path):
    parts = [part for part in path.split("/") if part not in ("", ".", "..")]
    if parts[:1] not in (["dev"], ["proc"]) and any(map(REFUSED.search, parts)):
        raise OSError(22, "as on Windows: a name that it refuses", path)


_take_away()
sys.addaudithook(_watch)
