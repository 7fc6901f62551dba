"""Exponentials, logarithms and tangents over scalars of any kind, against NumPy's; mistakes in laws told as such."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

from adaptctl.compilation import compile_function
from adaptctl.control import Controller, ReferencePoint
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError, TraceError
from adaptctl.scalars import Column, Dual, atan2, exp, log, tanh

SAMPLES = np.concatenate(
    [
        np.random.default_rng(0).uniform(-700.0, 700.0, 500),
        np.random.default_rng(1).normal(size=500),
        10.0 ** np.random.default_rng(2).uniform(-300, 2, 500),
        [0.0, 0.625, -0.625, 709.7, 720.0, -745.0, -800.0, 1e-310, 1e308],
    ]
)
FUNCTIONS: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "exp": (exp, np.exp),
    "log": (log, np.log),
    "tanh": (tanh, np.tanh),
    "atan2": (lambda x: atan2(x, 0.5 - x), lambda x: np.arctan2(x, 0.5 - x)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_compiled_functions_are_numpys_to_a_few_units_in_the_last_place(name: str) -> None:
    ours, theirs = FUNCTIONS[name]
    kernel = compile_function(lambda x: Column((ours(x[0]),)), {"x": 1}, name=name)
    with np.errstate(all="ignore"):
        expected = theirs(SAMPLES)
        lanes = kernel.map(SAMPLES[:, None])[:, 0]
        single = np.array([kernel.call(x)[0] for x in SAMPLES[:, None]])
        floats = np.array([ours(x) for x in SAMPLES.tolist()])
    for found in (lanes, single, floats):
        finite = np.isfinite(expected)
        np.testing.assert_array_equal(found[~finite], expected[~finite])
        np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-15, atol=1e-307)


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("x", [0.3, 0.9, 2.0, 7.0])
def test_their_derivatives_are_those_of_differences(name: str, x: float) -> None:
    ours, h = FUNCTIONS[name][0], 1e-6
    slope = ours(Dual(x, 1.0)).slope
    assert slope == pytest.approx((ours(x + h) - ours(x - h)) / (2.0 * h), rel=1e-7, abs=1e-9)


def test_quadrants_and_the_origin() -> None:
    kernel = compile_function(lambda x: Column((atan2(x[0], x[1]),)), {"x": 2})
    for y in (-1.0, 0.0, 2.0):
        for x in (-3.0, 0.0, 0.5):
            assert kernel.call(np.array([y, x]))[0] == pytest.approx(math.atan2(y, x), abs=1e-15)


class Nothing(NamedTuple):
    """No memory."""


@dataclass(frozen=True)
class Own(Controller[Nothing]):
    """A custom law; what it returns is given."""

    returned: Callable[..., Any]
    dof = 2  # type: ignore[assignment]

    def initial_state(self, p: Any, v: Any) -> Nothing:
        return Nothing()

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Nothing) -> Any:
        return self.returned(p, v, reference, memory)


def stepped(law: Callable[..., Any]) -> np.ndarray[Any, Any]:
    controller, zero = Own(law), np.zeros(2)
    return controller.step(controller.init(zero, zero), zero + 0.5, zero, ReferencePoint(zero, zero, zero))[0]


def test_a_law_may_saturate_smoothly() -> None:
    torque = stepped(lambda p, v, r, memory: (Column(-3.0 * tanh(2.0 * x) for x in p - r.p), memory))
    np.testing.assert_allclose(torque, -3.0 * np.tanh(1.0), rtol=1e-15)


@pytest.mark.parametrize(
    ("law", "error", "message"),
    [
        (
            lambda p, v, r, memory: -p,
            InputError,
            "return the torque, a Column of 2, and the next state, got Column",
        ),
        (lambda p, v, r, memory: (3.0, memory), InputError, "got float for the torque"),
        (lambda p, v, r, memory: (Column((1.0,)), memory), InputError, "got a column of 1 for the torque"),
        (lambda p, v, r, memory: (-p, (p,)), InputError, "got another type of state than that of `initial_state`"),
        (lambda p, v, r, memory: (-p, None), InputError, "got another type of state than that of `initial_state`"),
        (lambda p, v, r, memory: (np.tanh(p), memory), TraceError, r"apply the functions of adaptctl\.scalars to each"),
        (lambda p, v, r, memory: (np.eye(2) @ p, memory), TraceError, "do not accept a Column"),
        (lambda p, v, r, memory: (Column(math.tanh(x) for x in p), memory), TraceError, "not of math"),
        (
            lambda p, v, r, memory: (Column(np.arcsin(x) for x in p), memory),
            TraceError,
            r"numpy\.arcsin cannot be traced",
        ),
    ],
)
def test_mistakes_in_laws_are_told_as_mistakes(law: Callable[..., Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        stepped(law)


class Pair(NamedTuple):
    """A state of one part."""

    part: Any


@pytest.mark.parametrize("state", [None, 0.0, np.zeros(2), [0.0, 0.0], (np.zeros(2),), Pair(0.0), Pair((0.0,))])
def test_a_state_that_is_none_is_told(state: Any) -> None:
    @dataclass(frozen=True, eq=False)
    class WithState(Own):
        dof: int

        def initial_state(self, p: Any, v: Any) -> Any:
            return state

    law = WithState(lambda p, v, reference, memory: (-p, memory), 2)
    message = r"WithState\.initial_state: expected it to return a NamedTuple of arrays, or \(\) for no state, got"
    with pytest.raises(InputError, match=message):
        law.init([0.0, 0.0], [0.0, 0.0])
    with pytest.raises(InputError, match=message):
        law.compile()


def test_a_step_is_told_what_its_arguments_are() -> None:
    law, zero, made_up = Own(lambda p, v, r, memory: (-p, memory)), np.zeros(2), cast(Any, None)
    point = ReferencePoint(zero, zero, zero)
    for p in (zero, np.zeros((3, 2))):
        with pytest.raises(InputError, match=r"^Own: state: expected that of init\(p, v\), got None"):
            law.step(made_up, p, p, point)
        for wrong in (made_up, lambda t: point, (zero, zero)):
            with pytest.raises(InputError, match=r"reference: expected a ReferencePoint, as reference\(t\) is one"):
                law.step(law.init(p, p), p, p, wrong)


def test_the_number_of_joints_may_be_a_field() -> None:
    @dataclass(frozen=True, eq=False)
    class Damped(Controller[tuple[()]]):
        dof: int
        damping: float

        def initial_state(self, p: Any, v: Any) -> tuple[()]:
            return ()

        def law(self, p: Column, v: Column, reference: ReferencePoint, memory: tuple[()]) -> Any:
            return -self.damping * v, memory

    law, zero = Damped(3, 2.0), np.zeros(3)
    assert law.dof == 3
    torque, _ = law.step(law.init(zero, zero), zero, zero + 1.0, ReferencePoint(zero, zero, zero))
    np.testing.assert_array_equal(torque, [-2.0, -2.0, -2.0])
    with pytest.raises(TypeError, match="dof"):
        Damped(damping=2.0)  # type: ignore[call-arg]


def test_a_reference_that_is_a_tuple_is_told() -> None:
    with pytest.raises(InputError, match=r"reference: expected it to return ReferencePoint\(p, v, a\).*got a tuple"):
        TrackingEnv(reference=lambda t: (t, t, t)).reset()
