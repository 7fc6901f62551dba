"""`adaptctl gains`: gains of the tracking loop for a robot, and how far they can be trusted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from adaptctl.cli.output import print_json, print_parts

if TYPE_CHECKING:
    from adaptctl.control import GainDesign

SCHEMA = "adaptctl/gains/1"
OWNERS = {"bandwidth": "bandwidth", "damping_ratio": "bandwidth", "poles": "poles", "weights": "lqr"}
"""The method that each flag is of."""


def gains(
    robot: Annotated[str, Parameter(help="A built-in robot's name, or a .urdf, .xml (MJCF) or .toml file.")],
    /,
    *,
    method: Annotated[
        Literal["bandwidth", "poles", "lqr"], Parameter(help="How the error's poles are chosen.")
    ] = "bandwidth",
    bandwidth: Annotated[float | None, Parameter(help="Method bandwidth: where both poles lie, 1/s; else 8.")] = None,
    damping_ratio: Annotated[
        float | None,
        Parameter(help="Method bandwidth: 1, if not given, for two equal real poles."),
    ] = None,
    poles: Annotated[
        tuple[complex, complex] | None,
        Parameter(metavar="S S", help="Method poles: two, 1/s, real or conjugate, such as -6+2j -6-2j; else -8 -12."),
    ] = None,
    weights: Annotated[
        tuple[float, float, float] | None,
        Parameter(
            metavar="P V A", help="Method lqr: weights of squares of error, rate and acceleration; else 4096 0 1."
        ),
    ] = None,
    period: Annotated[float, Parameter(help="Control period, s: how long a torque is held.")] = 1e-3,
    delay: Annotated[int, Parameter(help="Control periods from measurement to torque.")] = 0,
    floating_base: Annotated[
        bool, Parameter(help="Let a URDF file's root link float instead of being fixed to the ground.")
    ] = False,
    json: Annotated[bool, Parameter(help="Print JSON instead of tables.")] = False,
) -> None:
    """Design the gains of a robot's tracking loop, and print them with their margins, or with `json` a JSON object.

    Weights and poles are for the error of each joint, in rad (m if prismatic) and s. Raises `GainError` where the
    control period is too long for the gains (the JSON object's `sampled_gain` is above its `largest_sampled_gain`),
    `InputError` for numbers out of range, poles that are not real or conjugate or not stable, `floating_base` with a
    robot that is no URDF file, a flag of another `method`, and a typical inertia of a joint that is not positive;
    `FileError` for a robot's file that cannot be used, `NotFoundError` for an unknown robot, `LoopError` where
    kinematic loops cannot be closed.
    """
    from adaptctl.control import GainDesign
    from adaptctl.dynamics import load

    _require_own(method, bandwidth=bandwidth, damping_ratio=damping_ratio, poles=poles, weights=weights)
    mechanism = load(robot, floating_base=floating_base)
    match method:
        case "bandwidth":
            wanted = (8.0 if bandwidth is None else bandwidth, 1.0 if damping_ratio is None else damping_ratio)
            design = GainDesign.from_bandwidth(mechanism, *wanted, period=period, delay=delay)
        case "poles":
            design = GainDesign.from_poles(mechanism, poles or (-8.0, -12.0), period=period, delay=delay)
        case "lqr":
            design = GainDesign.from_lqr(mechanism, *(weights or (4096.0, 0.0, 1.0)), period=period, delay=delay)
    design.require_carried()
    if json:
        print_json(as_builtins(design))
    else:
        from adaptctl.cli.gains_report import report

        print_parts(report(design))


def _require_own(method: str, **given: object) -> None:
    """Raise `InputError` for a flag of another method, which would count for nothing."""
    from adaptctl.errors import InputError

    for name, value in given.items():
        owner = OWNERS[name]
        if value is not None and owner != method:
            raise InputError(
                f"--{name.replace('_', '-')}: it is of the method {owner}: give --method {owner}, or leave it"
            )


def as_builtins(design: GainDesign) -> dict[str, Any]:
    """A gain design in JSON's types. Each of the `joints` has the typical `inertia`, kg m^2 (kg if prismatic), for
    which its loop is designed, and `least_inertia`, no unit, the least inertia of the joint at any of 200 random
    configurations while all other joints are free, divided by `inertia`; `stiffness`, 1/s^2, and `rate`, 1/s, of the
    feedback of the tracking error e (measured less desired), e'' = -stiffness e - rate e', with its time derivatives e'
    and e''; its natural frequency `bandwidth`, rad/s, and `damping_ratio`, no unit; the gains of Slotine and Li's law,
    `slotine_li_bandwidth`, 1/s, and `slotine_li_damping`, N m s/rad (N s/m), None where poles are not real;
    `gain_margin` (no unit), `phase_margin` (rad), `delay_margin` (s) and `crossover` (rad/s), None for infinite or
    none.

    For all joints it has `method`, `period`, s, and `delay`, in periods; `sampled_gain`, the period times the largest
    eigenvalue of M^-1 K, with the mass matrix M and the velocity gains K, greatest over the configurations that were
    searched, `largest_sampled_gain`, the most that is allowed, and `fastest`, the factor by which poles may be faster,
    None for infinite; no units.
    """
    from adaptctl.files import finite_or_none

    mechanism, cascade = design.mechanism, design.damped_enough
    joints = [
        {
            "name": joint.name,
            "inertia": float(design.inertia[i]),
            "least_inertia": float(design.least_inertia[i]),
            "stiffness": design.feedback[i].stiffness,
            "rate": design.feedback[i].rate,
            "bandwidth": float(design.bandwidth[i]),
            "damping_ratio": float(design.damping_ratio[i]),
            "slotine_li_bandwidth": float(design.gains.bandwidth[i]) if cascade else None,
            "slotine_li_damping": float(design.gains.damping[i]) if cascade else None,
            "gain_margin": finite_or_none(design.margins[i].gain),
            "phase_margin": finite_or_none(design.margins[i].phase),
            "delay_margin": finite_or_none(design.margins[i].delay),
            "crossover": finite_or_none(design.margins[i].crossover),
        }
        for i, joint in enumerate(mechanism.primary_joints)
    ]
    return {
        "schema": SCHEMA,
        "robot": {"name": mechanism.name, "sha256": mechanism.description.sha256},
        "method": design.method,
        "period": design.period,
        "delay": design.delay,
        "joints": joints,
        "sampled_gain": design.sampled_gain,
        "largest_sampled_gain": design.largest_sampled_gain,
        "fastest": finite_or_none(design.fastest),
    }
