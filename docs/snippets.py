"""Run the code of the documentation, for the tests and for the gallery of the site.

A page's fenced blocks of `python` and `sh` run from top to bottom in one folder, those of Python in one namespace. A
`text` block right after one is its expected output; a line `...` in it stands for any lines. A comment
`<!-- not run: REASON -->` right before a block keeps it from running.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from unittest import mock

from nvsdata.cli import main

FENCE = re.compile(r"^(?P<mark>```+)(?P<kind>\w*)[^\n]*\n(?P<code>.*?)^(?P=mark)[ ]*$", re.MULTILINE | re.DOTALL)
# a command without anything of the shell
PLAIN = re.compile(r"nvsdata [^|&;<>$`*?~(){}]+|\s*")
NOT_RUN = re.compile(r"<!-- not run: (?P<why>[^>]+?) -->\s*\Z")


class Block(NamedTuple):
    """A block of code: its kind, line in the page, what it must print (None: anything) and why it isn't run."""

    kind: str
    code: str
    line: int
    output: str | None
    skipped: str | None


class SnippetError(Exception):
    """A block fails, or prints something else than the page says."""


def blocks_of(text: str) -> Iterator[Block]:
    """Yield the blocks of Python and of the shell in a page."""
    found = list(FENCE.finditer(text))
    for one, after in zip(found, [*found[1:], None], strict=False):
        if one["kind"] not in ("python", "sh"):
            continue
        output = None
        if after is not None and after["kind"] == "text" and not text[one.end() : after.start()].strip():
            output = after["code"]
        why = NOT_RUN.search(text[: one.start()])
        yield Block(one["kind"], one["code"], text.count("\n", 0, one.start()) + 1, output, why and why["why"])


def run_page(page: Path, folder: Path) -> int:
    """Run the blocks of a page in a folder; return how many ran. SnippetError names page and line."""
    names: dict[str, object] = {"__name__": "__main__"}
    count = 0
    for block in blocks_of(page.read_text("utf-8")):
        if block.skipped:
            continue
        where = f"{page.name}:{block.line}"
        try:
            printed = (
                _python(block.code, names, folder, where) if block.kind == "python" else _shell(block.code, folder)
            )
        except Exception as error:
            raise SnippetError(f"{where}: {type(error).__name__}: {error}\n{block.code}") from error
        if block.output is not None and not _alike(printed, block.output):
            raise SnippetError(f"{where}: prints\n{printed}\nand not\n{block.output}")
        count += 1
    return count


def _python(code: str, names: dict[str, object], folder: Path, where: str) -> str:
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        exec(compile(code, where, "exec"), names)
    return printed.getvalue()


def _shell(code: str, folder: Path) -> str:
    commands = code.replace("\\\n", "").splitlines()
    if all(PLAIN.fullmatch(command) for command in commands):
        # in this process, which has imported torch
        return "".join(_command(command, folder) for command in commands)
    # by this Python, whether or not its environment is activated
    own = f'nvsdata() {{ "{sys.executable}" -m nvsdata "$@"; }}\npython() {{ "{sys.executable}" "$@"; }}\n'
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", own + code],
        cwd=folder,
        env=os.environ | {"SDL_VIDEODRIVER": "dummy"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr[-2000:] or done.stdout[-2000:]}")
    return done.stdout


def _command(command: str, folder: Path) -> str:
    printed, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(errors),
        mock.patch.dict(os.environ, SDL_VIDEODRIVER="dummy"),
    ):
        try:
            code = main(shlex.split(command, comments=True)[1:])
        except SystemExit as end:
            code = end.code
    if code:
        raise RuntimeError(f"exit code {code}: {errors.getvalue()[-2000:] or printed.getvalue()[-2000:]}")
    return printed.getvalue()


def _alike(printed: str, expected: str) -> bool:
    """Return whether the output is the expected one, in which a line of three dots stands for any lines."""
    parts = [re.escape(part.strip("\n")) for part in re.split(r"^\.\.\.$", expected, flags=re.MULTILINE)]
    return re.fullmatch(r"[\s\S]*?".join(parts), printed.strip("\n")) is not None
