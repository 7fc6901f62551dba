"""`adaptctl gains`: gains of the tracking loop for a robot, and how far they can be trusted."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from adaptctl.cli.output import (
    Json,
    Period,
    Robot,
    Words,
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

    from adaptctl.control import GainDesign
    from adaptctl.dynamics import Mechanism

SCHEMA = "adaptctl/gains/2"
METHODS = {
    "rule": "by the tuning rules, near a reference within the torque limits",
    "bandwidth": "from a bandwidth and a damping ratio",
    "poles": "by pole placement",
    "lqr": "by LQR",
}
OWNERS = {"bandwidth": "bandwidth", "damping_ratio": "bandwidth", "poles": "poles", "weights": "lqr"}
"""The method that each flag is of."""
GAINS = {
    **{name: name for name in ("inertia", "stiffness", "rate")},
    **{"bandwidth": "ω", "damping_ratio": "ζ", "slotine_li_bandwidth": "Λ", "slotine_li_damping": "K"},
}
"""What is printed of each joint's gains, and how its column is called."""


def gains(
    robot: Robot,
    /,
    *,
    method: Literal["bandwidth", "poles", "lqr"] = "bandwidth",
    bandwidth: float | None = None,
    damping_ratio: float | None = None,
    poles: Annotated[tuple[complex, complex] | None, Parameter(metavar="S S")] = None,
    weights: Annotated[tuple[float, float, float] | None, Parameter(metavar="P V A")] = None,
    control_period: Period = 1e-3,
    delay: int = 0,
    reading: RobotFlags = AS_USUAL,
    json: Json = False,
) -> None:
    """
    Design the gains of a robot's tracking loop, and print them with their margins.

    By default they are those that `adaptctl tune` finds. Weights and poles are for the error of each joint, in rad (m
    if prismatic) and s.

    Parameters
    ----------
    method : str
        Design method.
    bandwidth : float
        Largest bandwidth Λ, 1/s, for --method bandwidth. Default: 4.
    damping_ratio : float
        Damping ratio of two poles of each joint, for --method bandwidth. Default: the largest damping K that is safe.
    poles : tuple of complex
        Two poles, 1/s, real or conjugate, such as -6+2j -6-2j, for --method poles. Default: -8 -12.
    weights : tuple of float
        Weights of squared error, rate and acceleration, for --method lqr. Default: 4096 0 1.
    delay : int
        Delay from measurement to torque, in control periods.

    Raises
    ------
    GainError
        If the control period is too long for the gains.
    InputError
        If an argument is out of range, of another method, or a joint's inertia is not positive.
    NotFoundError
        If the robot is unknown.
    FileError
        If the robot's file cannot be used.
    LoopError
        If kinematic loops cannot be closed.
    """
    from adaptctl.control import GainDesign

    _validate_own(method, bandwidth=bandwidth, damping_ratio=damping_ratio, poles=poles, weights=weights)
    mechanism, limited = reading.load(robot), tuple[str, ...]()
    match method:
        case "bandwidth" if damping_ratio is not None:
            wanted = 4.0 if bandwidth is None else bandwidth
            design = GainDesign.from_bandwidth(
                mechanism, wanted, damping_ratio, control_period=control_period, delay=delay
            )
        case "bandwidth":
            design, limited = _by_rule(mechanism, bandwidth, control_period, delay)
        case "poles":
            design = GainDesign.from_poles(
                mechanism, poles or (-8.0, -12.0), control_period=control_period, delay=delay
            )
        case "lqr":
            design = GainDesign.from_lqr(
                mechanism, *(weights or (4096.0, 0.0, 1.0)), control_period=control_period, delay=delay
            )
    design.check_sample_time()
    if json:
        print_json(as_builtins(design, limited))
    else:
        print_parts(report(design, limited))


def _by_rule(
    mechanism: Mechanism, bandwidth: float | None, control_period: float, delay: int
) -> tuple[GainDesign, tuple[str, ...]]:
    """The design of the default gains, and what limits each joint's."""
    from adaptctl.arrays import whole_number
    from adaptctl.control import GainDesign
    from adaptctl.control.gains.error_feedback import MAX_DELAY
    from adaptctl.control.gains.gain_design import largest_with_delay
    from adaptctl.tuning.default_gains import DEFAULT_BANDWIDTH, DEFAULT_SAMPLING_RATIO, DefaultGains, near_reference
    from adaptctl.tuning.feasible_gains import limitations

    rule = DefaultGains.for_mechanism(mechanism, control_period=control_period)
    whole_number(delay, "delay", 0, MAX_DELAY)
    hold = DEFAULT_SAMPLING_RATIO * largest_with_delay(delay) / largest_with_delay(0)
    carried = rule.carried(DEFAULT_BANDWIDTH if bandwidth is None else bandwidth, hold)
    place = near_reference(mechanism, rule.reference, rule.initial_error)
    design = GainDesign.from_gains(mechanism, carried.gains, place, control_period=control_period, delay=delay)
    return design, limitations(mechanism, carried)


def _validate_own(method: str, **given: object) -> None:
    """Raise `InputError` for a flag of another method, which would count for nothing."""
    from adaptctl.errors import InputError

    for name, value in given.items():
        owner = OWNERS[name]
        if value is not None and owner != method:
            raise InputError(
                f"--{name.replace('_', '-')}: applies only to --method {owner}: add it, or remove this flag"
            )


def as_builtins(design: GainDesign, limited: tuple[str, ...] = ()) -> dict[str, Any]:
    """A gain design in JSON's types."""
    from adaptctl.files import finite_or_none

    mechanism, cascade = design.mechanism, design.is_well_damped
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
            "limited_by": limited[i] if limited else None,
        }
        for i, joint in enumerate(mechanism.primary_joints)
    ]
    return {
        "schema": SCHEMA,
        "robot": {"name": mechanism.name, "sha256": mechanism.description.sha256},
        "method": design.method,
        "control_period": design.control_period,
        "delay": design.delay,
        "joints": joints,
        "sampled_gain": design.sampled_gain,
        "largest_sampled_gain": design.largest_sampled_gain,
        "fastest": finite_or_none(design.max_bandwidth_factor),
    }


def report(design: GainDesign, limited: tuple[str, ...] = ()) -> Iterator[RenderableType]:
    """Parts of the report that `adaptctl gains` prints."""
    late = f" and a delay of {design.delay} period{'s' * (design.delay != 1)}" if design.delay else ""
    how = f": gains {METHODS[design.method]}, discretised for a control period of {design.control_period:g} s{late}"
    yield words((design.mechanism.name, "bold"), how)
    joints = as_builtins(design)["joints"]
    gains = [[joint["name"], *(_number(joint[key]) for key in GAINS)] for joint in joints]
    title = "Gains (SI units; ω and ζ for computed torque, Λ and K for Slotine and Li's law)"
    yield titled(title, WrappedTable(("joint", *GAINS.values()), gains))
    margins = [[joint["name"], *_margins(design, i)] for i, joint in enumerate(joints)]
    title = "Stability margins of each loop (inertia: minimum divided by typical)"
    yield titled(title, WrappedTable(("joint", "gain", "inertia", "phase", "delay", "periods", "crossover"), margins))
    yield titled("Sampling condition for all joints together", *map(words, _together(design)))
    if limited:
        names = (joint["name"] for joint in joints)
        yield titled("What limits the gains", listed(zip(names, limited, strict=True)))


def _margins(design: GainDesign, i: int) -> Iterator[Words]:
    of, least = design.margins[i], float(design.least_inertia[i])
    yield f"× {_number(of.gain)}"
    yield f"× {_number(least)}", "" if of.gain * least > 1.0 else "red"
    yield from (f"{math.degrees(of.phase):.0f}°", f"{1e3 * of.delay:.3g} ms", f"{of.delay / design.control_period:.3g}")
    yield f"{_number(of.crossover)} rad/s"


def _together(design: GainDesign) -> Iterator[str]:
    """Sampled gain of the whole arm, and the fastest poles that the period carries."""
    yield (
        f"T_c λ_max(M⁻¹K) = {design.sampled_gain:.3g} at the worst configuration found; up to "
        f"{design.largest_sampled_gain:.3g} is allowed, with a margin to instability"
    )
    fastest = design.max_bandwidth_factor * design.max_pole_magnitude
    yield (
        "Any poles are stable at this period."
        if math.isinf(design.max_bandwidth_factor)
        else f"At this period, poles up to {design.max_bandwidth_factor:.3g} times as fast are stable: the fastest at "
        f"{fastest:.4g} 1/s instead of {design.max_pole_magnitude:.4g}."
    )
    if not design.is_well_damped:
        yield "Λ and K need a damping ratio of at least 1."


def _number(value: float | None) -> str:
    return "–" if value is None or math.isnan(value) else "∞" if math.isinf(value) else f"{value:.4g}"
