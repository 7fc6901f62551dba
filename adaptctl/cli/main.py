"""Entry point of the command line: errors become a line on stderr and an exit code."""

from __future__ import annotations

import errno
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from typing import TextIO

from cyclopts import App, ArgumentCollection, CycloptsError, Parameter

from adaptctl import errors
from adaptctl.cli.heartbeat import heartbeat
from adaptctl.cli.memory import collecting_seldom
from adaptctl.cli.numbers import none_missing, numbers_apart, plain_numbers
from adaptctl.cli.refusals import called, of_flag, reason
from adaptctl.cli.robot import note_on
from adaptctl.errors import AdaptctlError, InputError, VerdictError, printable
from adaptctl.optional_packages import needed
from adaptctl.stages import watching

DONE, FAILED, WRONG_INPUT, VERDICT, INTERRUPTED = 0, 1, 2, 3, 130
WRONG_PATHS = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR)
FULL_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


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
    given = numbers_apart(list(sys.argv[1:] if argv is None else argv))
    _write_any_character()
    heartbeat.doing("working")
    with collecting_seldom(), _warnings_as_notes(), watching(heartbeat.during):
        try:
            with needed(called(given[: 3 if given[:1] == ["experiment"] else 1])):
                if given[:2] == ["experiment", "run"]:
                    from adaptctl.cli.experiment import offer_own

                    offer_own(given)
                _validate_command(given)
                if given[-1:] in (["--help"], ["-h"]):
                    with _flags_read_once():
                        app.help_print(given[:-1])  # asked as a flag, it would go through all flags once more
                    code = DONE
                else:
                    code = int(app(given) or DONE)
            print(end="", flush=True)  # here, where a reader that went away or a full disk can be told of
            return code
        except CycloptsError as error:
            return _complain(reason(error, given, app), WRONG_INPUT)
        except VerdictError as error:
            return _complain(error, VERDICT)
        except InputError as error:
            return _complain(of_flag(str(error), given), FAILED if _is_full(error.__cause__) else WRONG_INPUT)
        except (AdaptctlError, OSError, MemoryError) as error:
            return _failed(error)
        except KeyboardInterrupt:
            return _complain("interrupted", INTERRUPTED)


@contextmanager
def _flags_read_once() -> Iterator[None]:
    """Context in which flags read for a command's panels serve its line on usage too, which would read them again."""
    read, known = App.assemble_argument_collection, dict[int, ArgumentCollection]()

    def once(command: App, **_: object) -> ArgumentCollection:
        return known.get(id(command)) or known.setdefault(id(command), read(command, parse_docstring=True))

    App.assemble_argument_collection = once  # type: ignore[assignment, method-assign]
    try:
        yield
    finally:
        App.assemble_argument_collection = read  # type: ignore[method-assign]


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
        raise InputError(f"{missing} is missing: {known}; see {called(chain)} --help")


def _failed(error: BaseException) -> int:
    with suppress(OSError):
        print(end="", flush=True)
    if isinstance(error, BrokenPipeError):  # the reader of our output went away, as `head` does
        return FAILED
    if isinstance(error, OSError) and error.filename is not None:
        code = WRONG_INPUT if error.errno in WRONG_PATHS else FAILED
        return _complain(f"{printable(str(error.filename))}: {(error.strerror or str(error)).lower()}", code)
    text = str(error) or type(error).__name__
    if isinstance(error, OSError) and _is_full(error):
        text = f"the output cannot be written ({str(error.strerror).lower()})"
    return _complain("out of memory" if isinstance(error, MemoryError) else text, FAILED)


def _is_full(cause: BaseException | None) -> bool:
    return isinstance(cause, OSError) and cause.errno in FULL_DISK


def _complain(message: object, code: int) -> int:
    print(f"adaptctl: {' '.join(str(message).split())}", file=sys.stderr)
    return code


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Show our own warnings as a line each, once; leave those of others as they are."""
    ours = tuple(kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, UserWarning))
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
