"""The Slotine-Li regressor of the PUMA 560, 6 rows and the 36 columns that matter, against Pinocchio's."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio

from adaptctl.arrays import Array
from adaptctl.compilation import Ensemble, Kernel, compile_function, compile_step
from adaptctl.scalars import Column
from benchmarks.findings import Agreement, Finding, Speedup
from benchmarks.interleaved import Effort, Statement, race
from benchmarks.pinocchio_tracking import slotine_li_regressor
from benchmarks.tasks import puma_at_joints

ARGUMENTS = {"p": 6, "v": 6, "v_r": 6, "a_r": 6}
STEPS = 1000

ONE = "pinocchio.computeJointTorqueRegressor(model, data, p, v, a_r)"
WEIGHTLESS = "pinocchio.computeJointTorqueRegressor(weightless, weightless_data, p, v, rest)"


def measure(effort: Effort) -> Iterator[Finding]:
    """Call by call, and within a compiled loop."""
    model = puma_at_joints().arm.to_pinocchio()
    data, kernel = model.createData(), _kernel()
    weightless, rest = model.copy(), np.zeros(6)
    weightless.gravity = pinocchio.Motion.Zero()
    weightless_data = weightless.createData()
    yield from _agreements(model, data, kernel)
    p, v, v_r, a_r = np.random.default_rng(0).normal(size=(4, 6))
    names = {"pinocchio": pinocchio} | locals()
    scalar, lanes = _loop(1), _loop(None)
    at_once = lanes.stepper.lanes
    raced = race(
        {
            "call": Statement("call(p, v, v_r, a_r)", names | {"call": kernel.call}),
            "three": Statement("; ".join([ONE] * 3), names),
            "two": Statement(f"{ONE}; {WEIGHTLESS}", names),
            "one": Statement(ONE, names),
            "loop": Statement(lambda: scalar.run(STEPS), work=STEPS),
            "lanes": Statement(lambda: lanes.run(STEPS), work=STEPS * at_once),
        },
        effort,
    )
    what, one = "Slotine-Li regressor of the PUMA, 6 × 36", "one torque regressor of Pinocchio, a call"
    yield Speedup.of(f"{what}, a call", "three torque regressors of Pinocchio", raced, "call", "three", 20.0)
    yield Speedup.of(f"{what}, a call", "two of them, one without weight", raced, "call", "two", 15.0)
    yield Speedup.of(f"{what}, in a compiled loop", one, raced, "loop", "one", 15.0)
    yield Speedup.of(f"{what}, in {at_once} lanes", one, raced, "lanes", "one", 15.0)


def regressor(p: Column, v: Column, v_r: Column, a_r: Column) -> list[Column]:
    """Rows (r,) of the regressor of Slotine and Li, each with the 36 columns that matter."""
    task = puma_at_joints()
    return task.arm.equations.torque_regressor(p, v, v_r, a_r, task.model.columns)


def _kernel() -> Kernel:
    return compile_function(regressor, ARGUMENTS, name="regressor")


def _loop(lanes: int | None) -> Ensemble:
    """An ensemble of as many arms as there are lanes, at one state each."""
    stepper = compile_step(lambda **given: (regressor(**given),), state={}, constants=ARGUMENTS, lanes=lanes)
    ensemble = stepper.ensemble(stepper.lanes)
    for name, values in zip(ARGUMENTS, _states(stepper.lanes), strict=True):
        ensemble.held[name] = values
    return ensemble


def _states(count: int) -> Array:
    return np.random.default_rng(1).normal(size=(4, count, 6))


def _agreements(model: pinocchio.Model, data: pinocchio.Data, kernel: Kernel) -> Iterator[Finding]:
    """Relative to the largest entry."""
    task = puma_at_joints()
    lanes = _loop(None)
    p, v, v_r, a_r = states = _states(lanes.members)
    (in_lanes,) = lanes.run()
    theirs = np.array([slotine_li_regressor(model, data, *x)[:, task.model.columns] for x in states.swapaxes(0, 1)])
    native = np.array([kernel(*x) for x in states.swapaxes(0, 1)])
    arrays = task.arm.slotine_li_regressor(p, v, v_r, a_r, task.model.columns)
    largest = np.abs(theirs).max()
    for what, against, one, other, bound in (
        ("regressor", "Pinocchio", native, theirs, 1e-10),
        ("regressor, native", "NumPy", native, arrays, 1e-12),
        ("regressor, in lanes", "native, one by one", in_lanes, native, 1e-12),
    ):
        yield Agreement(what, against, float(np.abs(one - other).max() / largest), bound)
