"""Code that is compiled quickly has the bits of optimized code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from adaptctl.compilation import compile_step, trace
from adaptctl.compilation.fusing import fused
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.dynamics import load
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import QUICK_PERIODS, ClosedLoop
from adaptctl.tuning import tune

FACTORS = (2.0, 3.0, -0.7, 1.5)


def tangle(seed: int) -> Any:
    """Random sums, differences and products, some of which are used more than once."""

    def step(x: Column, u: Column) -> tuple[Column, Column]:
        rng, known = np.random.default_rng(seed), [*x, *u]
        for _ in range(200):
            a, b = (known[int(k)] for k in rng.integers(max(0, len(known) - 12), len(known), 2))
            kind, factor = rng.integers(7), FACTORS[rng.integers(len(FACTORS))]
            made = [a + b, a - b, a * b, factor * a, -(a * b) - a, a * b - factor * b, factor * a + a * b][kind]
            known.append(made if rng.random() < 0.8 else 0.5 * made)
        return x + u, Column(0.01 * y for y in known[-20:])

    return step


@pytest.mark.usefixtures("optimized")
@pytest.mark.parametrize("seed", range(8))
def test_quick_code_of_random_equations_has_the_bits_of_optimized_code(seed: int) -> None:
    results = []
    for quick in (False, True):
        stepper = compile_step(tangle(seed), state={"x": 4}, inputs={"u": 4}, lanes=1, quick=quick, name="tangle")
        arms = stepper.ensemble(1)
        assert stepper.quick == quick
        arms.state["x"] = [0.3, -0.7, 1.1, 0.2]
        (recorded,) = arms.run(50, {"u": np.random.default_rng(1).normal(scale=0.1, size=(50, 4))}, record=True)
        results.append(recorded)
    np.testing.assert_array_equal(*results)


@pytest.mark.usefixtures("optimized")
@pytest.mark.parametrize("kind", ["gradient", False])
def test_a_loop_for_few_periods_has_the_bits_of_any(kind: str | bool) -> None:
    arm = load("two_link")
    tuned, model = tune(arm, nominal_only=True), ReducedModel(arm)
    plant = Plant(arm, 1e-3, tuned.substeps, tuned.integrator, tuned.torque_limits)
    loop, point = ClosedLoop(plant, tuned.controller(model, kind)), tuned.reference(1e-3 * np.arange(500))
    ends = []
    for periods in (QUICK_PERIODS, np.inf):
        code = loop.compiled(periods)
        assert code.quick == (periods == QUICK_PERIODS)
        arms = code.ensemble(1)
        state = plant.init(np.array([0.1, 0.2]), np.zeros(2))
        loop.set_state(arms, state, loop.controller.init(state.measured_p, state.measured_v))
        arms.held["parameters"] = arm.inertial_parameters
        signals = dict(zip(loop.reference, point, strict=True)) | {"noise": np.zeros((500, 0))}
        arms.run(500, signals)
        ends.append(arms.state.blocks.copy())
    np.testing.assert_array_equal(*ends)
    assert loop.compiled(1) is loop.compiled()  # what is there and runs faster is taken


def test_products_that_are_used_once_are_fused_and_no_others() -> None:
    def equation(x: Column) -> Column:
        product = x[0] * x[1]
        return Column((x[2] * x[3] + x[0], product + x[2], product - x[3]))

    text = program(trace(equation, {"x": 4}), Lanes(), quick=True).pieces
    assert text.count("@llvm.fmuladd.f64") == 1
    assert text.count("= fmul double") == 1


def test_nothing_is_fused_across_blocks() -> None:
    lines = ("%a = fmul contract double %x, %y", "br label %next", "next:", "%b = fadd contract double %a, %z")
    assert fused("\n".join(lines)) == "\n".join(lines).replace(" contract ", " ")
