"""Every command and every flag in the documentation is one that the command line takes."""

from __future__ import annotations

import re
import shlex
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from cyclopts import App, CycloptsError

from adaptctl.cli.main import app
from adaptctl.experiments import EXPERIMENTS

PAGES = sorted([*Path().glob("*.md"), *(path for path in Path("docs").rglob("*.md") if "_build" not in path.parts)])
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
COMMANDS = (
    "new",
    "basis",
    "gains",
    "identify",
    "excite",
    "tune",
    "drive",
    "design",
    "export",
    "runs",
    "sweep",
    "contest",
    "doctor",
    "install-completion",
)


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


def test_every_command_of_a_page_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.cli.settings_file._read", lambda path: {})  # files that commands above it wrote
    wrong = []
    for page, words in ((place, words) for place in PAGES for words in commands(place.read_text())):
        try:
            take(words)
        except CycloptsError as error:
            wrong.append(f"{page}: {shlex.join(words)}: {error}")
    assert wrong == []


def take(words: list[str]) -> None:
    """Parse a command line as the program does, but for pleas for help and a bare `experiment run`."""
    if words and words[-1] not in ("--help", "--version", "-h") and app[words[0]] is not None:
        _, _, rest = app.parse_commands(words)
        if rest or words[0] in COMMANDS:
            app.parse_args(words, print_error=False, exit_on_error=False)


def written(words: list[str]) -> str:
    """Folder of results that a command writes, if it writes one."""
    named = words[2] if words[:2] == ["experiment", "run"] else words[0]
    return words[words.index("--out") + 1] if "--out" in words else f"results/{named}"


def test_a_page_reads_only_results_that_it_has_written() -> None:
    for page in PAGES:
        there: set[str] = set()
        for words in commands(page.read_text()):
            read = {b for a, b in pairwise(words) if b.startswith("results/") and a != "--out"}
            lacking = {folder for folder in read if not there & {folder, *map(str, Path(folder).parents)}}
            assert not lacking, f"{page}: {shlex.join(words)}: nothing before it writes {lacking}"
            there.add(written(words))


def test_a_flag_that_is_not_there_is_not_taken() -> None:
    with pytest.raises(CycloptsError):
        take(["gains", "puma560", "--no-such-flag"])


def test_pages_have_commands() -> None:
    assert sum(len(commands(page.read_text())) for page in PAGES) > 25


@cache
def known_flags() -> set[str]:
    """The flags of all commands and experiments, and those of other programs."""
    known = set(OTHERS)
    known |= {flag for name in (*COMMANDS, "drive") for flag in flags(app[name])}
    known |= {flag for sub in ("status", "report") for flag in flags(app["sweep"][sub])}
    return known | {flag for entry in EXPERIMENTS for flag in flags(app["experiment"]["run"][entry.name])}


def test_every_flag_of_a_page_is_one_of_some_command() -> None:
    codes = {
        page: " ".join(re.findall(r"`([^`\n]+)`", page.read_text())) for page in PAGES if page.name != "renamed.md"
    }
    found = {page: set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", code)) for page, code in codes.items()}
    assert {str(page): names - known_flags() for page, names in found.items() if names - known_flags()} == {}


def test_every_flag_of_a_command_is_in_the_page_about_commands() -> None:
    parts = re.split(r"\n## ", Path("docs/cli.md").read_text())[1:]
    missing = []
    for name in (name for name in COMMANDS if name != "sweep"):
        own = next(part for part in parts if f"adaptctl {name}" in part.partition("\n")[0])
        long = (flag for flag in flags(app[name]) if flag.startswith("--"))
        missing += [f"{name} {flag}" for flag in long if f"`{flag}" not in own and f" {flag}" not in own]
    assert missing == []
