"""Values of swept settings, as they are typed: lists, ranges, and ranges to draw from."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import Field, dataclass
from typing import Any

import numpy as np

from adaptctl.errors import InputError

MOST = 1_000_000
"""Values that one setting may have."""
_RANGE = re.compile(r"^\s*(?P<low>[^:]+?)\.\.(?P<high>[^:]+?)(?::(?P<count>[^:]*))?\s*$")


@dataclass(frozen=True)
class Span:
    """A range of values of a setting to draw from, in the setting's unit: from `low` to `high`, both included, and
    `whole`, True where its values are whole numbers. Nothing is checked."""

    low: float
    high: float
    whole: bool

    def at(self, share: float) -> float | int:
        """The value at the fraction `share`, from 0 to 1, of the way from `low` to `high`; where values are whole, one
        of the whole numbers, each for an equal part of the way. The fraction is not checked."""
        if self.whole:
            return int(min(self.low + math.floor(share * (self.high - self.low + 1)), self.high))
        return self.low + share * (self.high - self.low)


def parsed(entry: Field[Any], typed: str | Sequence[str]) -> tuple[Any, ...] | Span:
    """Values of a setting, parsed from `typed`: a tuple, or a `Span` to draw from. A list, ``4,8,12``, a range of whole
    numbers, ``0..99``, and evenly spaced numbers, ``0..5:11``, 11 from 0 to 5, both included, give a tuple; ``0..5`` of
    numbers that need not be whole gives a `Span`. Values of a setting that is True or False are ``true`` and ``false``,
    in any letter case. Where a value is itself a tuple, its parts are separated by blanks, ``90 150 70``; values that
    are tuples, texts, True or False have no ranges. A sequence of texts, such as a study's file has, is read as its
    texts joined by commas, except for a setting whose values are texts: there each text is a value, commas included.
    `entry` is the setting's dataclass field, whose default tells the kind of value.

    Raises `InputError` for a text in none of these forms, no values, equal values, a range that does not rise, other
    than 2 to a million values in a range, and numbers that are not finite or, of a setting of whole numbers, not whole.
    """
    if isinstance(entry.default, str) and not isinstance(typed, str):
        values: tuple[Any, ...] = tuple(typed)
    else:
        text = typed if isinstance(typed, str) else ",".join(typed)
        if not isinstance(entry.default, tuple | str | bool) and (match := _RANGE.match(text)):
            return _range(entry, match)
        values = tuple(_one(entry, part.strip()) for part in text.split(","))
    if not values or len(set(values)) < len(values):
        raise InputError(f"{entry.name}: expected different values, at least one, got {typed!r}")
    return values


def _range(entry: Field[Any], match: re.Match[str]) -> tuple[Any, ...] | Span:
    low, high = (_number(entry, match[end]) for end in ("low", "high"))
    whole, count = isinstance(entry.default, int), match["count"]
    if not low < high:
        raise InputError(f"{entry.name}: expected a range that rises, got {match[0]!r}")
    if count is None and whole:
        count = str(int(high - low) + 1)
    if count is None:
        return Span(low, high, whole)
    if not count.isdecimal() or not 2 <= int(count) <= MOST:
        raise InputError(f"{entry.name}: expected from 2 to {MOST} values in {match[0]!r}, got {count!r}")
    points = np.linspace(low, high, int(count)).tolist()
    if whole and any(point != int(point) for point in points):
        raise InputError(f"{entry.name}: {match[0]!r} gives values that are not whole")
    return tuple(int(point) for point in points) if whole else tuple(points)


def _is_whole(entry: Field[Any]) -> bool:
    return isinstance(entry.default, int) and not isinstance(entry.default, bool)


def as_span(entry: Field[Any], values: tuple[Any, ...] | Span) -> Span | None:
    """The `Span` that a setting is drawn from: `values` where it is one, or the range of `values` that are two or more
    successive whole numbers, in ascending order, of a setting of whole numbers. None for all others, of which a draw
    picks one. `entry` is the setting's dataclass field, whose default tells its kind. Nothing is raised."""
    if isinstance(values, Span):
        return values
    if len(values) > 1 and _is_whole(entry) and list(values) == list(range(values[0], values[-1] + 1)):
        return Span(values[0], values[-1], whole=True)
    return None


def _one(entry: Field[Any], text: str) -> Any:
    default = entry.default
    if isinstance(default, tuple):
        words = text.split()
        return tuple(words) if default and isinstance(default[0], str) else tuple(_number(entry, w) for w in words)
    if isinstance(default, str):
        return text
    if isinstance(default, bool):
        return _truth(entry, text)
    number = _number(entry, text)
    return int(number) if isinstance(default, int) else number


def _truth(entry: Field[Any], text: str) -> bool:
    if text.lower() not in ("true", "false"):
        raise InputError(f"{entry.name}: expected true or false, got {text!r}")
    return text.lower() == "true"


def _number(entry: Field[Any], text: str) -> float:
    try:
        number = float(text)
    except ValueError as error:
        form = "numbers apart by commas, or a range such as 0..5:11"
        raise InputError(f"{entry.name}: expected {form}, got {text!r}") from error
    if not math.isfinite(number) or (isinstance(entry.default, int) and number != int(number)):
        raise InputError(f"{entry.name}: expected {'a whole' if isinstance(entry.default, int) else 'a finite'} number")
    return number
