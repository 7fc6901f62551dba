"""Expressions: equal ones are one object, what is known is folded, what is not known is never given away."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from adaptctl.compilation import Op, Routine, outlined, trace
from adaptctl.control import Gradient, ReferencePoint, SlotineLi, adaptation_gain
from adaptctl.control.adaptation.law import NoMemory, Period
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import load
from adaptctl.errors import TraceError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Dual, absolute, clip, cos, maximum, minimum, sin, sqrt, where

Equation = Callable[..., Any]


def both(left: Equation, right: Equation) -> tuple[Any, Any]:
    """Two expressions of three unknowns in one trace, so that equal means identical."""
    outputs = trace(lambda x: (left(*x), right(*x)), {"x": 3}).outputs
    return outputs[0], outputs[1]


def scalar(equation: Equation) -> Routine:
    return trace(lambda x: equation(*x), {"x": 3})


LAWS: dict[str, tuple[Equation, Equation]] = {
    "zero is neutral": (lambda x, y, z: 0.0 + x + 0.0 - 0.0, lambda x, y, z: x),
    "zero minus": (lambda x, y, z: 0.0 - x, lambda x, y, z: -x),
    "zero absorbs": (lambda x, y, z: 0.0 * x + y * 0.0 + 0.0 / z, lambda x, y, z: 0.0),
    "one is neutral": (lambda x, y, z: 1.0 * x * 1 / 1.0, lambda x, y, z: x),
    "minus one negates": (lambda x, y, z: -1.0 * x, lambda x, y, z: x / -1.0),
    "constants fold": (lambda x, y, z: (x - x + 2.0) * 3.0, lambda x, y, z: 6.0),
    "double negation": (lambda x, y, z: -((y * x) * -1.0), lambda x, y, z: x * y),
    "negated difference": (lambda x, y, z: -(x - y), lambda x, y, z: y - x),
    "negated constant multiple": (lambda x, y, z: -(2.0 * x), lambda x, y, z: -2.0 * x),
    "minus negative": (lambda x, y, z: x - (-y), lambda x, y, z: x + y),
    "plus negative": (lambda x, y, z: x + (-y), lambda x, y, z: x - y),
    "negative plus": (lambda x, y, z: -x + y, lambda x, y, z: y - x),
    "minus constant": (lambda x, y, z: x - 2.0, lambda x, y, z: -2.0 + x),
    "sum commutes": (lambda x, y, z: x + y, lambda x, y, z: y + x),
    "product commutes": (lambda x, y, z: (x + y) * z, lambda x, y, z: z * (y + x)),
    "signs of a product": (lambda x, y, z: (-x) * (-y), lambda x, y, z: x * y),
    "sign of a product": (lambda x, y, z: (-x) * y, lambda x, y, z: -(y * x)),
    "sign into a constant": (lambda x, y, z: 2.0 * -x, lambda x, y, z: x * -2.0),
    "signs of a quotient": (lambda x, y, z: (-x) / (-y), lambda x, y, z: x / y),
    "sign of a dividend": (lambda x, y, z: -x / 2.0, lambda x, y, z: x / -2.0),
    "sign of a divisor": (lambda x, y, z: 2.0 / -x, lambda x, y, z: -2.0 / x),
    "minimum commutes": (lambda x, y, z: minimum(x, y), lambda x, y, z: minimum(y, x)),
    "maximum of one": (lambda x, y, z: maximum(x, x), lambda x, y, z: x),
    "magnitude": (lambda x, y, z: absolute(-absolute(-x)), lambda x, y, z: abs(x)),
    "known condition": (lambda x, y, z: where(1.0 < 2.0, x, y), lambda x, y, z: x),
    "idle condition": (lambda x, y, z: where(x < y, z, z), lambda x, y, z: z),
    "greater is less": (lambda x, y, z: where(x > y, x, z), lambda x, y, z: where(y < x, x, z)),
    "numpy's numbers": (lambda x, y, z: np.float64(2.0) * x, lambda x, y, z: x * 2),
    "numpy's scalars": (lambda x, y, z: np.array(2.0) * x, lambda x, y, z: np.int64(2) * x),
    "same functions": (lambda x, y, z: sin(x + y) * cos(z), lambda x, y, z: cos(z) * sin(y + x)),
}


@pytest.mark.parametrize("law", LAWS)
def test_laws_make_one_expression(law: str) -> None:
    left, right = both(*LAWS[law])
    assert left is right or (isinstance(left, float) and isinstance(right, float) and left == right)


def test_constants_are_floats_and_never_negative_zero() -> None:
    (output,) = scalar(lambda x, y, z: -0.0 * x).outputs
    assert math.copysign(1.0, output) == 1.0
    (output,) = trace(lambda x: np.float32(2.0), {"x": 1}).outputs
    assert type(output) is float


def test_different_expressions_stay_different() -> None:
    left, right = both(lambda x, y, z: x - y, lambda x, y, z: y - x)
    assert left is not right
    left, right = both(lambda x, y, z: where(x < y, x, y), lambda x, y, z: where(x <= y, x, y))
    assert left is not right


def test_operations_count_what_the_result_needs_once() -> None:
    def equation(x: Any, y: Any, z: Any) -> Column:
        x * z * 17.0  # used by nothing
        c = cos(x)
        return Column((c * y + z, -(y * c) / sqrt(z), minimum(cos(x), z)))

    operations = scalar(equation).operations
    assert operations.flops == 4  # one product, sum, negation, quotient
    assert operations == {"*": 1, "+": 1, "neg": 1, "/": 1, "cos": 1, "sqrt": 1, "min": 1}
    assert operations[Op.SIN] == 0


def test_calls_count_each_time_and_share_one_body() -> None:
    square = outlined(lambda x: x * x + 1.0)
    routine = scalar(lambda x, y, z: square(x) + square(y) * square(z) + square(x))
    assert len(routine.subroutines) == 3  # square(x) is one expression
    assert len(set(routine.subroutines)) == 1
    assert routine.operations.flops == 3 * 2 + 3


def test_what_a_call_knows_is_known_to_its_caller() -> None:
    partly = outlined(lambda x: (x * 0.0 + 2.0, x))
    (output,) = scalar(lambda x, y, z: partly(x)[0] * 3.0).outputs
    assert output == 6.0


def test_constant_arguments_are_folded_into_the_body() -> None:
    product = outlined(lambda a, b: a * b)
    routine = scalar(lambda x, y, z: product(x, y) + product(x, 2.0) + product(0.0, x))
    assert [sum(call.inputs) for call in routine.subroutines] == [2, 1]  # the product with zero is known
    assert routine.operations == {"*": 2, "+": 1}


REFUSED: dict[str, tuple[Equation, str]] = {
    "if": (lambda x, y, z: x if x > 0.0 else y, "use where"),
    "and": (lambda x, y, z: x and y, "use where"),
    "builtin min": (lambda x, y, z: min(x, y), "minimum or maximum"),
    "count": (lambda x, y, z: Column(range(int(x))), "no whole number.*where"),
    "index": (lambda x, y, z: (1.0, 2.0)[x], "no whole number.*where"),
    "power": (lambda x, y, z: x**2, "no powers: multiply"),
    "clip of numpy": (lambda x, y, z: np.clip(x, 0.0, 1.0), r"numpy\.clip cannot be traced, only absolute"),
    "sum of numpy": (lambda x, y, z: np.sum([x, y]), "cannot be put into an array"),
    "equality": (lambda x, y, z: x == y, "use < or <=, and where"),
    "inequality": (lambda x, y, z: x != 0.0, "use < or <=, and where"),
    "equal conditions": (lambda x, y, z: where((x < y) == (y < z), x, y), "use < or <=, and where"),
    "membership": (lambda x, y, z: x in (y, z), "use < or <="),
    "math": (lambda x, y, z: math.sin(x), "adaptctl.scalars"),
    "object array": (lambda x, y, z: np.array([x, y]), "use Column"),
    "array operand": (lambda x, y, z: x * np.ones(2), "Column"),
    "array first": (lambda x, y, z: np.ones(2) - x, "Column"),
    "untraceable": (lambda x, y, z: np.tan(x), r"numpy\.tan cannot be traced, only absolute, add"),
    "numeric condition": (lambda x, y, z: where(x, y, z), "expected a comparison such as x < y"),
    "condition as result": (lambda x, y, z: x < y, "expected a scalar, a Column or a tuple of these"),
    "list as result": (lambda x, y, z: [x, y], "as result, got list"),
    "dual as result": (lambda x, y, z: Dual(x), "as result, got Dual"),
    "nested result": (lambda x, y, z: (x, (y, z)), "as result, got tuple"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unknown_values_are_refused(case: str) -> None:
    equation, message = REFUSED[case]
    with pytest.raises(TraceError, match=message):
        scalar(equation)


LINES: dict[str, Equation] = {
    "here": lambda x, y, z: x if x > 0.0 else y,
    "by scalars": lambda x, y, z: clip(x, y, np.ones(2)),
    "by numpy": lambda x, y, z: np.linalg.norm([x, y]),
    "by another library's function": lambda x, y, z: rotation_about([0.0, 0.0, 1.0], x),
    "in a called function": lambda x, y, z: outlined(lambda a: a if a > 0.0 else -a)(x),
    "by choosing": lambda x, y, z: where(x, y, z),
    "by powers": lambda x, y, z: x * x**2,
}


@pytest.mark.parametrize("case", LINES)
def test_the_refusal_shows_the_users_line(case: str) -> None:
    """Whoever finds it, and however deep."""
    with pytest.raises(TraceError, match=rf'test_graph\.py:\d+: "{case}": lambda x, y, z:'):
        scalar(LINES[case])


def test_a_law_of_ones_own_is_shown_its_line() -> None:
    puma = load("puma560_measured")
    model = ReducedModel(puma)
    controller = SlotineLi(model, 8.0, 0.05, Impatient(adaptation_gain(model)))
    state, reference = controller.init(np.zeros(6), np.zeros(6)), ReferencePoint(*np.zeros((3, 6)))
    with pytest.raises(TraceError, match=r"where, minimum.*test_graph\.py:\d+: if period\.s @ period\.s > 1\.0:"):
        controller.step(state, np.zeros(6), np.zeros(6), reference)


class Impatient(Gradient):
    """Learns faster where the error is large, as one would write it for floats."""

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        if period.s @ period.s > 1.0:
            return super().law(model, estimate, period, memory)
        return estimate, memory


@pytest.mark.parametrize(
    "equation",
    [lambda x, y, z: (x < y) + 1.0, lambda x, y, z: np.sin(x < y), lambda x, y, z: x + "1"],
)
def test_what_is_no_arithmetic_is_a_type_error(equation: Equation) -> None:
    with pytest.raises(TypeError):
        scalar(equation)


def test_values_of_another_trace_are_refused() -> None:
    kept: list[Any] = []
    scalar(lambda x, y, z: kept.append(x) or y)
    with pytest.raises(TraceError, match="pass it to the function as an argument"):
        scalar(lambda x, y, z: x + kept[0])
    with pytest.raises(TraceError, match="pass it to the function as an argument"):
        scalar(lambda x, y, z: kept[0])


def test_an_outlined_function_must_get_what_it_uses_as_arguments() -> None:
    def equation(x: Any, y: Any, z: Any) -> Any:
        return outlined(lambda a: a * y)(x)

    with pytest.raises(TraceError, match="pass it to the function as an argument"):
        scalar(equation)
