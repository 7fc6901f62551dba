"""Numbers and tables as the paper prints them."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.errors import InputError
from adaptctl.experiments.replication.judging import Number, Printed


@given(st.floats(1e-6, 1e4), st.sampled_from([-1.0, 1.0]), st.integers(1, 6))
def test_a_rounded_number_meets_all_its_digits(size: float, sign: float, decimals: int) -> None:
    value = sign * size
    fixed, scientific = Number.of(f"{value:.{decimals}f}"), Number.of(f"{value:.{decimals}E}")
    assert fixed.digits_met(value) == fixed.digits == decimals
    assert scientific.digits_met(value) == scientific.digits
    assert fixed.styled(value).lstrip("-") == fixed.text.lstrip("-")


@given(st.floats(0.01, 1e3), st.sampled_from([-1.0, 1.0]))
@settings(max_examples=25)
def test_digits_are_lost_by_tens(value: float, direction: float) -> None:
    number = Number.of(f"{value:.4f}")
    for lost in range(5):
        off = number.value + direction * 0.49 * number.unit * 10.0**lost
        assert number.digits_met(off) == 4 - lost


def test_a_printed_table_with_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match=r"row 'm' has 2 entries, expected 3"):
        Printed("a table", columns=["1", "2", "3"], rows={"m": "1 2"})


@pytest.mark.parametrize("text", ["x", "", "1.2.3", "1E+E"])
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not a printed number"):
        Number.of(text)
