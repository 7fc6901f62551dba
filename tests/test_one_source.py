"""Every equation is written once: floats, arrays, dual numbers and native code give the same numbers."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from nightly import mostly_at_night, turn_by_turn

from adaptctl.arrays import Array, stacked
from adaptctl.compilation import compile_function, compile_step, trace
from adaptctl.control import PriorRanges, ReferencePoint, SlotineLi, Subspace, adaptation_gain
from adaptctl.control.pytree import leaves, like
from adaptctl.dynamics import equation_costs, load
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.errors import InputError, TraceError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Dual, column

pytestmark = pytest.mark.usefixtures("optimized")

ARMS = ["puma560_measured", "semi_direct_drive"]


class Equation(NamedTuple):
    """A function of columns, and what each of its arguments is."""

    function: Callable[..., tuple[Column, ...]]
    given: tuple[str, ...]


@lru_cache
def reduced(name: str) -> ReducedModel:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mechanism = load(name)
    return ReducedModel(mechanism)


@lru_cache
def equations(name: str) -> dict[str, Equation]:
    model = reduced(name)
    e, kept = model.mechanism.equations, list(model.columns)
    motion = ("q", "v", "v_r", "a_r")

    def remembered(q: Column, v: Column, w: Column, a: Column, s: Column) -> tuple[Column]:
        return (e.restored_motion(e.motion(q, v, w, a).numbers).regressor_transpose_product(s, kept),)

    return {
        "energy": Equation(lambda q, v: (e.energy_regressor(q, v),), ("q", "v")),
        "potential": Equation(lambda q: (e.potential_regressor(q),), ("q",)),
        "rates": Equation(lambda q, v: (e.joint_velocities(q, v),), ("q", "v")),
        "closed": Equation(lambda p, q: (e.closed(p, q),), ("p", "q")),
        "momentum": Equation(lambda q, v: sum(map(tuple, momentum_terms(e, q, v, kept)), ()), ("q", "v")),
        "regressor": Equation(lambda *moving: tuple(e.torque_regressor(*moving, kept)), motion),
        "torque": Equation(lambda q, v, w, a, D: (e.inverse_dynamics(q, v, w, a, D),), (*motion, "D")),
        "powers": Equation(
            lambda q, v, w, a, s: (e.motion(q, v, w, a).regressor_transpose_product(s, kept),), (*motion, "s")
        ),
        "remembered powers": Equation(remembered, (*motion, "s")),
        "mass matrix": Equation(lambda q, D: tuple(map(Column, e.mass_matrix(q, D))), ("q", "D")),
        "forward": Equation(lambda q, v, t, D: (e.forward_dynamics(q, v, t, D),), ("q", "v", "torque", "D")),
        "tick": adaptive_tick(model),
    }


NAMES = [
    "energy", "potential", "rates", "closed", "momentum", "regressor", "torque", "powers", "remembered powers",
    "mass matrix", "forward", "tick",
]  # fmt: skip


def adaptive_tick(model: ReducedModel) -> Equation:
    """A whole control law, with its memory."""
    law = SlotineLi(model, 8.0, 0.05, adaptation_gain(model, PriorRanges()))
    blank = law.initial_state(law.neutral_configuration, np.zeros(law.dof))

    def tick(p: Column, v: Column, *rest: Column) -> tuple[Column, ...]:
        torque, after = law.law(p, v, ReferencePoint(*rest[:3]), like(blank, rest[3:]))
        return (torque, *leaves(after))

    return Equation(tick, ("p", "v", "p", "v", "a_r", "beta", "q", "motion", "s", "torque", "elapsed"))


def inputs(name: str, given: tuple[str, ...], samples: int) -> list[Array]:
    model, rng = reduced(name), np.random.default_rng(3)
    mechanism = model.mechanism
    tree = mechanism.continuation is None
    p = mechanism.neutral_configuration + rng.normal(size=(samples, mechanism.dof)) * (1.0 if tree else 0.02)
    known = {
        "p": p,
        "q": mechanism.configuration(p),
        "D": np.broadcast_to(mechanism.inertial_parameters, (samples, len(mechanism.inertial_parameters))),
        "beta": rng.normal(size=(samples, len(model.columns))),
        "motion": rng.normal(size=(samples, len(mechanism.equations.motion_memory.kept))),
        "elapsed": np.full((samples, 1), 1e-3),
    }
    return [known[x] if x in known else rng.normal(size=(samples, mechanism.dof)) for x in given]


def flat(columns: tuple[Column, ...]) -> list[Any]:
    return [entry for one in columns for entry in one]


def value(x: Any) -> float:
    return x.value if isinstance(x, Dual) else x


def tolerance(name: str, what: str, arrays: list[Array]) -> float:
    """Forward dynamics is judged by its conditioning."""
    if what != "forward":
        return 1e-12
    e, q, D = reduced(name).mechanism.equations, arrays[0], arrays[3]
    return 1e-12 * max(
        float(np.linalg.cond([list(row) for row in e.mass_matrix(column(a), column(b))]))
        for a, b in zip(q, D, strict=True)
    )


@pytest.mark.parametrize(("what", "name"), turn_by_turn(NAMES, ARMS))
def test_all_kinds_of_scalar_agree(name: str, what: str) -> None:
    function, given = equations(name)[what]
    arrays = inputs(name, given, 8)
    together = stacked(flat(function(*map(column, arrays))), (8,))
    sizes = {f"x{i}": array.shape[-1] for i, array in enumerate(arrays)}
    native = compile_function(lambda **named: Column(flat(function(*named.values()))), sizes)
    allowed = tolerance(name, what, arrays) * np.abs(together).max()
    for k in range(8):
        one = [np.ascontiguousarray(array[k]) for array in arrays]
        floats = np.array(flat(function(*map(column, one))))
        duals = flat(function(*(Column(Dual(x) for x in values.tolist()) for values in one)))
        assert np.abs(floats - together[k]).max() <= allowed
        assert np.abs(native(*one) - together[k]).max() <= allowed
        assert np.abs(np.array([value(x) for x in duals]) - floats).max() <= allowed


@pytest.mark.parametrize(
    ("name", "what", "lanes"),
    mostly_at_night(
        product(ARMS, NAMES, [4, 8]),
        *((name, what, (4, 8)[(i + k) % 2]) for i, name in enumerate(ARMS) for k, what in enumerate(NAMES)),
    ),
)
def test_lanes_agree_with_arrays(name: str, what: str, lanes: int) -> None:
    function, given = equations(name)[what]
    arrays = inputs(name, given, 11)
    expected = stacked(flat(function(*map(column, arrays))), (11,))
    held = {f"x{i}": array.shape[-1] for i, array in enumerate(arrays)}
    stepper = compile_step(
        lambda **named: (Column(flat(function(*named.values()))),), state={}, constants=held, lanes=lanes
    )
    ensemble = stepper.ensemble(11)
    for key, values in zip(held, arrays, strict=True):
        ensemble.held[key] = values
    (together,) = ensemble.run()
    assert np.abs(together - expected).max() <= tolerance(name, what, arrays) * np.abs(expected).max()


@pytest.mark.parametrize("what", [what for what in NAMES if what != "momentum"])  # which is made with dual numbers
@pytest.mark.parametrize("name", ARMS)
def test_dual_numbers_are_the_derivative(name: str, what: str) -> None:
    function, given = equations(name)[what]
    point = [array[0] for array in inputs(name, given, 1)]
    rng = np.random.default_rng(9)
    ways = [rng.normal(size=len(x)) * (0.1 * x if kind == "D" else 1.0) for x, kind in zip(point, given, strict=True)]
    pairs = zip(point, ways, strict=True)
    duals = flat(function(*(Column(map(Dual, x.tolist(), dx.tolist())) for x, dx in pairs)))
    slopes = np.array([x.slope if isinstance(x, Dual) else 0.0 for x in duals])
    h = 1e-6

    def moved(step: float) -> Array:
        return np.array(flat(function(*(column(x + step * dx) for x, dx in zip(point, ways, strict=True)))))

    differences = (moved(h) - moved(-h)) / (2.0 * h)
    assert np.abs(slopes - differences).max() < 1e-6 * max(np.abs(slopes).max(), 1.0)


def test_the_price_of_36_columns() -> None:
    model = reduced("puma560_measured")
    costs = equation_costs(model.mechanism, model.columns)
    assert len(model.columns) == 36
    assert costs.regressor <= 920
    assert costs.control_law <= 960
    assert costs.forward_dynamics is not None
    assert costs.forward_dynamics <= 1040
    law = SlotineLi(model, 8.0, 0.05, adaptation_gain(model, PriorRanges()))
    assert law.kernel is not None
    assert (
        law.kernel.operations.flops <= 1271
    )  # one motion, its torque, the last one's powers, whether V falls, the law
    assert law.kernel.operations["sin"] == 6


@pytest.mark.parametrize("name", ARMS)
def test_fewer_columns_cost_less(name: str) -> None:
    model = reduced(name)
    everything = range(len(model.mechanism.parameter_names))
    choices = [model.columns[-10:], model.columns[-20:], model.columns, everything]
    for costs in zip(*(equation_costs(model.mechanism, columns) for columns in choices), strict=True):
        assert list(costs) == sorted(set(costs))


def test_a_joint_without_inertia_has_no_forward_dynamics() -> None:
    mechanism = reduced("puma560_measured").mechanism
    costs = equation_costs(mechanism, [mechanism.parameter_names.index("link2.I_xx")])
    assert costs.forward_dynamics is None
    assert costs.regressor > 0


@pytest.mark.parametrize("wrong", [60, -1, 1.0, True, "link2.m"])
def test_columns_without_a_price_are_refused(wrong: Any) -> None:
    mechanism = reduced("puma560_measured").mechanism
    with pytest.raises(InputError, match=f"columns: expected whole numbers from 0 to 59, got {wrong!r}"):
        equation_costs(mechanism, [0, wrong])
    assert equation_costs(mechanism, [15, 12, 15]) == equation_costs(mechanism, np.array([12, 15]))


def test_what_is_not_learned_costs_less() -> None:
    model = reduced("semi_direct_drive")
    k = len(model.columns)
    laws = None, Subspace(np.ones(5), np.eye(k)[:, :5]), np.ones(k)
    kernels = [SlotineLi(model, 8.0, 0.05, law).kernel for law in laws]
    flops = [kernel.operations.flops for kernel in kernels if kernel is not None]
    assert flops == sorted(set(flops))
    assert len(flops) == 3


@pytest.mark.parametrize(
    "law",
    [
        lambda p: p if p[0] > 0.0 else -p,
        lambda p: Column([max(p[0], p[1])]),
        lambda p: Column([1.0 if 0.0 < p[0] < 1.0 else 0.0]),
        lambda p: p if p[0] > 0.0 and p[1] > 0.0 else -p,
    ],
)
def test_a_value_that_must_not_steer_an_if_names_where(law: Callable[[Column], Column]) -> None:
    with pytest.raises(TraceError, match="where"):
        trace(law, {"p": 2})
