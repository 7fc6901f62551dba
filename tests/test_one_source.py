"""Every equation is written once: floats, arrays, dual numbers and native code give the same numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from adaptctl.compilation import compile_function, compile_step, trace
from adaptctl.control.adaptive import spread
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.arrays import column, stacked
from adaptctl.errors import TraceError
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column, Dual

TABLE_4_SET = {
    "link1": "I_yy",
    "link2": "mc_x mc_y I_yy I_zz I_xy I_xz I_yz",
    "link3": "mc_x mc_z I_yy I_zz I_xy I_xz I_yz",
    "link4": "mc_x mc_z I_yy I_zz I_xy I_xz I_yz",
    "link5": "mc_x I_yy I_zz I_xy I_xz I_yz",
    "link6": "mc_x mc_y mc_z I_yy I_zz I_xy I_xz I_yz",
}
"""The 36 columns that the paper's priorities keep, exact twists given."""

Equation = Callable[..., tuple[Column, ...]]


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def kept(puma: Mechanism) -> list[int]:
    names = [f"{link}.{kind}" for link, kinds in TABLE_4_SET.items() for kind in kinds.split()]
    return sorted(puma.parameter_names.index(name) for name in names)


def equations(puma: Mechanism, kept: list[int]) -> dict[str, tuple[Equation, tuple[int, ...]]]:
    """Each equation as a function of six-columns and of the 60 parameters where it needs them."""
    e = puma.equations

    def both(p: Column, v: Column, w: Column, a: Column, s: Column, D: Column) -> tuple[Column, ...]:
        motion = e.motion(p, v, w, a)
        return motion.torque(D), motion.powers(s, kept)

    return {
        "energy": (lambda p, v: (e.energy_regressor(p, v),), (6, 6)),
        "potential": (lambda p: (e.potential_regressor(p),), (6,)),
        "regressor": (lambda p, v, w, a: tuple(e.torque_regressor(p, v, w, a, kept)), (6, 6, 6, 6)),
        "inverse": (lambda p, v, w, a, D: (e.inverse_dynamics(p, v, w, a, D),), (6, 6, 6, 6, 60)),
        "torque and powers": (both, (6, 6, 6, 6, 6, 60)),
        "forward": (lambda p, v, t, D: (e.forward_dynamics(p, v, t, D),), (6, 6, 6, 60)),
    }


NAMES = ["energy", "potential", "regressor", "inverse", "torque and powers", "forward"]


def flat(columns: tuple[Column, ...]) -> list[Any]:
    return [entry for one in columns for entry in one]


def inputs(puma: Mechanism, sizes: tuple[int, ...], samples: int) -> list[Array]:
    rng = np.random.default_rng(3)
    D = np.broadcast_to(puma.inertial_parameters, (samples, 60))
    return [D if size == 60 else rng.normal(size=(samples, size)) for size in sizes]


def tolerance(puma: Mechanism, name: str, p: Array) -> float:
    """Forward dynamics is judged by its conditioning."""
    return 1e-12 * (float(np.linalg.cond(puma.mass_matrix(p)).max()) if name == "forward" else 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_all_kinds_of_scalar_agree(puma: Mechanism, kept: list[int], name: str) -> None:
    function, sizes = equations(puma, kept)[name]
    arrays = inputs(puma, sizes, 8)
    together = stacked(flat(function(*map(column, arrays))), (8,))
    native = compile_function(
        lambda **named: Column(flat(function(*named.values()))), {f"x{i}": n for i, n in enumerate(sizes)}
    )
    allowed = tolerance(puma, name, arrays[0]) * np.abs(together).max()
    for k in range(8):
        one = [np.ascontiguousarray(array[k]) for array in arrays]
        floats = np.array(flat(function(*map(column, one))))
        duals = flat(function(*(Column(Dual(x) for x in values.tolist()) for values in one)))
        assert np.abs(floats - together[k]).max() <= allowed
        assert np.abs(native(*one) - together[k]).max() <= allowed
        assert (
            max(abs((x.value if isinstance(x, Dual) else x) - y) for x, y in zip(duals, floats, strict=True)) <= allowed
        )


@pytest.mark.parametrize("lanes", [4, 8])
@pytest.mark.parametrize("name", NAMES)
def test_lanes_agree_with_arrays(puma: Mechanism, kept: list[int], name: str, lanes: int) -> None:
    function, sizes = equations(puma, kept)[name]
    arrays = inputs(puma, sizes, 11)
    expected = stacked(flat(function(*map(column, arrays))), (11,))
    held = {f"x{i}": n for i, n in enumerate(sizes)}
    stepper = compile_step(lambda **named: (Column(flat(function(*named.values()))),), state={}, held=held, lanes=lanes)
    ensemble = stepper.ensemble(11)
    for key, values in zip(held, arrays, strict=True):
        ensemble.held[key] = values
    (together,) = ensemble.run()
    assert np.abs(together - expected).max() <= tolerance(puma, name, arrays[0]) * np.abs(expected).max()


@pytest.mark.parametrize("name", NAMES)
def test_dual_numbers_are_the_derivative(puma: Mechanism, kept: list[int], name: str) -> None:
    function, sizes = equations(puma, kept)[name]
    arrays = inputs(puma, sizes, 1)
    point = [array[0] for array in arrays]
    rng = np.random.default_rng(9)
    ways = [rng.normal(size=len(x)) * (0.1 * x if len(x) == 60 else 1.0) for x in point]
    pairs = zip(point, ways, strict=True)
    duals = flat(function(*(Column(map(Dual, x.tolist(), dx.tolist())) for x, dx in pairs)))
    slopes = np.array([x.slope if isinstance(x, Dual) else 0.0 for x in duals])
    h = 1e-6

    def moved(step: float) -> Array:
        return np.array(flat(function(*(column(x + step * dx) for x, dx in zip(point, ways, strict=True)))))

    differences = (moved(h) - moved(-h)) / (2.0 * h)
    assert np.abs(slopes - differences).max() < 1e-6 * max(np.abs(slopes).max(), 1.0)


def regressor_flops(mechanism: Mechanism, columns: list[int]) -> int:
    sizes = dict.fromkeys(("p", "v", "v_r", "a_r"), 6)
    routine = trace(lambda p, v, v_r, a_r: tuple(mechanism.equations.torque_regressor(p, v, v_r, a_r, columns)), sizes)
    return routine.operations.flops


def tick_flops(mechanism: Mechanism, columns: list[int]) -> int:
    def tick(p: Column, v: Column, v_r: Column, a_r: Column, s: Column, beta: Column) -> tuple[Column, ...]:
        motion = mechanism.equations.motion(p, v, v_r, a_r)
        return motion.torque(spread(beta, columns, 60)), motion.powers(s, columns)

    sizes = dict.fromkeys(("p", "v", "v_r", "a_r", "s"), 6)
    return trace(tick, sizes | {"beta": len(columns)}).operations.flops


def test_the_price_of_36_columns() -> None:
    puma = load("puma560_measured")
    names = [f"{link}.{kind}" for link, kinds in TABLE_4_SET.items() for kind in kinds.split()]
    kept = sorted(puma.parameter_names.index(name) for name in names)
    assert regressor_flops(puma, kept) <= 950
    assert tick_flops(puma, kept) <= 1000


@pytest.mark.parametrize("flops", [regressor_flops, tick_flops])
def test_fewer_columns_cost_less(puma: Mechanism, kept: list[int], flops: Callable[..., int]) -> None:
    counts = [flops(puma, columns) for columns in (kept[-10:], kept[-20:], kept, list(range(60)))]
    assert counts == sorted(set(counts))


def test_a_value_that_must_not_steer_an_if_names_where() -> None:
    with pytest.raises(TraceError, match="where"):
        trace(lambda p: p if p[0] > 0.0 else -p, {"p": 2})
