"""Numbers on the command line."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import get_args

from cyclopts import App, Argument, ArgumentCollection, Token

from adaptctl.errors import InputError

NUMBER_AND_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?) ?([^\d\s,.;].*)", re.IGNORECASE)
UNIT = re.compile(r", (s|Hz|rad|m|kg|1/s|N m s/rad|N m|%)(?=[.;,]| if | or m|$)")
"""of a flag, in its help"""
FACTORS = {
    ("ms", "s"): 1e-3, ("us", "s"): 1e-6, ("µs", "s"): 1e-6, ("min", "s"): 60.0, ("h", "s"): 3600.0,
    ("kHz", "Hz"): 1e3, ("deg", "rad"): math.pi / 180.0, ("°", "rad"): math.pi / 180.0,
    ("mm", "m"): 1e-3, ("cm", "m"): 1e-2, ("g", "kg"): 1e-3,
}  # fmt: skip


def numbers_apart(given: Sequence[str]) -> list[str]:
    """Words of a command line, with the numbers of --gravity apart; settings of experiments and sweeps have commas."""
    joined = given[:1] not in (["experiment"], ["sweep"])
    pairs = zip(("", *given), given, strict=False)
    return [part for flag, word in pairs for part in (word.split(",") if joined and flag == "--gravity" else [word])]


def plain_numbers(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise `InputError` for what is no number, 1.5 as a whole one, which cyclopts would round, and absurd sizes."""
    for argument in arguments:
        kinds = (argument.hint, *get_args(argument.hint))
        for token in argument.tokens if float in kinds and str not in kinds else ():
            _validate_number(app, argument, token)
        for token in argument.tokens if int in kinds and not {str, float} & set(kinds) else ():
            if not token.value.strip().removeprefix("-").isdecimal():
                raise InputError(f"{_whence(token)}{argument.name}: expected a whole number, got {token.value!r}")


def none_missing(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise `InputError` where several arguments are missing, of which cyclopts would tell the first alone."""
    names = [argument.name for argument in arguments if argument.required and not argument.tokens]
    missing = [name.removeprefix("--") if name.isupper() else name for name in names]
    if len(missing) > 1:
        raise InputError(f"{', '.join(missing)} are missing; see {' '.join(('adaptctl', *commands))} --help")


def _whence(token: Token) -> str:
    """File that a value is from, with a colon; empty for the command line."""
    return "" if token.source in ("", "cli") else f"{token.source}: "


def _validate_number(app: App, argument: Argument, token: Token) -> None:
    """Raise `InputError` for no number, and for a finite one, not 0, too large or small to be reckoned with."""
    from adaptctl.arrays import MAX_SETTING

    name, text = f"{_whence(token)}{argument.name}", token.value
    try:
        size = abs(float(text))
    except ValueError as error:
        told = _instead(text, _unit(app, argument), get_args(argument.hint))
        raise InputError(f"{name}: {told}") from error
    least, most = 1.0 / MAX_SETTING, MAX_SETTING
    if math.isfinite(size) and size != 0.0 and not least <= size <= most:
        raise InputError(f"{name}: expected 0 or a number of a size from {least:g} to {most:g}, got {text}")


def _unit(app: App, argument: Argument) -> str:
    """Unit of a flag, as its help says it, or the docstring of its command; empty where they say none."""
    told = UNIT.search(told_by_help(app.default_command, argument))
    return told[1] if told else ""


def told_by_help(command: object, argument: Argument) -> str:
    """Text of an argument in its help, or in the docstring of its command; empty where neither has one."""
    doc = getattr(command, "__doc__", None) or ""
    entry = re.search(rf"^ +{argument.field_info.name} : .*\n((?: {{8}}.*\n)+)", doc, re.MULTILINE)
    return argument.parameter.help or (" ".join(entry[1].split()) if entry else "")


def _instead(text: str, unit: str, kinds: Sequence[object]) -> str:
    """Expected number, and what to write in place of a text that is none."""
    expected = f"expected a number{f' in {unit}' if unit else ''}, got {text!r}"
    parts = [part for part in re.split(r"[,;\s]+", text) if part]
    parts = parts if all(any(map(str.isdigit, part)) for part in parts) else []  # "2 ms" is one number
    if len(parts) == 2 and Ellipsis not in kinds and kinds.count(float) < 2:
        return f"{expected}; write {'.'.join(parts)}, with a point"
    if len(parts) > 1:
        return f"{expected}; numbers are separated by blanks: {' '.join(parts)}"
    if (found := NUMBER_AND_UNIT.fullmatch(text.strip())) is None:
        return expected
    if (found[2], unit) in (("Hz", "s"), ("s", "Hz")) and float(found[1]):
        return f"{expected}; write {1.0 / float(found[1]):.10g}"
    factor = 1.0 if found[2] == unit else FACTORS.get((found[2], unit))
    if factor is None:
        return f"{expected}; write the number alone{f', in {unit}' if unit else ', in the unit that --help states'}"
    return f"{expected}; write {float(found[1]) * factor:.10g}"
