"""Counts of printed entries by verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from adaptctl.experiments.replication.verdict import Check, Item, Outturn


@dataclass(frozen=True)
class Counts:
    """Counts by verdict of printed entries of Sheu and Walker (1991): `printed`, all; `given`, inputs used as printed;
    `reproduced`; `in_shape`, among the values of random draws; `errata`, shown to be wrong; and `not_reproduced`. Of
    those reproduced, `to_the_last_digit` (crosses and blanks among them) and `one_digit_short` agree to that many
    digits. Nothing is checked at construction."""

    printed: int
    given: int
    reproduced: int
    to_the_last_digit: int
    one_digit_short: int
    in_shape: int
    errata: int
    not_reproduced: int

    @classmethod
    def of(cls, checks: Sequence[Check]) -> Counts:
        """Counts by verdict, a `Counts`, of printed entries of Sheu and Walker (1991) from their `checks`, each of a
        number, a cross or a blank; crosses and blanks that are reproduced count as met to the last digit."""
        by = Counter(check.verdict for check in checks)
        done = [check for check in checks if check.verdict is Outturn.REPRODUCED]
        short = [(check.of_digits or 0) - (check.digits or 0) for check in done]
        return cls(
            printed=len(checks),
            given=by[Outturn.GIVEN],
            reproduced=len(done),
            to_the_last_digit=short.count(0),
            one_digit_short=short.count(1),
            in_shape=by[Outturn.IN_SHAPE],
            errata=by[Outturn.ERRATUM],
            not_reproduced=by[Outturn.NOT_REPRODUCED],
        )


def numbers(items: Sequence[Item]) -> Counts:
    """Counts by verdict, a `Counts`, of all numbers that Sheu and Walker (1991) print in the `items`, which are tables,
    figures and sections of the paper; crosses and blanks are left out. Nothing is checked."""
    return Counts.of([check for item in items for check in item.checks if not check.is_mark])


def marks(items: Sequence[Item]) -> Counts:
    """Counts by verdict, a `Counts`, of all crosses and blanks (parameter kept, or not) that Sheu and Walker (1991)
    print in the `items`, which are tables, figures and sections of the paper; only Tables 5 and 12 have some. Nothing
    is checked."""
    return Counts.of([check for item in items for check in item.checks if check.is_mark])
