"""Numbers and tables as the paper prints them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from adaptctl.errors import InputError
from adaptctl.experiments.replication.arms import Arm, paper_rank, parameters
from adaptctl.experiments.replication.judging import (
    Check,
    Claim,
    Number,
    Outturn,
    Printed,
    RoundOff,
    check,
    checked,
    judged,
    percent,
)
from adaptctl.experiments.replication.puma560 import _plane, combination, excess, torque_figure


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


TABLE = Printed("a table", columns=["1", "2"], rows={"m": "1.50 .", "I_xy": "-2.0E-3 ."}, errata={"m": ["2"]})


@pytest.mark.parametrize(
    ("computed", "verdict"),
    [
        (1.5049, Outturn.REPRODUCED),  # rounded to the last digit
        (1.5051, Outturn.NOT_REPRODUCED),
        (np.array([1.0, 1.4951]), Outturn.IN_SHAPE),  # half a unit of the last digit beyond the draws
        (np.array([1.0, 1.4949]), Outturn.NOT_REPRODUCED),
        (np.array([1.5049, 3.0]), Outturn.IN_SHAPE),
        (np.array([1.5051, 3.0]), Outturn.NOT_REPRODUCED),
        (RoundOff(1.9, 2.0), Outturn.IN_SHAPE),
        (RoundOff(2.1, 2.0), Outturn.NOT_REPRODUCED),
        (RoundOff(0.1, 1.4), Outturn.NOT_REPRODUCED),  # what is printed is no round-off
        (False, Outturn.REPRODUCED),
        (True, Outturn.NOT_REPRODUCED),
    ],
)
def test_an_entry_is_judged_by_its_last_digit(computed: Any, verdict: Outturn) -> None:
    found = check(TABLE, "m", "1", "1.50", computed)
    assert found.verdict is verdict
    assert found.is_mark == isinstance(computed, bool)
    if verdict is Outturn.NOT_REPRODUCED:
        assert check(TABLE, "m", "2", "1.50", computed).verdict is Outturn.ERRATUM


def test_tables_have_tolerances_inputs_and_marks() -> None:
    loose = replace(TABLE, tolerance=0.1)
    assert check(loose, "m", "1", "1.50", 1.59).verdict is Outturn.REPRODUCED
    assert check(loose, "m", "1", "1.50", 1.61).verdict is Outturn.NOT_REPRODUCED
    assert check(replace(TABLE, inputs=True), "m", "1", "1.50", 1.5).verdict is Outturn.GIVEN
    exact, near = (check(loose, "m", "1", "1.50", x) for x in (1.5, 1.59))
    assert (exact.exact, exact.digits, near.exact, near.digits, near.of_digits) == (True, 2, False, 0, 2)
    crossed = Printed("crosses", columns=["1", "2"], rows={"m": "x .", "I": ". x"})
    found = checked(crossed, lambda row, column: (row, column) in {("m", "1"), ("I", "1")})
    assert [one.verdict for one in found] == [
        Outturn.REPRODUCED, Outturn.REPRODUCED, Outturn.NOT_REPRODUCED, Outturn.NOT_REPRODUCED,
    ]  # fmt: skip
    numbers = Printed("numbers", columns=["1", "2"], rows={"m": "1.5 .", "I": ". 2.5"})
    found = checked(numbers, lambda row, column: 1.5)
    assert [(one.row, one.column) for one in found] == [("m", "1"), ("I", "2")]
    assert Printed("n", columns=["1", "2"], rows={"a": "1 2", "b": "3 4"}).values("b").tolist() == [[3.0, 4.0]]
    assert Printed("n", columns=["1", "2"], rows={"a": "1 2", "b": "3 4"}).values().tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_an_item_is_what_most_entries_are_and_not_reproduced_by_one_that_is_not() -> None:
    def of(*verdicts: Outturn) -> tuple[Check, ...]:
        return tuple(Check("m", "1", "1", "1", verdict) for verdict in verdicts)

    def said(*verdicts: Outturn) -> tuple[Claim, ...]:
        return tuple(Claim("1", "", "", "", verdict) for verdict in verdicts)

    shape, same, wrong, erratum = (
        Outturn.IN_SHAPE, Outturn.REPRODUCED, Outturn.NOT_REPRODUCED, Outturn.ERRATUM,
    )  # fmt: skip
    assert judged(of(shape, same, shape)) is shape
    assert judged(of(Outturn.GIVEN, same)) is same
    assert judged(of(Outturn.GIVEN)) is Outturn.GIVEN
    assert judged(of(same, same, wrong)) is wrong
    assert judged(of(same, same, erratum)) is erratum
    assert judged(of(same), said(wrong, same)) is same
    assert judged(of(same), said(wrong, wrong)) is wrong
    assert judged(of(same), said(same, erratum)) is erratum
    assert (percent(0.005), percent(0.12345)) == ("0.5\N{NO-BREAK SPACE}%", "12.3\N{NO-BREAK SPACE}%")


def test_parameters_of_tables_have_the_signs_of_the_paper() -> None:
    own = combination("m1 - I_x2 + I_xy6")
    assert {k: own[k] for k in np.flatnonzero(own)} == {0: 1.0, 14: -1.0, 55: -1.0}  # products have the other sign
    found = parameters(TABLE)
    assert {k: found[k] for k in np.flatnonzero(found)} == {0: 1.5, 5: 0.002}
    half = parameters(Printed("n", columns=["1", "2"], rows={"m": "1.50 20"}), half_units=True)
    assert {k: half[k] for k in np.flatnonzero(half)} == pytest.approx({0: 0.005, 10: 0.5})
    values = np.array([[1.0, 1e-7, 1.6e-8, 1.4e-8, 0.0], [2.0, 1.0, 1.0, 1.0, 3.1e-8]])
    assert paper_rank(values).tolist() == [3, 5]  # by the root of the machine's precision, of the largest


@given(st.floats(-3.0, 3.0), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0))
def test_projections_on_a_line_are_those_of_the_paper(c: float, first: float, second: float) -> None:
    assert _plane(c, np.array([first, second])) < 1e-12


def test_the_fewest_components_are_those_from_which_on_all_torques_are_close() -> None:
    # torques of two joints of mean squares 4 and 1; errors of two draws with 0 to 3 components
    torque = np.array([[2.0, 1.0], [-2.0, -1.0]])[..., None]
    one = [[4.0, 1.0], [0.2, 4e-3], [0.3, 9e-4], [0.0, 0.0]]
    errors = np.array([one, [[4.0, 1.0], [9e-3, 2e-3], [3e-4, 9e-5], [0.0, 0.0]]])
    arm: Any = SimpleNamespace(motion=SimpleNamespace(Y=torque), parameters=np.ones(1), torque_errors=errors)
    words, share = Arm.fewest(arm, 2)
    # within 5 %: squares below 0.01 and 0.0025; the first draw with 3 components, the second with 1
    assert words == "2 within 5\N{NO-BREAK SPACE}%, 2 within 1\N{NO-BREAK SPACE}%, 3 within 0.1\N{NO-BREAK SPACE}%"
    assert share == 0.5
    assert Arm.fewest(arm, 1)[1] == 1.0


def test_an_excess_is_what_rounding_does_not_explain() -> None:
    def table(mass: str) -> Printed:
        names = ("mc_x", "mc_y", "mc_z", "I_x", "I_xy", "I_y", "I_xz", "I_yz", "I_z")
        return Printed("n", columns=["1"], rows={"m": mass} | dict.fromkeys(names, "0.00"))

    space: Any = SimpleNamespace(basis=np.eye(10)[:, :1])
    free = np.zeros(10, dtype=bool)
    assert excess(space, table("1.50"), table("1.52"), free) == pytest.approx(4.0)  # half units of the last digit
    free[0] = True
    assert excess(space, table("1.50"), table("1.52"), free) == pytest.approx(3.0)
    assert excess(space, table("1.50"), table("1.51"), free) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("components", "agrees"), [([0.5, 0.9, 1.0], True), ([0.9, 0.5, 1.0], False), ([0.5, 0.9, 0.99], False)]
)
def test_a_figure_of_torques_agrees_where_errors_fall_to_nothing(components: list[float], agrees: bool) -> None:
    time = np.linspace(0.0, 1.0, 50)
    Y = np.stack([9.0 * np.ones(50), np.sin(time)], axis=-1)[..., None]
    reduced = dict(zip((10, 25, 36), components, strict=True))
    arm: Any = SimpleNamespace(
        motion=SimpleNamespace(Y=Y, time=time), parameters=np.ones(1),
        reductions=[SimpleNamespace(parameters=lambda count: np.array([reduced[count]]))],
    )  # fmt: skip
    found = torque_figure(arm, "figure-4", 2, (10, 25, 36))
    assert found.agrees is agrees
    (axes,) = found.drawings[0].draw().axes
    actual, *others = axes.lines
    assert axes.get_ylabel() == "torque of joint 2 [N·m]"
    np.testing.assert_array_equal(actual.get_ydata(), np.sin(time))
    for line, share in zip(others, components, strict=True):
        np.testing.assert_allclose(line.get_ydata(), share * np.sin(time))
        assert f"{np.mean(((1.0 - share) * np.sin(time)) ** 2):.1e}" in line.get_label()
    assert len(axes.figure.legends[0].get_texts()) == 4
