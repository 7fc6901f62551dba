"""Gain at which a sampled loop loses stability: theory's, measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Self

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids, SlotineLi, typical_inertia
from adaptctl.control.gains.hold import hold_number
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism, load
from adaptctl.experiments.experiment import setting
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant, simulate_many
from adaptctl.sweeps.measurement import SweepMeasurement
from adaptctl.sweeps.outcome import FAILURES, RunOutcome

PUSH, LOST = 1e-3, 1e-3
"""rad/s (m/s) at which an arm sets off, and rad (m) of error at which it is lost: a thousand times what is due."""
SMALL = 0.5
"""of T_c lambda_max(M^-1 K): what any law may have."""


@dataclass(frozen=True)
class GainStability(SweepMeasurement):
    """Measurement of the gain at which a sampled control loop loses stability. Slotine and Li's law with the true
    parameters stabilises an arm about a random posture, drawn by `seed`, under a held (zero-order hold) torque for
    `periods` control periods, from joint velocities of 1e-3 rad/s (m/s), signs drawn too. The run is "done" where all
    position errors stay within 1e-3 rad (m), and "diverged" where one passes that.

    `robot` is a built-in robot's name or a file; `gain`, unitless, is T_c lambda_max(M^-1 K): T_c is `control_period`,
    s, lambda_max the largest eigenvalue, M the mass matrix at the posture and K the law's damping (velocity) gains, N m
    s/rad (N s/m if prismatic), proportional to the joints' typical inertias. Raises `InputError` at construction for
    settings of another type or out of their bounds, `NonFiniteError` for NaN or infinity.
    """

    name: ClassVar[str] = "gain-stability"

    robot: str = setting("puma560_measured", "a built-in robot or a file (.urdf, .xml, .toml)")
    gain: float = setting(1.0, "T_c lambda_max(M^-1 K) at the posture", low=0.01, high=10.0)
    control_period: float = setting(1e-3, "time a torque is held, s", symbol="T_c", low=1e-4, high=0.02)
    periods: int = setting(600, "control periods that the arm is held", low=10, high=100_000)

    @classmethod
    def outcomes(cls, chosen: Sequence[Self]) -> list[RunOutcome]:
        """List of the `RunOutcome` of each of the measurements `chosen`, in their order: "done", "diverged", or
        "failed" with the reason where the robot or its control loop cannot be made. Measurements of equal robot,
        control period and number of periods are simulated together; where one of these fails, all do. An
        `AdaptctlError`, an `ArithmeticError` or NumPy's `LinAlgError` is never raised."""
        groups: dict[tuple[str, float, int], list[int]] = {}
        for k, one in enumerate(chosen):
            groups.setdefault((one.robot, one.control_period, one.periods), []).append(k)
        found: dict[int, RunOutcome] = {}
        for members in groups.values():
            try:
                outcomes = _held([chosen[k] for k in members])
            except FAILURES as error:
                outcomes = [RunOutcome.failed(error)] * len(members)
            found |= zip(members, outcomes, strict=True)
        return [found[k] for k in range(len(chosen))]


@lru_cache(maxsize=8)
def _arm(robot: str, period: float) -> tuple[Mechanism, SlotineLi, Plant]:
    """The robot, a law that knows it, and its plant."""
    mechanism = load(robot)
    inertia, true = typical_inertia(mechanism), np.asarray(mechanism.inertial_parameters)
    damping = SMALL / hold_number(mechanism, inertia, period).value * inertia
    law = SlotineLi(ReducedModel.full(mechanism), np.ones(mechanism.dof), damping, None, true, period)
    return mechanism, law, Plant(mechanism, period, torque_limits=np.inf)


def _held(chosen: Sequence[GainStability]) -> list[RunOutcome]:
    first = chosen[0]
    mechanism, law, plant = _arm(first.robot, first.control_period)
    postures = [sampled_configurations(mechanism, 32, one.seed)[0] for one in chosen]
    laws = [law.having({"damping": _damping(mechanism, p, one)}) for p, one in zip(postures, chosen, strict=True)]
    push = [PUSH * np.random.default_rng(one.seed).choice([-1.0, 1.0], mechanism.dof) for one in chosen]
    still = np.zeros(mechanism.dof)
    runs = simulate_many(
        plant,
        laws,
        [Sinusoids(p, still, still, start_time=0.0) for p in postures],
        duration=first.periods * first.control_period,
        p=np.stack(postures),
        v=np.stack(push),
        every=None,
        beyond=LOST,
    )
    return RunOutcome.each_of(runs)


def _damping(mechanism: Mechanism, p: Array, chosen: GainStability) -> Array:
    """K (r,), alike to the typical inertia, with the gain at a posture (r,)."""
    inertia = typical_inertia(mechanism)
    root = np.sqrt(inertia)
    smallest = np.linalg.eigvalsh(mechanism.mass_matrix(p) / (root[:, None] * root))[0]
    return np.asarray(chosen.gain * smallest / chosen.control_period * inertia)
