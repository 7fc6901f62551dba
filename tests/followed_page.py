"""A page of the documentation, followed from the present folder by an installed wheel: `python followed_page.py PAGE`.

Commands, examples and cells of notebooks run in the order of the page; a file that the words before a block name is
written first. Lines for a clone, the network, a screen or a robot are left out, as are patterns in capitals, and Python
without prompts, which other checks run.
"""

from __future__ import annotations

import doctest
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

BLOCK = re.compile(r"^```(?:\{(?!code-cell)[\w-]+\} ?)?(\S*)\n(?:---\n.*?^---\n)?(.*?)^```", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"`([\w-]+\.(?:toml|py))`[^`]*\Z")
LONGEST = 1800
"""s that a command may take, also on a busy machine"""
NEEDS_MORE = re.compile(r"\b[A-Z]{3,}\b|\.\.\.|…|adaptctl (drive|install-completion|sweep (work|serve))|--live")


class Block(NamedTuple):
    """Language and text of a block, and the file that the words before it name."""

    kind: str
    text: str
    file: str | None


def blocks(text: str) -> Iterator[Block]:
    for found in BLOCK.finditer(text):
        named = FILE.search(text[: found.start()].rstrip().rpartition("\n\n")[2])
        yield Block(found[1], found[2], named[1] if named else None)


def commands(text: str) -> Iterator[list[str]]:
    """Words of each command of a console block that runs anywhere."""
    for line in text.replace("\\\n", " ").splitlines():
        line = line.partition(" #")[0].strip().removeprefix("$ ")
        if line.startswith("adaptctl ") and not NEEDS_MORE.search(line):
            yield shlex.split(line)[1:]


def failed_commands(text: str) -> Iterator[str]:
    for words in commands(text):
        command = [str(Path(sys.executable).parent / "adaptctl"), *words]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
        except subprocess.TimeoutExpired:
            yield f"adaptctl {shlex.join(words)}: not done in {LONGEST} s"
            continue
        if done.returncode:
            yield f"adaptctl {shlex.join(words)}: exit {done.returncode}: {done.stderr.strip()[-300:]}"


def failed_cell(text: str, names: dict[str, Any]) -> Iterator[str]:
    """What a cell of a notebook raises, which has the names of those before it."""
    try:
        exec(compile(text, "cell", "exec"), names)
    except Exception as error:
        yield f"{text.partition(chr(10))[0]} ...: {type(error).__name__}: {error}"


def failures(text: str) -> Iterator[str]:
    """What fails of a page, from top to bottom."""
    names: dict[str, Any] = {}
    runner = doctest.DocTestRunner(verbose=False)
    for block in blocks(text):
        if block.kind == "console":
            yield from failed_commands(block.text)
        elif block.kind == "{code-cell}":
            yield from failed_cell(block.text, names)
        elif ">>>" in block.text:
            told: list[str] = []
            test = doctest.DocTestParser().get_doctest(block.text, names, "page", None, 0)
            runner.run(test, out=told.append, clear_globs=False)
            names |= test.globs
            yield from told
        elif block.file:
            Path(block.file).write_text(block.text, encoding="utf-8")


if __name__ == "__main__":
    os.environ |= {"MPLBACKEND": "agg", "ADAPTCTL_PROGRESS": "off"}
    wrong = list(failures(Path(sys.argv[1]).read_text(encoding="utf-8")))
    print("\n".join(wrong))
    sys.exit(bool(wrong))
