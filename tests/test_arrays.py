"""Numbers and rows from outside: booleans are no numbers, and rows that are to be a matrix are of one length."""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from adaptctl.arrays import (
    MAX_PERIOD,
    MIN_PERIOD,
    checked,
    finite_number,
    finite_results,
    per_joint,
    positive_number,
    positive_per_joint,
    positive_period,
    real_number,
    stacked_rows,
    whole_count,
    whole_number,
)
from adaptctl.errors import InputError, NonFiniteError

TAKERS: dict[str, Callable[[Any], object]] = {
    "positive": lambda x: positive_number(x, "x: expected a positive finite number"),
    "finite": lambda x: finite_number(x, "x"),
    "real": lambda x: real_number(x, "x"),
    "whole": lambda x: whole_number(x, "x", 0, 9),
    "count": lambda x: whole_count(x, "x"),
}


@pytest.mark.parametrize("boolean", [True, False, np.True_, np.False_, np.array(True), np.array(False)], ids=repr)
@pytest.mark.parametrize("taker", TAKERS)
def test_booleans_are_no_numbers(taker: str, boolean: Any) -> None:
    with pytest.raises(InputError, match=r"^x: expected a .*number.*, got .*(True|False)"):
        TAKERS[taker](boolean)


@pytest.mark.parametrize("other", ["3", None, 1.0 + 2.0j, np.timedelta64(3, "s"), Fraction(3)], ids=repr)
@pytest.mark.parametrize("taker", TAKERS)
def test_what_is_no_number_is_none_in_an_array_either(taker: str, other: Any) -> None:
    for given in (other, np.array(other), np.asarray(other, dtype=object)):
        with pytest.raises(InputError, match=r"^x: expected a .*number.*, got "):
            TAKERS[taker](given)


@pytest.mark.parametrize("one", [1, np.int64(1), np.uint8(1)], ids=repr)
@pytest.mark.parametrize("taker", TAKERS)
def test_whole_numbers_are_numbers(taker: str, one: Any) -> None:
    assert TAKERS[taker](one) == 1


@pytest.mark.parametrize(
    ("taker", "least", "most"),
    [
        (TAKERS["positive"], 1e-30, 1e30),
        (lambda x: positive_period(x, "x"), MIN_PERIOD, MAX_PERIOD),
        (lambda x: positive_number(x, "x: expected a positive finite number", 0.5, 2.0), 0.5, 2.0),
    ],
)
def test_ends_of_positive_numbers_are_among_them(taker: Callable[[Any], object], least: float, most: float) -> None:
    assert [taker(least), taker(most)] == [least, most]
    for outside in (least * (1.0 - 1e-9), most * (1.0 + 1e-9)):
        with pytest.raises(InputError, match=rf"^x: .* from {least:g} to {re.escape(f'{most:g}')}, got "):
            taker(outside)
    for none in (0.0, -least, np.inf, np.nan, 10**400):
        with pytest.raises(InputError, match=r"^x: expected a positive [^,]*, got "):
            taker(none)


@pytest.mark.parametrize("least", [0.0, 1.0])
def test_the_least_is_a_finite_number_and_what_is_below_or_infinite_is_none(least: float) -> None:
    assert finite_number(least, "x", least) == least
    for wrong in (least - 1e-9, np.inf, -np.inf, np.nan):
        with pytest.raises(InputError, match=f"^x: expected a finite number of at least {least:g}, got "):
            finite_number(wrong, "x", least)


def test_rows_are_stacked() -> None:
    samples = np.array([1.0, 2.0])
    found = stacked_rows([[samples, 3.0], [4.0, samples]], (2,))
    np.testing.assert_array_equal(found, [[[1, 3], [4, 1]], [[2, 3], [4, 2]]])
    assert stacked_rows([iter([1.0, 2.0, 3.0])], ()).shape == (1, 3)
    assert stacked_rows([], (4,)).shape == (4, 0, 0)


@pytest.mark.parametrize("rows", [[[1, 2], [3, 4, 5, 6]], [[1, 2], [3]], [[], [1, 2]]])
def test_ragged_rows_are_refused(rows: list[list[float]]) -> None:
    lengths = ", ".join(str(len(row)) for row in rows)
    with pytest.raises(ValueError, match=f"rows: expected rows of one length, got {lengths}"):
        stacked_rows(rows, ())


class Told:
    """What has a name, and gives back what it is given."""

    name = "arm"

    @finite_results
    def result(self, values: Any) -> Any:
        return np.asarray(values)


@pytest.mark.parametrize(
    ("values", "place"),
    [([[1.0, 2.0], [3.0, np.nan]], "(1, 1)"), ([[1.0, np.inf], [np.nan, -np.inf]], "(0, 1)"), ([np.nan, 1.0], "(0,)")],
)
def test_the_first_number_that_is_not_finite_is_told(values: Any, place: str) -> None:
    with pytest.raises(NonFiniteError, match=re.escape(f"arm: result is not finite at index {place}")):
        Told().result(values)
    with pytest.raises(NonFiniteError, match=re.escape(f"at index {place}")):
        checked(values, np.shape(values)[-1], "x")


def test_lasting_numbers_of_joints_are_one_each_and_cannot_be_written() -> None:
    assert per_joint(2.0, 3, "x").tolist() == [2.0, 2.0, 2.0]
    assert not positive_per_joint([1.0, 2.0], 2, "x").flags.writeable
    assert positive_per_joint([1.0, np.inf], 2, "x", infinite=True).tolist() == [1.0, np.inf]
    for wrong in ([1.0, np.inf], [1.0, 0.0], [1.0, -2.0]):
        with pytest.raises(InputError, match="expected positive numbers"):
            positive_per_joint(wrong, 2, "x")
    with pytest.raises(InputError, match="expected a number or 3 of them"):
        per_joint([1.0, 2.0], 3, "x")
