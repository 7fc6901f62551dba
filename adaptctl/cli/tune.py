"""`adaptctl tune`: a reference and gains for a robot, from its description alone, verified in closed loop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from adaptctl.cli.output import (
    Json,
    Period,
    Robot,
    WrappedTable,
    listed,
    print_json,
    print_parts,
    titled,
    words,
)
from adaptctl.cli.robot import AS_USUAL, RobotFlags

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptctl.simulation.effects.effect import Effect
    from adaptctl.tuning import Tuning, Verification

SCHEMA = "adaptctl/tuning/3"
DONE, FAILED = 0, 3
MAX_BITS, DIFFERENCE_CUTOFF = 32, 60.0  # Hz


def tune(
    robot: Robot,
    /,
    *,
    control_period: Period = 1e-3,
    bandwidth: float = 4.0,
    sampling_ratio: float = 0.5,
    adaptation_ratio: float = 0.5,
    search: int = 0,
    seed: int = 0,
    delay: int = 0,
    encoder_bits: int = 0,
    reading: RobotFlags = AS_USUAL,
    json: Json = False,
) -> int:
    """
    Choose a reference and gains for a robot, verify them in closed loop and print them.

    T is the control period, M the mass matrix, B viscous friction, Y the regressor and λ_max the largest eigenvalue.

    Parameters
    ----------
    bandwidth : float
        Largest bandwidth Λ, 1/s.
    sampling_ratio : float
        Damping K by its largest T λ_max(M⁻¹K) along the reference, with control period T and mass
        matrix M, corrected for viscous friction; stable below 2.
    adaptation_ratio : float
        Adaptation gain Γ by its largest T λ_max(K⁻¹ Y Γ Yᵀ) along the reference, with regressor Y; stable below 2.
    search : int
        Number of settings to try in closed loop, in addition to the tuning rules.
    seed : int
        Seed of the reference and of all other random numbers.
    delay : int
        Control periods by which torques arrive late, for which gains are lowered.
    encoder_bits : int
        Bits of a joint's turn that encoders tell, with velocities from differences filtered at 60 Hz; 0 for exact.

    Returns
    -------
    int
        Exit code: 0, or 3 where the robot does not learn.

    Raises
    ------
    InputError
        If a number is out of range, a joint moves no inertia or the mass matrix is not positive definite.
    NotFoundError
        If the robot is unknown.
    FileError
        If the robot's file cannot be used.
    LoopError
        If kinematic loops cannot be closed.
    """
    from adaptctl.tuning import tune as tuned

    mechanism = reading.load(robot)
    tuning = tuned(
        mechanism,
        control_period=control_period,
        bandwidth=bandwidth,
        sampling_ratio=sampling_ratio,
        adaptation_ratio=adaptation_ratio,
        search=search,
        seed=seed,
        effects=_effects(delay, encoder_bits),
    )
    if json:
        print_json(as_builtins(tuning))
    else:
        print_parts(report(tuning))
    return FAILED if tuning.failed else DONE


def _effects(delay: int, encoder_bits: int) -> list[Effect]:
    """Stated delay and counts."""
    from adaptctl.arrays import whole_number
    from adaptctl.simulation.effects import ControlDelay, Encoder, FilteredDifferences
    from adaptctl.simulation.effects.actuators import MAX_DELAY_PERIODS

    whole_number(delay, "delay", 0, MAX_DELAY_PERIODS)
    whole_number(encoder_bits, "encoder_bits", 0, MAX_BITS)
    late = [ControlDelay(delay)] if delay else []
    counts = [Encoder(resolution=math.tau / 2**encoder_bits), FilteredDifferences(DIFFERENCE_CUTOFF)]
    return [*late, *(counts if encoder_bits else [])]


def as_builtins(tuning: Tuning) -> dict[str, Any]:
    """
    Tuning in JSON's types; None is infinite.

    Returns
    -------
    dict
        For each of `joints` gains, error, limits and reference; control period, adaptation gain and integration;
        `sampling_ratio` and `achieved_adaptation_ratio`, the greatest along the reference, stable below 2; each run of
        `verified` with the fields of `Verification`; `notes`.
    """
    mechanism, reference = tuning.mechanism, tuning.reference
    joints = [
        {
            "name": joint.name,
            "bandwidth": float(tuning.gains.bandwidth[j]),
            "damping": float(tuning.gains.damping[j]),
            "initial_error": float(tuning.initial_error[j]),
            "torque_limit": float(tuning.torque_limits[j]),
            "torque_share": float(tuning.torque_share[j]),
            "limited_by": tuning.limited_by[j],
        }
        | {name: float(getattr(reference, name).ravel()[j]) for name in ("center", "amplitude", "frequency")}
        for j, joint in enumerate(mechanism.primary_joints)
    ]
    return {
        "schema": SCHEMA,
        "robot": {"name": mechanism.name, "sha256": mechanism.description.sha256},
        "control_period": tuning.control_period,
        "joints": joints,
        "adaptation": dict(zip(mechanism.parameter_names, tuning.adaptation.tolist(), strict=True)),
        "substeps": tuning.substeps,
        "integrator": type(tuning.integrator).__name__,
        "sampling_ratio": tuning.sampling_ratio,
        "achieved_adaptation_ratio": tuning.adaptation_ratio,
        "verified": [_verified(run) for run in tuning.verified],
        "notes": list(tuning.notes),
    }


def _verified(run: Verification) -> dict[str, Any]:
    from adaptctl.files import finite_or_none

    numbers = {
        name: finite_or_none(getattr(run, name))
        for name in (
            "initial_rms_error",
            "final_rms_error",
            "final_rms_error_adaptation_off",
            "max_error",
            "limited_share",
        )
    }
    return {"name": run.name, "is_learning": run.is_learning, **numbers}


def report(tuning: Tuning) -> Iterator[RenderableType]:
    """Parts of the report that `adaptctl tune` prints."""
    if tuning.failed:
        yield words((f"FAILED: the arm does not learn with these gains: {tuning.verified[0]}", "bold red"))
    method = (
        f"integrator {type(tuning.integrator).__name__}, {tuning.substeps} steps per {tuning.control_period:g} s period"
    )
    yield words(
        (tuning.mechanism.name, "bold"), f": gains by the tuning rules, for a rigid arm without noise; {method}"
    )
    yield titled("Gains and reference (SI units)", _joints(tuning))
    joints = (joint.name for joint in tuning.mechanism.primary_joints)
    yield titled("What limits the gains", listed(zip(joints, tuning.limited_by, strict=True)))
    runs = (words((f"{run}", "") if run.is_learning else (f"{run} (does not learn)", "red")) for run in tuning.verified)
    if tuning.verified:
        yield titled("Verification runs of 20 s from zero estimates: RMS errors of the first and last seconds", *runs)
    if tuning.notes:
        yield titled("Notes", *(words((note, "yellow")) for note in tuning.notes))


def _joints(tuning: Tuning) -> WrappedTable:
    rows = []
    moved = [getattr(tuning.reference, name).ravel() for name in ("center", "amplitude", "frequency")]
    for j, joint in enumerate(tuning.mechanism.primary_joints):
        numbers = (tuning.gains.bandwidth[j], tuning.gains.damping[j], *(values[j] for values in moved))
        rows.append([joint.name, *(f"{x:.3g}" for x in numbers), f"{tuning.torque_share[j]:.0%}"])
    return WrappedTable(("joint", "Λ", "K", "centre", "amplitude", "Hz", "torque"), rows)
