"""What is watched of a run: its numbers are those of their definitions, written out sample by sample."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.control import CushionedFloor, Gradient, PassivityIntegral, ReferencePoint, SlotineLi, monitor_stability
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant

ARM = random_chain(3, 3)
MODEL = ReducedModel(ARM)
TRUE = MODEL.fundamental_parameters
K, PERIOD, BANDWIDTH, DAMPING = len(TRUE), 2e-3, np.array([6.0, 5.0, 7.0]), np.array([3.0, 4.0, 2.0])


class Run(NamedTuple):
    """A run, as far as its loop is judged by it."""

    p: Array
    v: Array
    reference_p: Array
    reference_v: Array
    reference_a: Array
    estimate: Array
    control_period: float = PERIOD


def any_run(samples: int = 40, seed: int = 0) -> Run:
    rng = np.random.default_rng(seed)
    return Run(*rng.normal(size=(5, samples, 3)), TRUE * rng.uniform(0.5, 1.5, (samples, 1)))


def law(adaptation: Any, kind: type[SlotineLi] = SlotineLi) -> SlotineLi:
    return kind(MODEL, BANDWIDTH, DAMPING, adaptation, TRUE, control_period=PERIOD)


GAIN = np.linspace(0.2, 2.0, K)
WHOLE = np.diag(GAIN) + 0.05


def a_and_hold(run: Run, gain: Array, k: int) -> tuple[float, float]:
    """T lambda_max(K^-1 Y Gamma Y') and T lambda_max(M^-1 (K + M^ Lambda)) of sample k."""
    p, v = run.p[k], run.v[k]
    v_r = run.reference_v[k] - BANDWIDTH * (p - run.reference_p[k])
    a_r = run.reference_a[k] - BANDWIDTH * (v - run.reference_v[k])
    Y = ARM.slotine_li_regressor(p, v, v_r, a_r)[:, list(MODEL.columns)]
    a = np.linalg.eigvals(np.linalg.solve(np.diag(DAMPING), Y @ gain @ Y.T)).real.max()
    supposed = ARM.with_parameters(MODEL.embed(run.estimate[k])).mass_matrix(p)
    hold = np.linalg.eigvals(np.linalg.solve(ARM.mass_matrix(p), np.diag(DAMPING) + supposed * BANDWIDTH)).real.max()
    return PERIOD * float(a), PERIOD * float(hold)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize("gain", [GAIN, WHOLE], ids=["diagonal", "whole"])
@pytest.mark.parametrize("every", [1, 7])
def test_numbers_are_those_of_their_definitions(gain: Array, every: int) -> None:
    run = any_run()
    seen = monitor_stability(law(gain), run, ARM, every)
    full = np.diag(gain) if gain.ndim == 1 else gain
    expected = np.array([a_and_hold(run, full, k) for k in range(0, len(run.p), every)])
    np.testing.assert_allclose(seen.adaptation_ratio, expected[:, 0], rtol=1e-9)
    np.testing.assert_allclose(seen.sampling_ratio, expected[:, 1], rtol=1e-9)


def test_ringing_is_of_all_ticks_however_few_are_told() -> None:
    run = any_run()
    s = run.v - run.reference_v + BANDWIDTH * (run.p - run.reference_p)
    product, square, last, rho = np.zeros(3), np.zeros(3), np.zeros(3), []
    for now in s:
        product, square = 0.99 * product + 0.01 * last * now, 0.99 * square + 0.01 * last**2
        rho.append(product / (square + 1e-4))
        last = now
    np.testing.assert_allclose(monitor_stability(law(GAIN), run, ARM).ringing, rho, rtol=1e-12)
    np.testing.assert_allclose(monitor_stability(law(GAIN), run, ARM, 9).ringing, rho[::9], rtol=1e-12)


def test_a_loop_that_learns_nothing_has_no_adaptation_number() -> None:
    seen = monitor_stability(law(None), any_run(), ARM, 5)
    np.testing.assert_array_equal(seen.adaptation_ratio, np.zeros(8))
    assert np.isfinite(seen.sampling_ratio).all()


def test_an_estimate_that_drives_instead_of_damping_is_told() -> None:
    run = any_run()
    run.estimate[5] = -1e3 * TRUE
    hold = monitor_stability(law(Gradient(GAIN)), run, ARM).sampling_ratio
    assert np.isinf(hold[5])
    assert np.isfinite(np.delete(hold, 5)).all()


@pytest.mark.parametrize("hold", [0.3, 1.4])
def test_in_a_free_loop_rho_is_one_less_the_hold_number(hold: float) -> None:
    """M s+ = (M - T K) s with the true parameters, from a velocity of 20 rad/s, for as long as it is heard."""
    arm = random_chain(3, 1)
    model = ReducedModel.full(arm)
    inertia, period, rest = float(arm.mass_matrix(np.zeros(1))[0, 0]), 1e-3, np.zeros(1)
    controller = SlotineLi(
        model,
        np.array([0.1]),
        np.array([hold * inertia / period]),
        None,
        arm.inertial_parameters,
        control_period=period,
    )
    plant, goal, rows = Plant(arm, period), ReferencePoint(rest, rest, rest), []
    state = plant.init(rest, np.array([20.0]))
    memory = controller.init(rest, np.array([20.0]))
    for _ in range(6):
        torque, memory = controller.step(memory, state.q, state.v, goal)
        rows.append((state.q, state.v, rest, rest, rest, memory.estimate))
        state = plant.step(state, torque)
    seen = monitor_stability(controller, Run(*map(np.array, zip(*rows, strict=True)), period), arm)
    np.testing.assert_allclose(seen.sampling_ratio, hold + period * 0.1, rtol=1e-9)
    assert seen.ringing[-1, 0] == pytest.approx(1.0 - hold, abs=0.02)


@pytest.mark.parametrize(
    ("controller", "says"),
    [
        (law(CushionedFloor(GAIN, 0.3, 15.0)), "monitor_stability: CushionedFloor has no constant gain"),
        (law(GAIN, PassivityIntegral), "that of PassivityIntegral needs more than the recorded tracking errors"),
    ],
)
def test_what_has_no_such_numbers_is_refused(controller: SlotineLi, says: str) -> None:
    with pytest.raises(InputError, match=says):
        monitor_stability(controller, any_run(), ARM)
