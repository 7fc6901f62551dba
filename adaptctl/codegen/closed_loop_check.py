"""Simulated check of a controller before export."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface, status_of
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import Reference, ReferencePoint, Sinusoids, TaskSpaceSlotineLi
from adaptctl.control.gains.workspace import position_range
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import InputError, NonFiniteError, VerdictError
from adaptctl.files import finite_or_none
from adaptctl.scalars import column
from adaptctl.simulation import Episode, Plant
from adaptctl.simulation.integrator import integration
from adaptctl.simulation.rollout import KeptSamples
from adaptctl.simulation.simulate import EpisodeRun, Stretch
from adaptctl.stages import stage

TICKS = 100
AMPLITUDE, INITIAL_ERROR = 0.1, 0.02
"""rad or m, of the default reference and the arm's distance from it"""
MIN_FREQUENCY, FREQUENCY_STEP = 0.2, 0.06
"""Hz, of the first joint, and increment per joint"""
LIMIT_MARGIN = 0.15
"""rad or m between the reference's centre and joint limits"""


@dataclass(frozen=True)
class RecordedTick:
    """Arguments and results of a control step, for a test of exported code."""

    p: Array
    v: Array
    reference: ReferencePoint
    torque: Array
    status: int


def default_reference(interface: Interface) -> Reference:
    """Sinusoids of 0.1 rad or m (0.05 m in a task space)."""
    law, size = interface.innermost, interface.controller.reference_size
    center, amplitude = centre(interface), AMPLITUDE
    if isinstance(law, TaskSpaceSlotineLi) and not law.reference_in_joints:
        x, _ = law.point(column(law.model.mechanism.configuration(center)))
        center, amplitude = np.array(x.of), 0.5 * AMPLITUDE
    elif not interface.follows_joints:
        center = np.zeros(size)
    return Sinusoids(center, np.full(size, amplitude), np.asarray(MIN_FREQUENCY + FREQUENCY_STEP * np.arange(size)))


def centre(interface: Interface) -> Array:
    """Center (r,) of the motion: home, or near it within the limits."""
    home, mechanism = np.asarray(interface.controller.neutral_configuration, dtype=np.float64), interface.mechanism
    if mechanism is None or mechanism.description.loops is not None:
        return home
    lower, upper = position_range(mechanism)
    margin = np.minimum(LIMIT_MARGIN, 0.5 * (upper - lower))
    return np.clip(home, lower + margin, upper - margin)


def record(interface: Interface, reference: Reference, ticks: int = TICKS) -> tuple[list[RecordedTick], Any]:
    """Control steps recorded in Python, and the final state."""
    controller, rows = interface.controller, []
    time = np.asarray(interface.control_period * np.arange(ticks), dtype=np.float64)
    p, v = _motion(interface, reference, time)
    points = reference(time)
    state = controller.init(p[0], np.zeros(controller.dof))
    for k in range(ticks):
        point = ReferencePoint(*(np.ascontiguousarray(np.asarray(part)[k]) for part in points))
        torque, state = controller.step(state, p[k], v[k], point)
        rows.append(RecordedTick(p[k], v[k], point, torque, status_of(interface, state)))
    return rows, state


def first_torque(interface: Interface, tick: RecordedTick, held: Array) -> Array:
    """Torque (r,) of a first tick after the torque `held`."""
    law: Any = interface.controller
    state = law.init(tick.p, np.zeros(law.dof), torque=held)
    torque: Array = law.step(state, tick.p, tick.v, tick.reference)[0]
    return torque


def _motion(interface: Interface, reference: Reference, time: Array) -> tuple[Array, Array]:
    """Positions and velocities (T, r) near the reference."""
    r = interface.controller.dof
    rate = np.asarray(2.0 * np.pi * (3.0 + np.arange(r)), dtype=np.float64)
    off, slope = (
        INITIAL_ERROR * np.sin(rate * time[:, None] + 1.0),
        INITIAL_ERROR * rate * np.cos(rate * time[:, None] + 1.0),
    )
    if not interface.follows_joints:
        return centre(interface) + off, slope
    points = reference(time)
    return np.asarray(points.p) + off, np.asarray(points.v) + slope


DURATION = 600.0
"""s"""
SMALL_ERROR, LEARNED_SHARE = 5e-3, 1.0 / 3.0
"""rad or m, and fraction of the first error; a last error above both fails"""
FAILURES = {
    "stopped": "the safety limits stop the arm after {:g} s; use smaller gains, or wider limits",
    "ringing": "a joint oscillates after {:g} s; use smaller gains or a shorter period",
}
"""flags that fail the check, and their meanings"""


def check_closed_loop(
    interface: Interface, reference: Reference, duration: float = DURATION, anyway: bool = False
) -> dict[str, Any]:
    """Outcome of a closed-loop simulation, in JSON's types."""
    mechanism, controller = interface.mechanism, interface.controller
    if mechanism is None or len(mechanism.links) > MAX_COMPILED_LINKS:
        raise InputError("check: the controller has no mechanism to simulate; export it without the check")
    period = interface.control_period
    plant = Plant(mechanism, period, *integration(mechanism, (), period))
    run = EpisodeRun(_episode(plant, interface, reference, round(duration / period)), controller, KeptSamples(most=1))
    squares: list[Array] = []
    failure = None
    while failure is None and not run.over:
        with stage(f"simulating {duration:g} s of the closed loop, {run.count / run.steps:.0%} done"):
            stretch, failure = _sound(run)
        if interface.follows_joints:
            squares.append(np.full(1, np.nan) if stretch is None else _squares(plant, stretch))
    count = round(min(10.0, duration) / period)
    square = np.concatenate(squares) if squares else np.zeros(0)
    started, ended = (float(np.sqrt(part.mean())) if squares else None for part in (square[:count], square[-count:]))
    if failure is None and started is not None and ended is not None and 2 * count <= run.steps:
        failure = _unlearned(interface, started, ended)
    if failure is not None and not anyway:
        raise VerdictError(f"check: in simulation {failure}, or export it anyway (`anyway`, --anyway)")
    return {
        "duration": duration,
        "reference": stated(reference),
        "failure": failure,
        "finite": run.lost is None,
        "rms_error_first_10_s": finite_or_none(started),
        "rms_error_last_10_s": finite_or_none(ended),
    }


def stated(reference: Reference) -> dict[str, Any]:
    """Reference in JSON's types."""
    if not isinstance(reference, Sinusoids):
        return {"kind": type(reference).__name__}
    names = ("center", "amplitude", "frequency", "phase", "start_time")
    return {"kind": "Sinusoids"} | {name: np.asarray(getattr(reference, name)).tolist() for name in names}


def _episode(plant: Plant, interface: Interface, reference: Reference, steps: int) -> Episode:
    point = np.asarray(reference(0.0).p, dtype=np.float64)
    p = point if interface.follows_joints else np.asarray(interface.controller.neutral_configuration)
    state, parameters = plant.init(p, np.zeros(plant.dof)), plant.mechanism.inertial_parameters
    return Episode(plant, state, parameters, reference, np.random.default_rng(0), steps, _unjudged)


def _squares(plant: Plant, stretch: Stretch) -> Array:
    """Mean squares (n,) of the position errors."""
    error = plant.positions(stretch.sample.q) - stretch.reference.p[:-1]
    return np.asarray((error**2).mean(axis=1))


def _unjudged(q: Array, v: Array, point: ReferencePoint, torque: Array) -> tuple[Array, NDArray[np.bool_]]:
    return np.zeros(len(q)), np.zeros(len(q), dtype=np.bool_)


def _sound(run: EpisodeRun) -> tuple[Stretch | None, str | None]:
    """Next chunk, None if not finite; reason and time of a failure."""
    try:
        stretch = run.advance()
    except NonFiniteError:
        if run.lost is None:  # the reference is not finite
            raise
        return None, (f"the loop diverges after {run.lost:g} s; use smaller gains or a shorter period")
    for flag, what in FAILURES.items():
        if flag in run.loop.flags:
            marked = stretch.sample.flags[:, run.loop.flags.index(flag)] != 0.0
            if marked.any():
                return stretch, what.format(stretch.time[int(marked.argmax())])
    return stretch, None


def _unlearned(interface: Interface, started: float, ended: float) -> str | None:
    """Reason why an adaptive law's last error is too large, or None."""
    if getattr(interface.innermost, "adaptation_law", None) is None or ended <= max(
        SMALL_ERROR, LEARNED_SHARE * started
    ):
        return None
    unit = "" if interface.mechanism is None else error_unit(interface.mechanism)
    first, last = (f"{1e3 * error:.3g} {unit}" for error in (started, ended))
    return f"it does not learn: the error is {first} initially and {last} finally; use other gains"
