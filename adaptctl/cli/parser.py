"""An argument parser that is filled when it is used, and whose errors are errors like all others here."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from adaptctl.errors import InputError, NotFoundError


class Parser(argparse.ArgumentParser):
    """Subparsers import what they need only when their name is on the command line.

    `fill` adds the arguments then. Nothing may be abbreviated: a flag that is added later must not change
    what an old command line means.
    """

    def __init__(self, *, fill: Callable[[argparse.ArgumentParser], None] | None = None, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)
        self._fill = fill

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Fill it first."""
        fill, self._fill = self._fill, None
        if fill is not None:
            fill(self)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Refuse the command line in one line."""
        raise InputError(f"{message}; see {self.prog} --help")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Argparse's hook for a value that is none of the choices: say which come close."""
        if action.choices is not None and value not in action.choices:
            raise NotFoundError(unknown(str(action.metavar or action.dest).lower(), value, map(str, action.choices)))


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """A message about a name that does not exist, with the one it may mean and those that do."""
    names = list(known)
    close = get_close_matches(name, names, n=1, cutoff=0.4)
    guess = f" (did you mean {close[0]!r}?)" if close else ""
    return f"unknown {what} {name!r}{guess}; known: {', '.join(names)}"
