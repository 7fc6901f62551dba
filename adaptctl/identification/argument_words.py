"""Messages in the words of who reads them: flags on the command line, arguments in Python."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from functools import wraps
from typing import ParamSpec, TypeVar

from adaptctl.errors import AdaptctlError
from adaptctl.identification.identification import Identification

Given = ParamSpec("Given")
Result = TypeVar("Result")

_FLAGS: ContextVar[bool] = ContextVar("_FLAGS", default=False)
_PAIR = r"(?:'\w+=[^']*'|\w+=[^\s;'()]*[^\s;'(),.])"
_FORMS: dict[str, Callable[[re.Match[str]], str]] = {
    rf"--(?P<name>columns|units)(?P<such>, such as)?(?P<values>(?: {_PAIR})+)": lambda found: _mapping(found),
    r"--(?P<name>skip-steps) (?P<values>[a-z]+)": lambda found: f"{_name(found)}={found['values'].split()}",
    r"--(?P<name>lock)(?P<values>(?: \w+)+)": lambda found: f"adaptctl.load(ROBOT, lock={found['values'].split()})",
    r"--(?P<name>trust-log|compensated)": lambda found: f"{_name(found)}=True",
    r"--(?P<name>friction) (?P<values>[a-z_,]+)": lambda found: f"{_name(found)}={found['values']!r}",
    r"--(?P<name>sample-rate) HZ": lambda found: f"{_name(found)}=HZ",
    r"--template FILE": lambda found: f"adaptctl identify LOG --robot ROBOT {found[0]}",
    r"--(?P<name>[a-z][a-z-]*[a-z])": lambda found: _name(found),
}
_ANY = re.compile("|".join(f"(?:{re.sub(r'[(][?]P<[a-z]+>', '(?:', form)})" for form in _FORMS))


def in_flags(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """Function whose messages are for the command line."""

    @wraps(function)
    def called(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        token = _FLAGS.set(True)
        try:
            return function(*args, **kwargs)
        finally:
            _FLAGS.reset(token)

    return called


def in_arguments(function: Callable[Given, Identification]) -> Callable[Given, Identification]:
    """Function whose errors and warnings name Python's arguments, unless they are for the command line."""

    @wraps(function)
    def called(*args: Given.args, **kwargs: Given.kwargs) -> Identification:
        try:
            found = function(*args, **kwargs)
        except AdaptctlError as error:
            error.args = tuple(arguments_of(told) if isinstance(told, str) else told for told in error.args)
            raise
        return replace(found, warnings=tuple(map(arguments_of, found.warnings)))

    return called


def arguments_of(message: str) -> str:
    """Message with Python's arguments for flags, unless it is for the command line."""
    return message if _FLAGS.get() else _ANY.sub(_argument, message)


def _argument(flag: re.Match[str]) -> str:
    each = ((re.fullmatch(form, flag[0]), words) for form, words in _FORMS.items())
    return next(words(found) for found, words in each if found)


def _name(found: re.Match[str]) -> str:
    return found["name"].replace("-", "_")


def _mapping(found: re.Match[str]) -> str:
    pairs = (pair.strip("'").split("=", 1) for pair in re.findall(_PAIR, found["values"]))
    return f"{found['name']}{found['such'] or ''}{' ' if found['such'] else '='}{dict(pairs)}"
