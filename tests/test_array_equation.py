"""Mechanisms on arrays: the same in Python as in native code, whatever the arrays, and by what rule."""

from __future__ import annotations

import copy
import pickle
import tracemalloc
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics import array_equations as rule
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import ReducedModel

GIVEN = {
    "energy_regressor": 2,
    "torque_regressor": 3,
    "slotine_li_regressor": 4,
    "inverse_dynamics": 3,
    "forward_dynamics": 3,
    "mass_matrix": 1,
}
"""How many arguments (..., r) each takes."""

ROBOTS = ("puma560_measured", "puma560_friction", "semi_direct_drive")


@pytest.fixture(scope="module", params=ROBOTS)
def both(request: pytest.FixtureRequest) -> tuple[Mechanism, Mechanism]:
    """A mechanism that runs in Python, and one in native code from the first call on."""
    python, native = load(request.param), load(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule, "COMPILE_AFTER_CALLS", 1)
        for name, count in GIVEN.items():
            getattr(native, name)(*states(native, 1)[:count, 0])
    return python, native


def states(mechanism: Mechanism, samples: int) -> Array:
    values = np.random.default_rng(samples).normal(scale=0.3, size=(4, samples, mechanism.dof))
    values[0] = mechanism.neutral_configuration + 0.3 * values[0]
    return values


def called(mechanism: Mechanism, name: str, *arguments: Any, **options: Any) -> Array:
    result: Array = getattr(mechanism, name)(*arguments, **options)
    return result


def alike(one: Array, other: Array) -> None:
    assert one.shape == other.shape
    np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-12 * max(np.abs(other).max(initial=0.0), 1.0))


@pytest.mark.parametrize("name", GIVEN)
@pytest.mark.parametrize("samples", mostly_at_night([1, 2, 9, 33], 2, 33))
def test_native_code_is_python_for_one_state_and_for_many(both: Any, name: str, samples: int) -> None:
    python, native = both
    given = list(states(python, samples)[: GIVEN[name]])
    alike(called(native, name, *given), called(python, name, *given))
    one = [x[-1] for x in given]
    alike(called(native, name, *one), called(python, name, *one))
    np.testing.assert_array_equal(called(native, name, *given)[-1:], called(native, name, *(x[-1:] for x in given)))


@pytest.mark.parametrize("name", GIVEN)
def test_arrays_of_any_kind_and_shape(both: Any, name: str) -> None:
    _, native = both
    given = list(states(native, 6)[: GIVEN[name]])
    expected = called(native, name, *given)
    alike(called(native, name, *(x.tolist() for x in given)), expected)
    alike(called(native, name, *(np.asfortranarray(x) for x in given)), expected)
    folded = called(native, name, *(x.reshape(2, 3, -1) for x in given))
    alike(folded, expected.reshape(2, 3, *expected.shape[1:]))
    alike(called(native, name, *(x[0].tolist() for x in given)), expected[0])
    shared = called(native, name, given[0][0], *given[1:])
    alike(
        shared,
        called(native, name, *((np.tile(given[0][0], (6, 1)), *given[1:]) if len(given) > 1 else (given[0][0],))),
    )
    assert called(native, name, *(x[:0] for x in given)).shape == (0, *expected.shape[1:])


@pytest.mark.parametrize("columns", [None, (7, 61, 3)])
def test_rows_of_few_states_are_those_of_many(monkeypatch: pytest.MonkeyPatch, columns: tuple[int, ...] | None) -> None:
    """Bit for bit, with drives and with arrays that are broadcast."""
    arm = load("puma560_friction")
    p, v, a, _ = states(arm, 6).reshape(4, 2, 3, 6)
    monkeypatch.setattr(rule, "MAX_ENTRIES_AT_ONCE", 36)
    few = arm.torque_regressor(p[:1], v, a[1], columns)
    assert few.flags.c_contiguous
    monkeypatch.setattr(rule, "MAX_ENTRIES_AT_ONCE", 35)
    monkeypatch.setattr(rule, "rows_at_once", None)  # is not asked
    np.testing.assert_array_equal(few, arm.torque_regressor(p[:1], v, a[1], columns))


@pytest.mark.parametrize("name", GIVEN)
def test_results_go_into_given_memory(both: Any, name: str) -> None:
    for mechanism in both:
        given = list(states(mechanism, 5)[: GIVEN[name]])
        for arguments in (given, [x[0] for x in given]):
            expected = called(mechanism, name, *arguments)
            for out in (np.empty_like(expected), np.empty((*expected.shape, 2))[..., 0]):
                assert called(mechanism, name, *arguments, out=out) is out
                alike(out, expected)
            for wrong in (np.empty((*expected.shape, 1)), np.empty(expected.shape, np.float32), expected.tolist()):
                with pytest.raises(InputError, match="out: expected an array of float64 to write to, of shape"):
                    called(mechanism, name, *arguments, out=wrong)


@pytest.mark.parametrize("name", GIVEN)
def test_refusals_are_the_same(both: Any, name: str) -> None:
    python, native = both
    for samples in (1, 5):
        given = list(states(python, samples)[: GIVEN[name]])
        bad = [*given[:-1], given[-1].copy()]
        bad[-1][-1, 1] = np.nan
        for arguments in (bad, [x[-1] for x in bad], [x[..., :-1] for x in given], ["here", *given[1:]]):
            with pytest.raises(InputError) as first:
                called(python, name, *arguments)
            with pytest.raises(type(first.value)) as second:
                called(native, name, *arguments)
            assert str(second.value) == str(first.value)


def test_a_result_that_is_not_finite_is_refused() -> None:
    arm = load("puma560_measured")
    for calls in (50, 1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rule, "COMPILE_AFTER_CALLS", calls)
            with pytest.raises(NonFiniteError, match="the result is not finite for finite arguments"):
                arm.forward_dynamics(np.zeros(6), np.full(6, 1e200), np.zeros(6))


@pytest.mark.parametrize(("pairs", "longest"), mostly_at_night([(20, 8), (600, 49)], (20, 8)))
def test_the_rule(pairs: int, longest: int) -> None:
    """Calls and states until then are in Python; regressors of long mechanisms are made row by row."""
    arm = load("puma560_measured")
    p = states(arm, 10_000)[0]
    assert [is_native(arm, "mass_matrix", p[0]) for _ in range(rule.COMPILE_AFTER_CALLS)] == [False] * (
        rule.COMPILE_AFTER_CALLS - 1
    ) + [True]
    assert [is_native(arm, "inverse_dynamics", p, p, p) for _ in range(3)] == [False, False, True]
    n = next(n for n in range(50) if sum(range(n + 1)) > pairs)
    long = random_chain(0, n)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule, "COMPILE_AFTER_CALLS", 1)
        patch.setattr(rule, "MAX_JOINT_LINK_PAIRS", pairs)
        zeros = np.zeros((3, long.dof))
        assert is_native(long, "inverse_dynamics", *zeros)
        assert not is_whole(long, "torque_regressor")
        assert is_whole(random_chain(0, n - 1), "torque_regressor")
        longer = random_chain(0, longest)
        zeros = np.zeros((3, longer.dof))
        assert is_native(longer, "forward_dynamics", *zeros)
        assert is_native(longer, "mass_matrix", zeros[0])


def is_whole(mechanism: Mechanism, name: str) -> bool:
    """Whether a matrix has an equation of its own, and is not made row by row."""
    return isinstance(getattr(mechanism._arrays, name), rule.ArrayEquation)


def is_native(mechanism: Mechanism, name: str, *arguments: Array) -> bool:
    """Whether it is, after one call."""
    called(mechanism, name, *arguments)
    equation: rule.ArrayEquation = getattr(mechanism._arrays, name)
    return equation._kernel is not None


@pytest.mark.parametrize("wrong", [1.0, "m", None, 60, -1, np.float64(2.0)])
def test_columns_are_whole_numbers(wrong: object) -> None:
    """A regressor that was made for a column 1.0 would be found for column 1 again."""
    arm, p = load("puma560_measured"), np.ones(6)
    for ask in (
        lambda c: arm.torque_regressor(p, p, p, columns=c),
        lambda c: arm.column_regressor("torque_regressor", c),
    ):
        with pytest.raises(InputError, match=r"puma560_measured: columns: expected whole numbers from 0 to 59, got "):
            ask([1, wrong])
    both = arm.torque_regressor(p, p, p)[:, [12, 12, 3]]
    np.testing.assert_allclose(arm.torque_regressor(p, p, p, columns=[12, np.int64(12), 3]), both, rtol=1e-13)


def test_columns_and_reduced_models() -> None:
    arm = load("puma560_measured")
    model = ReducedModel(arm)
    p, v, v_r, a_r = states(arm, 4)
    beta = np.random.default_rng(0).normal(size=(4, len(model.columns)))
    expected = model.torque_regressor(p, v, a_r), model.slotine_li_regressor(p, v, v_r, a_r)
    torque = model.inverse_dynamics(p, v, a_r), model.inverse_dynamics(p, v, a_r, beta)
    assert expected[0].shape == (4, 6, 36)
    np.testing.assert_allclose(torque[1], np.einsum("tij,tj->ti", expected[0], beta), atol=1e-12)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule, "COMPILE_AFTER_CALLS", 1)
        for _ in range(2):
            alike(model.torque_regressor(p, v, a_r), expected[0])
            alike(model.slotine_li_regressor(p, v, v_r, a_r), expected[1])
            alike(model.inverse_dynamics(p, v, a_r), torque[0])
            alike(model.inverse_dynamics(p, v, a_r, beta), torque[1])
            alike(arm.torque_regressor(p, v, a_r, columns=[0, 59]), arm.torque_regressor(p, v, a_r)[..., [0, 59]])


def test_a_compiled_mechanism_is_copied_and_pickled() -> None:
    """Without its code."""
    arm = load("puma560_measured")
    given = states(arm, 1)[:3, 0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rule, "COMPILE_AFTER_CALLS", 1)
        expected = arm.inverse_dynamics(*given)
    for other in (copy.copy(arm), copy.deepcopy(arm), pickle.loads(pickle.dumps(arm))):
        assert other._arrays.inverse_dynamics._kernel is None
        alike(other.inverse_dynamics(*given), expected)


def test_many_states_are_not_copied() -> None:
    puma = load("puma560_measured")
    p, v, a = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 10_000, 6))
    out = np.empty((10_000, 6))
    for _ in range(4):  # native code by then
        puma.inverse_dynamics(p, v, a, out=out)
    tracemalloc.start()
    puma.inverse_dynamics(p, v, a, out=out)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < p.nbytes / 2
