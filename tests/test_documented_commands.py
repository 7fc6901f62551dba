"""Every command and every flag in the documentation is one that the command line takes."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest
from cyclopts import App

from adaptctl.cli.main import app
from adaptctl.experiments import EXPERIMENTS

PAGES = sorted(
    [Path("README.md"), Path("CONTRIBUTING.md"), *Path("docs").glob("*.md"), *Path("docs/howto").glob("*.md")]
)
OTHERS = {
    "--help",
    "--version",
    "--require-hashes",
    "--no-deps",
    "--group",
    "--no-isolation",
    "--extra",
    "--follow-tags",
    "--count",
    "--publish",
}
"""Flags of other programs, and those that every command has."""
COMMANDS = ("basis", "gains", "identify", "excite", "tune", "design", "export", "sweep", "doctor", "install-completion")


def commands(text: str) -> list[list[str]]:
    """Command lines of adaptctl in a page's blocks of console and in its code, without prompts and comments."""
    blocks = re.findall(r"```(?:console|bash|sh)\n(.*?)```", text, re.DOTALL)
    joined = "\n".join(blocks).replace("\\\n", " ")
    found = [line.strip().removeprefix("$ ") for line in joined.splitlines()]
    found += re.findall(r"`(adaptctl [^`\n]* --[^`\n]+)`", text)
    split = [shlex.split(line, comments=True) for line in found]
    return [words[1:] for words in split if words and words[0].endswith("adaptctl") and not is_pattern(words[1:])]


def is_pattern(words: list[str]) -> bool:
    """Whether capitals stand for something: `adaptctl basis ROBOT`."""
    return any(word.isupper() or "..." in word or "…" in word for word in words)


def flags(command: App) -> set[str]:
    names = {name for argument in command.assemble_argument_collection() for name in argument.names}
    return {name for name in names if not name.startswith(("--no-", "--empty-"))}


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_every_command_of_a_page_is_taken(page: Path) -> None:
    for words in commands(page.read_text()):
        if words and words[-1] not in ("--help", "--version", "-h") and app[words[0]] is not None:
            _, _, rest = app.parse_commands(words)
            if rest or words[0] in COMMANDS:
                app.parse_args(words, print_error=False, exit_on_error=False)


def test_pages_have_commands() -> None:
    assert sum(len(commands(page.read_text())) for page in PAGES) > 25


@cache
def known_flags() -> set[str]:
    """The flags of all commands and experiments, and those of other programs."""
    known = set(OTHERS)
    known |= {flag for name in COMMANDS for flag in flags(app[name])}
    known |= {flag for sub in ("status", "report") for flag in flags(app["sweep"][sub])}
    return known | {flag for entry in EXPERIMENTS for flag in flags(app["experiment"]["run"][entry.name])}


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_every_flag_of_a_page_is_one_of_some_command(page: Path) -> None:
    code = " ".join(re.findall(r"`([^`\n]+)`", page.read_text()))
    found = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", code))
    assert found <= known_flags()


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "sweep"])
def test_every_flag_of_a_command_is_in_the_page_about_commands(name: str) -> None:
    text = Path("docs/cli.md").read_text()
    own = next(part for part in re.split(r"\n## ", text)[1:] if f"adaptctl {name}" in part.partition("\n")[0])
    for flag in flags(app[name]):
        if flag.startswith("--"):
            assert f"`{flag}" in own or f" {flag}" in own, flag
