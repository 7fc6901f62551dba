"""Entry point of the command line: errors become a line on stderr and an exit code."""

from __future__ import annotations

import errno
import os
import re
import sys
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from typing import TextIO

from cyclopts import (
    App,
    CycloptsError,
    Parameter,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from adaptctl.cli.heartbeat import heartbeat
from adaptctl.cli.numbers import none_missing, plain_numbers
from adaptctl.cli.robot import note_on
from adaptctl.errors import (
    AdaptctlError,
    InputError,
    LiveViewWarning,
    NotCompiledWarning,
    PhysicalConsistencyWarning,
    SimplificationWarning,
    VerdictError,
    printable,
    suggested_name,
)
from adaptctl.optional_packages import needed
from adaptctl.renamed import NOW_DEFAULT, new_name
from adaptctl.stages import watching

DONE, FAILED, WRONG_INPUT, VERDICT, INTERRUPTED = 0, 1, 2, 3, 130
WRONG_PATHS = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR)
FULL_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
TOO_FEW = re.compile(r"arameter (\S+) requires (\d+) positional arguments\.(?: Only got (\d+)\.)?")
LIKE, MOST_LISTED = 0.6, 12
"""likeness of a flag that may have been meant, and most flags that are listed"""
ROBOT_SUFFIXES = (".toml", ".urdf", ".xml", ".mjcf")
PARTS_OF = {"run": "experiment", "list": "experiment", "compare": "experiment", "convert": "experiment"} | {
    "status": "sweep",
    "report": "sweep",
}
"""commands of commands"""


def version() -> str:
    """Version text; a function, since the import that it needs takes a while."""
    import adaptctl

    return f"adaptctl {adaptctl.__version__}"


app = App(
    name="adaptctl",
    help="Adaptive control of robot mechanisms on their base parameters.",
    help_format="plaintext",
    default_parameter=Parameter(negative=(), consume_multiple=True),
    config=(plain_numbers, none_missing),
    version=version,
    print_error=False,
    exit_on_error=False,
    suppress_keyboard_interrupt=False,
    result_action="return_value",
)
# Named, not given: a command's module is imported when it is asked for.
app.command("adaptctl.cli.new:new", name="new", help="A robot file to edit.")
app.command("adaptctl.cli.basis:basis", name="basis", help="Base parameters of a robot.")
app.command("adaptctl.cli.gains:gains", name="gains", help="Gains of a tracking loop, and their stability margins.")
app.command("adaptctl.cli.identify:identify", name="identify", help="Parameters of a robot from logs of its motion.")
app.command("adaptctl.cli.excite:excite", name="excite", help="Excitation trajectories for identification.")
app.command("adaptctl.cli.tune:tune", name="tune", help="Reference and gains for a robot, verified in closed loop.")
app.command("adaptctl.cli.design:design", name="design", help="Effects of added masses and counterweights.")
app.command("adaptctl.cli.export:export", name="export", help="Controller of a robot as C or WebAssembly.")
app.command("adaptctl.cli.drive:drive", name="drive", help="Robot driven from where it stands to a planned stop.")
app.command("adaptctl.cli.experiment:app", name="experiment", help="List experiments and run them.")
app.command("adaptctl.cli.runs:runs", name="runs", help="Table of the experiments in a folder.")
app.command("adaptctl.cli.sweep:app", name="sweep", help="Parameter sweeps, on this machine or a cluster.")
app.command("adaptctl.cli.contest:contest", name="contest", help="Ranks of adaptive laws on robots and conditions.")
app.command("adaptctl.cli.doctor:doctor", name="doctor", help="Check of the installation.")
app.command(
    "adaptctl.cli.doctor:install_completion",
    name="install-completion",
    help="Shell completion of commands and flags.",
)


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Words without the program's name. Default: those of the process.

    Returns
    -------
    int
        Exit code: 0 when done, 1 when it failed, 2 for wrong input, 3 for a failed verdict, 130 on Ctrl-C.

    Notes
    -----
    Errors of adaptctl and of the operating system and warnings become a line on stderr; other errors are bugs and pass.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    _write_any_character()
    heartbeat.doing("working")
    with _warnings_as_notes(), watching(heartbeat.during):
        try:
            with needed(_called(given[: 3 if given[:1] == ["experiment"] else 1])):
                if given[:2] == ["experiment", "run"]:
                    from adaptctl.cli.experiment import offer_own

                    offer_own(given)
                _validate_command(given)
                code = int(app(given) or DONE)
            print(end="", flush=True)  # here, where a reader that went away or a full disk can be told of
            return code
        except CycloptsError as error:
            return _complain(_reason(error, given), WRONG_INPUT)
        except VerdictError as error:
            return _complain(error, VERDICT)
        except InputError as error:
            return _complain(error, FAILED if _is_full(error.__cause__) else WRONG_INPUT)
        except (AdaptctlError, OSError, MemoryError) as error:
            return _failed(error)
        except KeyboardInterrupt:
            return _complain("interrupted", INTERRUPTED)


def _write_any_character() -> None:
    """Let characters that a terminal's encoding has not be written by their number, such as \\u03c9, not fail."""
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _validate_command(given: Sequence[str]) -> None:
    """Refuse a line that ends before it says what to do; cyclopts would show the help and call it done."""
    chain, apps, rest = app.parse_commands(given)
    if not rest and apps[-1].default_command is None:
        known = ", ".join(name for name in apps[-1] if not name.startswith("-"))
        missing = "an experiment" if chain[-1:] == ("run",) else "a command"
        raise InputError(f"{missing} is missing: {known}; see {_called(chain)} --help")


def _reason(error: CycloptsError, given: Sequence[str]) -> object:
    """Message of what was wrong with the command line, in our words where we refused it."""
    if isinstance(error.__cause__, InputError):
        return error.__cause__
    told = _renamed_option(error) or _left_over(error, given) or _elsewhere(error) or _too_few(error) or str(error)
    return f"{told} See {_called(error.command_chain or ())} --help"


def _too_few(error: CycloptsError) -> str:
    """Message of a flag with fewer values than it takes; empty for other errors."""
    told = TOO_FEW.search(str(error))
    return f"{told[1]}: expected {told[2]} values, got {told[3] or 0}." if told else ""


def _elsewhere(error: CycloptsError) -> str:
    """Message of a command that is another's, or of a robot file in place of one; empty for other errors."""
    if not isinstance(error, UnknownCommandError) or not error.unused_tokens:
        return ""
    word, chain = error.unused_tokens[0], error.command_chain or ()
    if word.endswith(ROBOT_SUFFIXES):
        meant = f"experiment run adaptive --robot {word}" if "experiment" in chain else f"tune {word}"
    elif not chain and word in PARTS_OF:
        meant = f"{PARTS_OF[word]} {word}"
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
    else:
        hint = _joined(words, given)
    return f"{' '.join(map(repr, words))}: no argument of this command.{hint}"


def _joined(words: Sequence[str], given: Sequence[str]) -> str:
    """Hint that several values of one flag are joined by commas; empty where the words follow none."""
    start = next((i for i, word in enumerate(given) if list(given[i : i + len(words)]) == list(words)), 0)
    flag, value = given[start - 2 : start] if start >= 2 else ("", "")
    if not flag.startswith("--") or value.startswith("--"):
        return ""
    return f" If they are more values of {flag}, join them by commas: {flag} {','.join([value, *words])}"


def _renamed_option(error: CycloptsError) -> str:
    """Message that names the option which replaces a former one; empty where there is none."""
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
    return "" if suggested_name(option, known, LIKE) else f"Unknown option: {flag}; options: {_some(names)}"


def _some(names: Collection[str]) -> str:
    """The first of the flags among names, in the order of the alphabet, and dots for others."""
    flags = sorted(name for name in names if name.startswith("--") and not name.startswith("--no-"))
    return ", ".join(flags[:MOST_LISTED]) + (", ..." if len(flags) > MOST_LISTED else ".")


def _called(chain: Sequence[str]) -> str:
    return " ".join(("adaptctl", *chain))


def _failed(error: BaseException) -> int:
    try:
        print(end="", flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is kept would fail at the exit too
    if isinstance(error, BrokenPipeError):  # the reader of our output went away, as `head` does
        return FAILED
    if isinstance(error, OSError) and error.filename is not None:
        code = WRONG_INPUT if error.errno in WRONG_PATHS else FAILED
        return _complain(f"{printable(str(error.filename))}: {(error.strerror or str(error)).lower()}", code)
    text = str(error) or type(error).__name__
    return _complain("out of memory" if isinstance(error, MemoryError) else text, FAILED)


def _is_full(cause: BaseException | None) -> bool:
    return isinstance(cause, OSError) and cause.errno in FULL_DISK


def _complain(message: object, code: int) -> int:
    print(f"adaptctl: {' '.join(str(message).split())}", file=sys.stderr)
    return code


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Show our own warnings as a line each, once; leave those of others as they are."""
    ours = (PhysicalConsistencyWarning, SimplificationWarning, NotCompiledWarning, LiveViewWarning)
    with warnings.catch_warnings():
        theirs, shown = warnings.showwarning, set[str]()

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if not issubclass(category, ours):
                theirs(message, category, filename, lineno, file, line)
            elif (text := " ".join(note_on(message).split())) not in shown:
                shown.add(text)
                print(f"adaptctl: note: {text}", file=sys.stderr)

        warnings.showwarning = show
        for category in ours:
            warnings.simplefilter("always", category)
        yield


if __name__ == "__main__":
    sys.exit(main())
