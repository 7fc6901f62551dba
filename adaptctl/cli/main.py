"""The command line: reads it, does what it says, and turns what goes wrong into a line and an exit code."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import NamedTuple, NoReturn, Protocol, TextIO

from adaptctl.cli.parser import Parser
from adaptctl.errors import AdaptctlError, InputError, PhysicalConsistencyWarning, SimplificationWarning

DONE, FAILED, WRONG_INPUT, INTERRUPTED = 0, 1, 2, 130


class Command(Protocol):
    """The module of a subcommand."""

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


class Entry(NamedTuple):
    """A subcommand in the list; its module is imported when it is asked for."""

    summary: str
    module: str


COMMANDS = {
    "basis": Entry("the independent inertial parameters of a robot", "adaptctl.cli.basis"),
    "experiment": Entry("list experiments and run them", "adaptctl.cli.experiment"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; returns 0 when done, 1 when it failed, 2 when the input was wrong, 130 on Ctrl-C."""
    given = list(sys.argv[1:] if argv is None else argv)
    with _warnings_as_notes():
        try:
            arguments = _parser().parse_args(given)
            return int(arguments.run(arguments))
        except InputError as error:
            return _complain(error, WRONG_INPUT)
        except (AdaptctlError, OSError, MemoryError) as error:
            return _failed(error)
        except KeyboardInterrupt:
            return _complain("interrupted", INTERRUPTED)
        except SystemExit as end:  # --help and --version
            return int(end.code or 0)


def _parser() -> Parser:
    parser = Parser(
        prog="adaptctl",
        description="Adaptive control of robot mechanisms on their fundamental inertial parameters.",
    )
    parser.add_argument("--version", action=_Version, help="show the version")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, entry in COMMANDS.items():
        commands.add_parser(
            name, help=entry.summary, description=_sentence(entry.summary), fill=partial(_fill, entry.module)
        )
    return parser


def _fill(module: str, parser: argparse.ArgumentParser) -> None:
    command: Command = import_module(module)
    parser.set_defaults(run=command.run)
    command.add_arguments(parser)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


class _Version(argparse.Action):
    """Says the version; asks for it only then, for it takes a while to find."""

    def __init__(self, option_strings: Sequence[str], dest: str, **rest: str | None) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=rest.get("help"))

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        import adaptctl

        print(f"adaptctl {adaptctl.__version__}")
        parser.exit(DONE)


def _failed(error: BaseException) -> int:
    if isinstance(error, BrokenPipeError):  # the reader of our output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    reason = str(error) or type(error).__name__
    return _complain("out of memory" if isinstance(error, MemoryError) else reason, FAILED)


def _complain(message: object, code: int) -> int:
    print(f"adaptctl: {' '.join(str(message).split())}", file=sys.stderr)
    return code


@contextmanager
def _warnings_as_notes() -> Iterator[None]:
    """Show our own warnings as a line each, once; leave those of others as they are."""
    ours = (PhysicalConsistencyWarning, SimplificationWarning)
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
            elif (text := " ".join(str(message).split())) not in shown:
                shown.add(text)
                print(f"adaptctl: note: {text}", file=sys.stderr)

        warnings.showwarning = show
        for category in ours:
            warnings.simplefilter("always", category)
        yield


if __name__ == "__main__":
    sys.exit(main())
