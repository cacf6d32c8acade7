# PYTHON_ARGCOMPLETE_OK
"""The `nvsdata` command: a table of commands, each in a module that is imported when it is called."""

from __future__ import annotations

import argparse
import logging
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NamedTuple, NoReturn


class Command(NamedTuple):
    """A line of the table: the module in `nvsdata.commands`, and what `nvsdata --help` says of it."""

    module: str
    help: str


COMMANDS = {
    "demo": Command("demo", "draw moving shapes, turn them into events, train a graph CNN on them"),
    "info": Command("info", "describe files of events: format, sensor, rate, anomalies"),
    "view": Command("view", "look at a recording: a page that plays it, a picture or a film"),
    "gallery": Command("gallery", "look at a dataset: a page with pictures and figures of every class"),
    "datasets": Command("datasets", "list the datasets: sensor, size, license, and where they are"),
    "download": Command("download", "fetch and unpack a dataset, or say how to get it by hand"),
    "pack": Command("pack", "put all recordings of a dataset into one file; exit code 1 if any is left out"),
    "convert": Command("convert", "write a recording in another format"),
    "convert-videos": Command("convert_videos", "turn videos into events (PIX2NVS), class folder by class folder"),
    "compare": Command("compare", "measure the distances between two recordings: Chamfer, repeatability, EMD"),
    "tune": Command("tune", "search for settings of PIX2NVS that come closest to a real recording"),
    "record": Command("record", "record a DAVIS camera's events, or videos that it sees on a monitor"),
    "bench": Command("bench", "measure run time, memory and error, compared with other libraries"),
    "verify": Command("verify", "open every recording, report what is wrong or missing; exit code 1 if anything is"),
    "cache": Command("cache", "say what caches of samples take on disk, or remove them"),
}
CODES = (
    "exit codes: 0 fine, 1 something was wrong with data or is missing, 2 wrong usage, "
    "3 a batch of recordings gave up, 130 interrupted (128 plus the signal's number)"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command with the arguments `argv` (default: those of the process); return the exit code.

    0: fine; 1: something was wrong with data, or is missing; 3: a batch of recordings gave up; 130: interrupted;
    128 plus a signal's number: ended by that signal. Wrong usage raises SystemExit with 2.
    """
    from nvsdata.common.terminal import escaped_output

    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # names of files may hold what the terminal can't show
            stream.reconfigure(errors="backslashreplace")
    words = list(sys.argv[1:] if argv is None else argv)
    if "_ARGCOMPLETE" in os.environ:
        # the line so far is all there is
        words = _words(os.environ.get("COMP_LINE", ""))
    with escaped_output():
        return _run(words)


def _run(words: Sequence[str]) -> int:
    from nvsdata.commands.options import UsageError
    from nvsdata.common.errors import message_of
    from nvsdata.common.files import named
    from nvsdata.common.signals import end_of, ending_by_signals, exit_code

    called = words[0] if words else ""
    args = argparse.Namespace()
    try:
        with ending_by_signals():
            parser = _parser(called)
            _complete(parser)
            args, left = parser.parse_known_args(words)
            if left:
                # by the command's own parser, which names its own help
                getattr(args, "parser", parser).error(f"unrecognized arguments: {' '.join(left)}")
            with _told(args):
                code: int = args.run(args)
                with named("standard output"):
                    sys.stdout.flush()
    except KeyboardInterrupt as error:
        print(end_of(error), file=sys.stderr)
        return exit_code(error)
    except BrokenPipeError:
        # nobody reads the output any more; the rest of it must not raise an error at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except UsageError as error:
        args.parser.error(message_of(error))
    except (OSError, ValueError, ImportError) as error:
        print(f"nvsdata {called}: {message_of(error)}{_where(error, args)}", file=sys.stderr)
        return 1
    return code


def _where(error: Exception, args: argparse.Namespace) -> str:
    """Return what a system error without a file name may be about: the paths that were given."""
    from pathlib import Path

    from nvsdata.common.errors import shown

    if getattr(error, "errno", None) is None or getattr(error, "filename", None) is not None:
        return ""
    values = [each for value in vars(args).values() for each in (value if isinstance(value, list) else [value])]
    given = [shown(value) for value in values if isinstance(value, Path)]
    return f" (one of: {', '.join([*given, 'standard output'])})"


@contextmanager
def _told(args: argparse.Namespace) -> Iterator[None]:
    """While the block runs, tell the user as much as wanted: `--quiet` results and faults, `--verbose` all steps."""
    from nvsdata.common.terminal import be_quiet

    log, handler = logging.getLogger("nvsdata"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    level = log.level
    be_quiet(args.quiet)
    if args.verbose:
        log.addHandler(handler)
        log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        be_quiet(False)
        log.removeHandler(handler)
        log.setLevel(level)


def _words(line: str) -> list[str]:
    """The words after the program's name in a line that isn't finished."""
    try:
        return shlex.split(line)[1:]
    except ValueError:
        return line.split()[1:]


def _complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks how a line may go on, if argcomplete is installed."""
    if "_ARGCOMPLETE" in os.environ:
        try:
            import argcomplete
        except ImportError:
            return
        argcomplete.autocomplete(parser)


def _open_standard_streams() -> None:
    """Open those that a shell closed: the next file opened would get one of their numbers, and be printed to."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  for as long as the process runs


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are printable, on one line, without the list of all options."""

    def error(self, message: str) -> NoReturn:
        from nvsdata.common.errors import shown

        self.exit(2, f"{self.prog}: error: {shown(message)}\n{self.prog} --help shows the options\n")


class _CommandParser(_Parser):
    """A parser of one command, whose options may stand before, between and after its arguments."""

    _mixing = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        found, left = super().parse_known_args(args, namespace)
        # an argument that may be left out counts as left out at the first option; argparse's way around that calls
        # this method, and doesn't know `--`
        if self._mixing or not left or "--" in args or "_ARGCOMPLETE" in os.environ:
            return found, left
        self._mixing = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._mixing = False


def _parser(called: str) -> argparse.ArgumentParser:
    """The parser of all commands, with the options of the one that is `called`."""
    from nvsdata._version import __version__
    from nvsdata.commands.options import Help

    parser = _Parser(prog="nvsdata", description="Datasets, transforms and models for event cameras.", epilog=CODES)
    # escape sequences of argparse's own (Python 3.14) would be escaped, too
    vars(parser)["color"] = False
    parser.add_argument("--version", action="version", version=f"nvsdata {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_CommandParser)
    for name, command in COMMANDS.items():
        whole = f"{command.help[0].upper()}{command.help[1:]}."
        one = commands.add_parser(name, help=command.help, description=whole, epilog=CODES, formatter_class=Help)
        much = one.add_mutually_exclusive_group()
        much.add_argument("-q", "--quiet", action="store_true", help="only results and faults, no progress")
        much.add_argument("-v", "--verbose", action="store_true", help="tell each step, with the time")
        if name == called:
            module = import_module(f"nvsdata.commands.{command.module}")
            module.add_arguments(one)
            one.set_defaults(run=module.run, parser=one)
    return parser


if __name__ == "__main__":
    sys.exit(main())
