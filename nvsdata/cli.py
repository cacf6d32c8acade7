# PYTHON_ARGCOMPLETE_OK
"""The `nvsdata` command line: a table of commands. The module of a command is imported when the command is called."""

from __future__ import annotations

import argparse
import logging
import os
import shlex
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NamedTuple, NoReturn


class Command(NamedTuple):
    """Entry of the table of commands.

    Args:
        module: Module in `nvsdata.commands`.
        help: Description in `nvsdata --help`.
    """

    module: str
    help: str


COMMANDS = {
    "demo": Command("demo", "render moving shapes, convert them to events, and train a graph CNN on them"),
    "info": Command("info", "describe recordings: format, sensor, number and rate of events, anomalies"),
    "view": Command("view", "show a recording: write a page that plays it, an image or a film"),
    "gallery": Command("gallery", "show a dataset: write a page with images and statistics of every class"),
    "datasets": Command("datasets", "list the datasets: sensor, size, license, and location or source"),
    "download": Command("download", "download and unpack a dataset, or explain how to get it manually"),
    "pack": Command("pack", "pack all recordings of a dataset into one file; exit code 1 if any is left out"),
    "precompute": Command("precompute", "make graphs or frames of a whole dataset once, and store them in one file"),
    "join": Command("join", "join shards that `pack` or `precompute` made, on any machines, into one store"),
    "push": Command("push", "copy packed stores to an object store or a hub, with a dataset card"),
    "fetch": Command("fetch", "copy a packed store from a URL; an interrupted copy is resumed"),
    "convert": Command("convert", "convert a recording to another format"),
    "convert-videos": Command(
        "convert_videos", "convert videos to events with PIX2NVS or a DVS pixel model; class folders are kept"
    ),
    "compare": Command("compare", "measure distances between two recordings: Chamfer distance, repeatability, EMD"),
    "tune": Command("tune", "search for the settings of an emulator whose events are closest to a real recording"),
    "record": Command("record", "record events of a DAVIS camera, also of videos on a monitor in front of it"),
    "bench": Command("bench", "measure run time, memory and error, also of other libraries"),
    "verify": Command(
        "verify", "check every recording, and report damaged and missing ones; exit code 1 if there are any"
    ),
    "cache": Command("cache", "show the disk usage of caches, or remove them"),
}
# what isn't a command, but may be looked for
ELSEWHERE = {
    "train": "networks are trained by recipes, scripts in the repository's folder `recipes`: "
    "python recipes/train_objects.py --help",
}
CODES = (
    "exit codes: 0 success, 1 an error, or data is damaged or missing, 2 wrong usage, "
    "3 a batch of recordings was aborted, 130 interrupted (128 plus the signal's number)"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, and return its exit code.

    Args:
        argv: Arguments, the command first (default: those of the process).

    Returns:
        0 for success; 1 for an error, or if data is damaged or missing; 3 if a batch of recordings was aborted; 128
        plus the number of the signal that ended the command, such as 130 for Ctrl-C.

    Raises:
        SystemExit: With code 2 for wrong usage, with code 0 after `--help`.

    Example:
        >>> import tempfile
        >>> main(["cache", "info", tempfile.mkdtemp()])
        total: 0.0 MB
        0
    """
    from nvsdata.common.terminal import escaped_output

    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # names of files may contain characters that the terminal can't show
            stream.reconfigure(errors="backslashreplace")
    words = list(sys.argv[1:] if argv is None else argv)
    if "_ARGCOMPLETE" in os.environ:
        # the shell passes the unfinished line in a variable
        words = _split_line(os.environ.get("COMP_LINE", ""))
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
            if called in ELSEWHERE:
                parser.error(f"there is no command {called!r}: {ELSEWHERE[called]}")
            args, left = parser.parse_known_args(words)
            if left:
                # an error of the command's parser names the help of the command
                getattr(args, "parser", parser).error(f"unrecognized arguments: {' '.join(left)}")
            with _verbosity(args):
                code: int = args.run(args)
                with named("standard output"):
                    sys.stdout.flush()
    except KeyboardInterrupt as error:
        print(end_of(error), file=sys.stderr)
        return exit_code(error)
    except BrokenPipeError:
        # the reader of the output has ended; flushing at exit must not raise another error
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except UsageError as error:
        args.parser.error(message_of(error))
    except (OSError, ValueError, ImportError) as error:
        print(f"nvsdata {called}: {message_of(error)}{_where(error, args)}", file=sys.stderr)
        return 1
    return code


def _where(error: Exception, args: argparse.Namespace) -> str:
    """Return a note that lists the paths among the arguments, for a system error that names no file."""
    from pathlib import Path

    from nvsdata.common.errors import shown

    if getattr(error, "errno", None) is None or getattr(error, "filename", None) is not None:
        return ""
    values = [each for value in vars(args).values() for each in (value if isinstance(value, list) else [value])]
    given = [shown(value) for value in values if isinstance(value, Path)]
    return f" (one of: {', '.join([*given, 'standard output'])})"


@contextmanager
def _verbosity(args: argparse.Namespace) -> Iterator[None]:
    """Apply `--quiet` (only results and errors) and `--verbose` (each step) while the block runs."""
    from nvsdata.common.errors import shown
    from nvsdata.common.terminal import be_quiet

    format_warning = warnings.formatwarning
    # warnings are shown without the line of code that Python adds
    warnings.formatwarning = lambda message, *_, **__: f"nvsdata {args.command}: warning: {shown(message)}\n"
    log, handler = logging.getLogger("nvsdata"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s", "%H:%M:%S"))
    level = log.level
    be_quiet(args.quiet)
    if args.quiet:
        log.setLevel(logging.ERROR)
    if args.verbose:
        log.addHandler(handler)
        log.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        warnings.formatwarning = format_warning
        be_quiet(False)
        log.removeHandler(handler)
        log.setLevel(level)


def _split_line(line: str) -> list[str]:
    """Return the words of an unfinished command line, without the program's name."""
    try:
        return shlex.split(line)[1:]
    except ValueError:
        return line.split()[1:]


def _complete(parser: argparse.ArgumentParser) -> None:
    """Complete a command line for the shell, if argcomplete is installed."""
    if "_ARGCOMPLETE" in os.environ:
        try:
            import argcomplete
        except ImportError:
            return
        argcomplete.autocomplete(parser)


def _open_standard_streams() -> None:
    """Open standard streams that a shell has closed.

    Otherwise the next file that is opened would get the descriptor of such a stream, and messages would be written into
    the file.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  for as long as the process runs


class _Parser(argparse.ArgumentParser):
    """Parser with short errors: one printable line, and a pointer to `--help`."""

    def error(self, message: str) -> NoReturn:
        from nvsdata.common.errors import shown

        self.exit(2, f"{self.prog}: error: {shown(message)}\n{self.prog} --help shows the options\n")


class _CommandParser(_Parser):
    """Parser of one command, whose options may be before, between and after its arguments."""

    _mixing = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        found, left = super().parse_known_args(args, namespace)
        # argparse treats an optional argument as missing at the first option; its parser for mixed arguments calls
        # this method, and doesn't support `--`
        if self._mixing or not left or "--" in args or "_ARGCOMPLETE" in os.environ:
            return found, left
        self._mixing = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._mixing = False


def _parser(called: str) -> argparse.ArgumentParser:
    """Return the parser of all commands; only the command `called` gets its options."""
    from nvsdata._version import __version__
    from nvsdata.commands.options import Help

    parser = _Parser(prog="nvsdata", description="Datasets, transforms and models for event cameras.", epilog=CODES)
    # the colors of argparse (Python 3.14) would be escaped
    vars(parser)["color"] = False
    parser.add_argument("--version", action="version", version=f"nvsdata {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_CommandParser)
    for name, command in COMMANDS.items():
        description = f"{command.help[0].upper()}{command.help[1:]}."
        one = commands.add_parser(name, help=command.help, description=description, epilog=CODES, formatter_class=Help)
        verbosity = one.add_mutually_exclusive_group()
        verbosity.add_argument("-q", "--quiet", action="store_true", help="print only results and errors")
        verbosity.add_argument("-v", "--verbose", action="store_true", help="print each step with the time")
        if name == called:
            module = import_module(f"nvsdata.commands.{command.module}")
            module.add_arguments(one)
            one.set_defaults(run=module.run, parser=one)
    return parser


if __name__ == "__main__":
    sys.exit(main())
