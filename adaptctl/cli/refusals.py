"""Lines on what is wrong with a command line, and what to write."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

from cyclopts import (
    App,
    Argument,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from adaptctl.cli.numbers import told_by_help
from adaptctl.errors import InputError, suggested_name
from adaptctl.renamed import NOW_DEFAULT, new_name

TOO_FEW = re.compile(r"arameter (\S+) requires (\d+) positional arguments\.(?: Only got (\d+)\.)?")
OUT = "--out"
LIKE, MOST_LISTED = 0.6, 12
"""likeness of a flag that may have been meant, and most flags that are listed"""
ROBOT_SUFFIXES = (".toml", ".urdf", ".xml", ".mjcf")
MEANT = {name: f"experiment {name}" for name in ("run", "list", "compare", "convert")} | {
    "status": "sweep status",
    "report": "sweep report",
    "--list": "experiment list",
    "help": "--help",
    **dict.fromkeys(("version", "-v", "-V"), "--version"),
}
"""commands that are meant by parts of others, and by words that other programs have"""


def reason(error: CycloptsError, given: Sequence[str], app: App) -> object:
    """Message of what was wrong with a command line of an app, in our words where we refused it."""
    if isinstance(error.__cause__, InputError):
        return error.__cause__
    told = (
        _unknown_option(error, app)
        or _left_over(error, given)
        or _elsewhere(error)
        or _too_few(error, given)
        or _missing(error, given)
    )
    return f"{told or error} See {called(error.command_chain or ())} --help"


def of_flag(message: str, given: Sequence[str]) -> str:
    """Message on an argument, such as "arm: control_period: ...", with the flag that gave it in place of its name."""
    for flag in (word.partition("=")[0] for word in given if word.startswith("--")):
        if flag == "--robot" and given[0] == "drive":
            continue  # messages tell of the arm itself, not of its file
        name = "[_ ]".join(map(re.escape, flag.removeprefix("--").split("-")))
        if found := re.match(rf"((?:[\w -]+: )?){name}:", message):
            return f"{found[1]}{flag}{message[found.end() - 1 :]}"
    return message


def called(chain: Sequence[str]) -> str:
    """Words of a command."""
    return " ".join(("adaptctl", *chain))


def _missing(error: CycloptsError, given: Sequence[str]) -> str:
    """Message of a flag or argument without a value, with what it is; empty for other errors."""
    if not isinstance(error, MissingArgumentError) or not isinstance(error.argument, Argument):
        return ""
    name = error.argument.name.removeprefix("--") if error.argument.name.isupper() else error.argument.name
    what = told_by_help(error.target, error.argument).partition(". ")[0].rstrip(".")
    such = f", such as {OUT} results/new" if name == OUT else ""
    told = f": {what if what[:2].isupper() else what[:1].lower() + what[1:]}{such}" if what else ""
    return f"{name} {'needs a value' if name in given else 'is missing'}{told}."


def _too_few(error: CycloptsError, given: Sequence[str]) -> str:
    """Message of a flag with fewer values than it takes; empty for other errors."""
    if not (told := TOO_FEW.search(str(error))):
        return ""
    words = " ".join(given).replace("=", " ").partition(f"{told[1]} ")[2]
    values = re.split(r"[\s,;]+", words.partition(" --")[0].strip())[: int(told[2])]
    apart = f"; separate them by blanks: {told[1]} {' '.join(values)}" if len(values) == int(told[2]) else ""
    return f"{told[1]}: expected {told[2]} values, got {told[3] or 0}{apart}."


def _elsewhere(error: CycloptsError) -> str:
    """Message of a command that is another's, or of a robot file in place of one; empty for other errors."""
    if not isinstance(error, UnknownCommandError):
        return ""
    from adaptctl.experiments import EXPERIMENTS  # here, since only errors need them

    (word, *_), chain = error.unused_tokens or ("",), error.command_chain or ()
    if word.endswith(ROBOT_SUFFIXES):
        meant = f"experiment run adaptive --robot {word}" if "experiment" in chain else f"tune {word}"
    elif chain in ((), ("experiment",)) and word in (entry.name for entry in EXPERIMENTS):
        meant = f"experiment run {word}"
    elif word in MEANT:
        meant = MEANT[word]
    else:
        return ""
    return f"Unknown command {word!r}. Did you mean adaptctl {meant}?"


def _left_over(error: CycloptsError, given: Sequence[str]) -> str:
    """Message of words that no flag takes, which offers what they may belong to; empty for other errors."""
    if not isinstance(error, UnusedCliTokensError) or not error.unused_tokens:
        return ""
    words = error.unused_tokens
    robots = [word for word in words if word.endswith(ROBOT_SUFFIXES)]
    if robots and "experiment" in (error.command_chain or ()):
        hint = f" Did you mean --robot {robots[0]}?"
    elif given[:2] == ["sweep", "run"]:
        hint = f" Did you mean adaptctl sweep {words[0]}?"
    else:
        hint = _joined(words, given)
    return f"{' '.join(map(repr, words))}: no argument of this command.{hint}"


def _joined(words: Sequence[str], given: Sequence[str]) -> str:
    """Hint that several values of one flag are joined by commas; empty where the words follow none."""
    start = next((i for i, word in enumerate(given) if list(given[i : i + len(words)]) == list(words)), 0)
    flag, value = given[start - 2 : start] if start >= 2 else ("", "")
    if not flag.startswith("--") or value.startswith("--"):
        return ""
    return f" If they are more values of {flag}, join them by commas: {flag} {','.join([value, *words])}."


def _unknown_option(error: CycloptsError, app: App) -> str:
    """Message that names the option that was probably meant; empty where cyclopts names it, and for other errors."""
    if not isinstance(error, UnknownOptionError):
        return ""
    names = {name for argument in error.argument_collection for name in argument.names}
    flag = (error.token.keyword or error.token.value).partition("=")[0]
    option = flag.removeprefix("--").replace("-", "_")
    if option.upper() in names:
        return f"Unknown option: {flag}; {option.upper()} is given without it."
    known = {name.removeprefix("--").replace("-", "_") for name in names}
    if (other := NOW_DEFAULT.get(option)) in known:
        return f"Unknown option: {flag}, now the default; --{other.replace('_', '-')} is its opposite."
    if new := new_name(option, known) or next((name for name in sorted(known) if name.startswith(option)), None):
        return f"Unknown option: {flag}. Did you mean --{new.replace('_', '-')}?"
    if suggested_name(option, known, LIKE):
        return ""
    others = ", ".join(_commands_with(flag, app))
    where = f", which is one of adaptctl {others}" if others else ""
    return f"Unknown option: {flag}{where}; options: {_some(names)}"


def _commands_with(flag: str, app: App) -> Iterator[str]:
    """Names of the commands of an app that have a flag."""
    for name in app:
        command = app[name]
        if not name.startswith("-") and command.default_command is not None:
            arguments = command.assemble_argument_collection()
            if any(flag in argument.names for argument in arguments):
                yield name


def _some(names: Collection[str]) -> str:
    """The first of the flags among names, in the order of the alphabet, and dots for others."""
    flags = sorted(name for name in names if name.startswith("--") and not name.startswith("--no-"))
    return ", ".join(flags[:MOST_LISTED]) + (", ..." if len(flags) > MOST_LISTED else ".")
