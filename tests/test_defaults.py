"""Defaults that users rely on: a number that is left out is the one that the docstring states."""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Iterator
from operator import attrgetter
from typing import Any

from test_docstring_sections import methods, public

from adaptctl.identification.robot_motion import exciting_motion

STATED = re.compile(r"^(\w[\w, ]*) : .*, default (\S.*)$", re.MULTILINE)
NAMED = {"inf": math.inf, "infinity": math.inf, "numpy.inf": math.inf, "pi": math.pi}


def stated_defaults() -> Iterator[tuple[str, str, object, Any]]:
    """What is called, its parameter, the default that its docstring states, and that of its signature."""
    for home, value in (public() | {"exciting_motion": exciting_motion}).items():
        for name in (home, *methods(home, value)):
            made = attrgetter(name.removeprefix(home).lstrip("."))(value) if name != home else value
            for line in STATED.finditer(inspect.getdoc(made) or ""):
                parameters = inspect.signature(made).parameters
                for parameter in line[1].split(", "):
                    yield name, parameter, line[2], parameters[parameter].default


def read(text: str) -> object:
    """A default as its value; the text itself where it is no literal."""
    try:
        return NAMED[text] if text in NAMED else ast.literal_eval(text)
    except (SyntaxError, ValueError):
        return text


def test_what_is_left_out_is_what_the_docstring_states() -> None:
    found = [(name, parameter, read(str(text)), default) for name, parameter, text, default in stated_defaults()]
    assert len(found) > 250
    wrong = [row for row in found if not isinstance(row[2], str) and row[2] != row[3]]
    assert not wrong
