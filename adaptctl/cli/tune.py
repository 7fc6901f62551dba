"""`adaptctl tune`: a reference and gains for a robot, from its description alone, verified in closed loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from adaptctl.cli.output import (
    FloatingBase,
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
from adaptctl.files import finite_or_none

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptctl.tuning import Tuning, Verification

SCHEMA = "adaptctl/tuning/2"
DONE, FAILED = 0, 3


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
    floating_base: FloatingBase = False,
    json: Json = False,
) -> int:
    """Choose a reference and gains for a robot, and print them, with what limits them and the errors of verifying runs,
    or with `json` a JSON object. Returns the exit code: 0, or 3 where the arm as described does not learn with them.

    The law is Slotine and Li's, whose errors decay at rates Λ (1/s), with damping K (N m s/rad, N s/m if prismatic) and
    adaptation gain Γ. In the options' help T is the control period (s), M the mass matrix, B viscous friction, Y the
    regressor of the parameters, Y' its transpose, and λ_max the largest eigenvalue; `hold` and `adaptation` have no
    unit. Raises `InputError` for numbers out of range, a joint that moves no inertia or a mass matrix that is not
    positive definite, and `floating_base` with a robot that is no URDF file, `FileError` for a robot's file that cannot
    be used, `NotFoundError` for an unknown robot, `LoopError` where kinematic loops cannot be closed.

    Args:
        bandwidth: Largest Λ, 1/s.
        hold: Largest T λ_max((M + T B)⁻¹K) along the reference.
        adaptation: T λ_max(K⁻¹ Y Γ Y') along the reference.
        search: Settings that are tried in closed loop besides those by rule.
        seed: Seed of the reference, and of all else that is drawn.
    """
    from adaptctl.dynamics import load
    from adaptctl.tuning import tune as tuned

    mechanism = load(robot, floating_base=floating_base)
    tuning = tuned(
        mechanism,
        control_period=control_period,
        bandwidth=bandwidth,
        sampling_ratio=sampling_ratio,
        adaptation_ratio=adaptation_ratio,
        search=search,
        seed=seed,
    )
    if json:
        print_json(as_builtins(tuning))
    else:
        print_parts(report(tuning))
    return FAILED if tuning.failed else DONE


def as_builtins(tuning: Tuning) -> dict[str, Any]:
    """A tuning in JSON's types. Each of the `joints` has Slotine and Li's gains, `bandwidth` (1/s) and `damping` (N m
    s/rad, N s/m if prismatic), `initial_error` (rad, m), `torque_limit` (N m, N), `torque_share`, the largest fraction
    of it that the reference asks (no unit), `limited_by`, words on what limits the gains, and the reference's `center`
    and `amplitude` (rad, m) and `frequency` (Hz).

    For all there are the control `period` T (s), the diagonal of the `adaptation` gain Gamma by parameter (its unit
    squared per J), and the integration (`substeps` a period, `integrator`). Two numbers, no unit, are the greatest of
    the sampled loop along the reference, stable below 2: `sampling_ratio`, the damping number, the largest eigenvalue
    of T (M + T B)^-1 K, with the mass matrix M, viscous friction B and damping K, and `achieved_adaptation_ratio`, that
    of T K^-1 Y Gamma Y', with the parameters' regressor Y and its transpose Y'. Each run of `verified` has its `name`,
    `is_learning`, True where it stayed near the reference and errors fell to a third, root mean square errors (rad, m)
    over the `first` second, the `last` two, and these with adaptation `off`, the `largest` error, and `limited`, the
    fraction, 0 to 1, of the run's second half with a torque at its limit; None for infinite. `notes` are sentences.
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
    numbers = {
        name: finite_or_none(getattr(run, name)) for name in ("first", "last", "parameter_error", "largest", "limited")
    }
    return {"name": run.name, "is_learning": run.is_learning, **numbers}


def report(tuning: Tuning) -> Iterator[RenderableType]:
    """Renderable parts, texts and tables of the package rich, of the report that `adaptctl tune` prints, from top to
    bottom: a verdict of failure, where it is one, each joint's gains and reference, what limits the gains, the errors
    of verifying runs, and notes, the last two where there are any. Nothing is raised."""
    if tuning.failed:
        yield words((f"FAILED: with these gains the arm does not learn: {tuning.verified[0]}", "bold red"))
    method = f"{tuning.substeps} steps of {type(tuning.integrator).__name__} a period of {tuning.control_period:g} s"
    yield words((tuning.mechanism.name, "bold"), f": gains by rule for a rigid arm without noise; {method}")
    yield titled("Gains and reference (SI units)", _joints(tuning))
    joints = (joint.name for joint in tuning.mechanism.primary_joints)
    yield titled("What limits the gains", listed(zip(joints, tuning.limited_by, strict=True)))
    runs = (words((f"{run}", "") if run.is_learning else (f"{run} (does not learn)", "red")) for run in tuning.verified)
    if tuning.verified:
        yield titled("Runs of 20 s, RMS errors of the first second and of the last two", *runs)
    if tuning.notes:
        yield titled("Notes", *(words((note, "yellow")) for note in tuning.notes))


def _joints(tuning: Tuning) -> WrappedTable:
    rows = []
    moved = [getattr(tuning.reference, name).ravel() for name in ("center", "amplitude", "frequency")]
    for j, joint in enumerate(tuning.mechanism.primary_joints):
        numbers = (tuning.gains.bandwidth[j], tuning.gains.damping[j], *(values[j] for values in moved))
        rows.append([joint.name, *(f"{x:.3g}" for x in numbers), f"{tuning.torque_share[j]:.0%}"])
    return WrappedTable(("joint", "Λ", "K", "centre", "amplitude", "Hz", "torque"), rows)
