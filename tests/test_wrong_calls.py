"""Calls with arguments of another kind are refused with what they should be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import adaptctl
from adaptctl.control import Sinusoids, excitation_trajectory, sliding_variable
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, NotFoundError
from adaptctl.tuning.named_laws import named_law

WRONG = cast(Any, "two_link")


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return adaptctl.load("two_link")


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda arm: adaptctl.adaptive_controller(WRONG), "adaptive_controller: expected a Mechanism, as load(...)"),
        (lambda arm: excitation_trajectory(arm), "excitation trajectory: expected a ReducedModel, as ReducedModel("),
        (lambda arm: sliding_variable(arm, arm), "sliding variable: expected a Controller, as SlotineLi(...) is one"),
        (lambda arm: adaptctl.identify(np.zeros((9, 5)), arm), "logs: expected files, got array([0., 0., 0., 0., 0.])"),
        (lambda arm: adaptctl.identify([None], arm), "logs: expected files, got None"),
        (lambda arm: Sinusoids(None, [0.1, 0.1], [0.1, 0.1]), "center: expected numbers, got None"),
        (lambda arm: Sinusoids([0.0, None], [0.1, 0.1], [0.1, 0.1]), "center: expected numbers, got [0.0, None]"),
        (lambda arm: arm.mass_matrix(None), "two_link: p: expected numbers of shape (..., 2), got None"),
    ],
)
def test_it_is_told_in_a_line(call: Callable[[Any], object], told: str, arm: Mechanism) -> None:
    with pytest.raises(InputError) as error:
        call(arm)
    assert told in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("given", ["deg", ["q1", "q2"]])
def test_columns_and_units_are_mappings(given: Any, arm: Mechanism, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("Time,a\n0,1\n1,2\n")
    for name in ("columns", "units"):
        with pytest.raises(InputError, match=rf"^{name}: expected a mapping such as {{'position': \.\.\.}}, got"):
            adaptctl.identify(log, arm, **{name: given})


@pytest.mark.parametrize(("column", "pair"), [("Time", "time=Time"), ("t [ms]", "'time=t [ms]'"), ("a", "time=NAME")])
def test_a_time_of_another_name_is_offered(column: str, pair: str, arm: Mechanism, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text(f"tau,{column},q1,q2,u1,u2\n0,0,0,0,0,0\n1,1,1,1,1,1\n")
    with pytest.raises(InputError) as error:
        adaptctl.identify(log, arm, columns={"position": "q{}", "torque": "u{}"})
    assert f"specify it: --columns {pair}, or the rate of even rows: --sample-rate HZ" in str(error.value)


def test_a_law_in_capitals_is_offered_in_small_letters() -> None:
    with pytest.raises(NotFoundError, match=r"unknown law 'Slotine-Li' \(did you mean 'slotine-li'\?\); laws: "):
        named_law("Slotine-Li", cast(Any, None), cast(Any, None))
