"""Regressors of long mechanisms, row by row: those of the equations, from the first call to the last."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from random_loops import RECIPES, random_loop
from random_trees import random_tree

from adaptctl import load
from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, array_equations
from adaptctl.dynamics.array_equations import unit_rows
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import Constraints, constrained

CASES = {
    "tree": lambda: random_tree(4, 5),
    "friction": lambda: load("puma560_friction"),
    "loop": lambda: load("semi_direct_drive"),
    "two loops": lambda: random_loop(3, RECIPES["two planar loops"])[0],
    "constrained": lambda: constrained(load("puma560_friction"), Constraints({"link3.m": 2.0, "link2.I_zz": 0.4})),
}


@pytest.fixture
def short() -> Iterator[None]:
    """Mechanisms of any length count as long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(array_equations, "MAX_JOINT_LINK_PAIRS", 0)
        yield


def asked(arm: Mechanism, p: Array, v: Array, v_r: Array, a: Array) -> dict[str, Array]:
    """Every regressor."""
    some = [len(arm.parameter_names) - 1, 3, 3]
    return {
        "torque_regressor": arm.torque_regressor(p, v, a),
        "some": arm.torque_regressor(p, v, a, columns=some),
        "slotine_li_regressor": arm.slotine_li_regressor(p, v, v_r, a),
    }


def states(arm: Mechanism, *samples: int) -> Array:
    """Positions, velocities, reference velocities and accelerations."""
    drawn = np.random.default_rng(0).uniform(-0.3, 0.3, (4, *samples, arm.dof))
    drawn[0] += arm.neutral_configuration
    return drawn


@pytest.mark.parametrize("case", CASES)
def test_they_are_those_of_the_equations(case: str, request: pytest.FixtureRequest) -> None:
    arm = CASES[case]()
    expected = asked(arm, *states(arm, 2, 3)), asked(arm, *states(arm))
    request.getfixturevalue("short")
    long = CASES[case]()
    for native in (False, True):
        if native:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(array_equations, "COMPILE_AFTER_CALLS", 1)
                asked(long, *states(long))
        for found, wanted in zip((asked(long, *states(arm, 2, 3)), asked(long, *states(arm))), expected, strict=True):
            for name, matrix in wanted.items():
                assert found[name].flags.writeable
                np.testing.assert_allclose(
                    found[name], matrix, rtol=0.0, atol=1e-11 * np.abs(matrix).max(), err_msg=name
                )


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("calls", [1, 10**9])
def test_they_check_and_fill_what_they_are_given(calls: int) -> None:
    arm, fine = random_tree(4, 5), np.zeros(5)
    bad: dict[Any, str] = {(0.0,) * 4: r"v: expected shape \(\.\.\., 5\)", (np.nan,) * 5: "v: expected finite numbers"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(array_equations, "COMPILE_AFTER_CALLS", calls)
        for v, message in bad.items():
            with pytest.raises((InputError, NonFiniteError), match=message):
                arm.torque_regressor(fine, v, fine)
        with pytest.raises(InputError, match="sample axes do not fit together"):
            arm.torque_regressor(np.zeros((2, 5)), np.zeros((3, 5)), fine)
        with pytest.raises(NonFiniteError):
            arm.torque_regressor(fine, np.full(5, 1e200), fine)
        assert arm.torque_regressor(*np.zeros((3, 4, 0, 5))).shape == (4, 0, 5, 50)
        for samples in ((), (3,)):
            p, out = np.full((*samples, 5), 0.2), np.empty((*samples, 5, 50))
            assert arm.torque_regressor(p, p, p, out=out) is out
            np.testing.assert_array_equal(out, arm.torque_regressor(p, p, p))
        with pytest.raises(InputError, match="out: expected an array of float64"):
            arm.torque_regressor(fine, fine, fine, out=np.empty((5, 4)))


@pytest.mark.parametrize("n", [1, 2, 7])
def test_unit_rows_are_the_identity(n: int) -> None:
    np.testing.assert_array_equal(unit_rows(n), np.eye(n))


def test_no_state_is_asked_of_the_whole_once_its_rows_are_native(short: None) -> None:
    arm = random_tree(4, 5)
    equation: Any = arm._arrays.torque_regressor
    assert not equation.is_native(1)
    assert equation.is_native(array_equations.COMPILE_AFTER_STATES)
    equation._whole.call = lambda *arguments: pytest.fail("the whole was asked")
    p, v, _, a = states(arm, 2)
    assert arm.torque_regressor(p, v, a).shape[0] == 2
