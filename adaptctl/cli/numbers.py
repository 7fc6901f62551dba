"""Numbers on the command line."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import get_args

from cyclopts import App, ArgumentCollection

from adaptctl.errors import InputError


def plain_numbers(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise `InputError` for 1.5 as a whole number, which cyclopts would round, and for sizes that nothing has."""
    for argument in arguments:
        for token in argument.tokens if argument.hint is float or float in get_args(argument.hint) else ():
            _validate_size(argument.name, token.value)
        for token in argument.tokens if argument.hint is int else ():
            if not token.value.strip().removeprefix("-").isdecimal():
                raise InputError(f"{argument.name}: expected a whole number, got {token.value!r}")


def _validate_size(name: str, text: str) -> None:
    """Raise `InputError` for a finite number, not 0, too large or small to be reckoned with."""
    from adaptctl.arrays import MAX_SETTING

    size = 0.0
    with suppress(ValueError):  # what is no number is refused by cyclopts
        size = abs(float(text))
    least, most = 1.0 / MAX_SETTING, MAX_SETTING
    if math.isfinite(size) and size != 0.0 and not least <= size <= most:
        raise InputError(f"{name}: expected 0 or a number of a size from {least:g} to {most:g}, got {text}")
