"""The `nvsdata` command: each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand; return the exit code (0 fine, 1 something failed, 130 interrupted)."""
    args = _parser().parse_args(argv)
    try:
        code: int = args.run(args)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except (OSError, ValueError) as error:
        print(f"nvsdata {args.command}: {error}", file=sys.stderr)
        return 1
    return code


def _parser() -> argparse.ArgumentParser:
    from nvsdata import __version__

    parser = argparse.ArgumentParser(prog="nvsdata", description="Datasets, transforms and models for event cameras.")
    parser.add_argument("--version", action="version", version=f"nvsdata {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    demo = commands.add_parser("demo", help="draw moving shapes, turn them into events, train a graph CNN on them")
    demo.add_argument("--out", type=Path, default=Path("nvsdata-demo"), help="folder for data and pictures")
    demo.add_argument("--seconds", type=float, default=60, help="how long to train (default 60)")
    demo.add_argument("--seed", type=int, default=0)
    demo.set_defaults(run=_demo)

    info = commands.add_parser("info", help="what is in files of events: format, sensor, rate, anomalies")
    info.add_argument("files", nargs="+", metavar="FILE", type=Path)
    info.set_defaults(run=_info)
    return parser


def _demo(args: argparse.Namespace) -> int:
    from nvsdata.demo import run

    return run(args.out, seconds=args.seconds, seed=args.seed)


def _info(args: argparse.Namespace) -> int:
    from nvsdata.info import describe

    code = 0
    for path in args.files:
        try:
            print(describe(path))
        except (OSError, ValueError) as error:
            print(error, file=sys.stderr)
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
