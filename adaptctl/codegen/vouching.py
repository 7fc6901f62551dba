"""The long run that vouches for a controller before it leaves: ten minutes on its own arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface
from adaptctl.compilation.floats import LARGEST_COMPILED
from adaptctl.control import Reference, Sinusoids
from adaptctl.errors import InputError, VerdictError
from adaptctl.files import finite_or_none
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.sampled_references import REFERENCE, sampled
from adaptctl.simulation.stiffness import integration

DURATION = 600.0
"""s"""
STRETCH = 10_000
"""control periods in one native call"""
SMALL, LEARNED = 5e-3, 1.0 / 3.0
"""rad or m, and share of the first error: a last error above both was not learned away"""
FAILURES = {
    "stopped": "the guards stop the arm after {:g} s: use smaller gains, or wider limits",
    "ringing": "a joint rings after {:g} s: use smaller gains or a shorter period",
}
"""What guards may mark in a period, and what it means"""


def vouched(
    interface: Interface, reference: Reference, duration: float = DURATION, anyway: bool = False
) -> dict[str, Any]:
    """Outcome, a dict in JSON's types, of a simulation of the controller of an `interface` on its own mechanism along
    `reference`, a function of time (s), for `duration` s, 600 unless given.

    It has "duration", s; "reference", a dict of its class's name and, for `Sinusoids`, their numbers, by which the run
    can be repeated; "failure", None, or what is wrong in words; "finite", True unless that ended the run; and
    "rms_error_first_10_s" and "rms_error_last_10_s", the root mean square of the position errors over all joints
    together, rad (m if prismatic), and over the first and the last 10 s (the whole of a shorter run), None where the
    reference is not one of joints or they are not finite.

    The run fails where it becomes non-finite, guards stop it or hear it ring, or a law that adapts does not learn: its
    last error is above 5 mrad (mm) and a third of the first, in a run of 20 s or more. Raises `VerdictError` for that
    unless `anyway`; `InputError` where no mechanism is known or it has more than 100 links, and for a reference for
    another number of coordinates; `NonFiniteError` for a reference that is not finite; `TraceError` for a law that
    cannot be traced.
    """
    mechanism, controller = interface.mechanism, interface.controller
    if mechanism is None or len(mechanism.links) > LARGEST_COMPILED:
        raise InputError("check: the controller names no mechanism that can be simulated; export it without the check")
    period = interface.period
    plant = Plant(mechanism, period, *integration(mechanism, (), period))
    loop = ClosedLoop(plant, controller)
    arms, steps = loop.compiled().ensemble(1), round(duration / period)
    p = _first(interface, reference)
    loop.begin(arms, plant.init(p, np.zeros(plant.dof)), controller.init(p, np.zeros(plant.dof)))
    arms.held["parameters"] = mechanism.inertial_parameters
    squares: list[Array] = []
    finite, failure = True, None
    for first in range(0, steps, STRETCH):
        time = np.asarray(period * np.arange(first, min(first + STRETCH, steps)), dtype=np.float64)
        points = sampled(reference, time, controller.reference_size)
        signals = dict(zip(REFERENCE, points, strict=True)) | {"noise": np.zeros((len(time), 0))}
        sample = Sample(*(values[:, 0] for values in arms.run(len(time), signals, record=True)))
        finite, failure = _sound(loop, sample, time)
        if interface.follows_joints:
            squares.append(((plant.positions(sample.q) - points.p) ** 2).mean(axis=1))
        if failure is not None:
            break
    count = round(min(10.0, duration) / period)
    square = np.concatenate(squares) if squares else np.zeros(0)
    begun, ended = (float(np.sqrt(part.mean())) if squares else None for part in (square[:count], square[-count:]))
    if failure is None and begun is not None and ended is not None and 2 * count <= steps:
        failure = _unlearned(interface, begun, ended)
    if failure is not None and not anyway:
        raise VerdictError(f"check: in simulation {failure}, or export it all the same (`anyway`, --anyway)")
    return {
        "duration": duration,
        "reference": stated(reference),
        "failure": failure,
        "finite": finite,
        "rms_error_first_10_s": finite_or_none(begun),
        "rms_error_last_10_s": finite_or_none(ended),
    }


def stated(reference: Reference) -> dict[str, Any]:
    """A `reference` in JSON's types, for a manifest: a dict of "kind", the name of its class, and, for `Sinusoids`,
    "center" (r,) and "amplitude" (h, r), rad (m if prismatic), "frequency", Hz, and "phase", rad, (h, r) each, lists of
    the numbers of h sinusoids for each of r coordinates, and "start_time", s, in which they fade in. Nothing is
    raised."""
    if not isinstance(reference, Sinusoids):
        return {"kind": type(reference).__name__}
    names = ("center", "amplitude", "frequency", "phase", "start_time")
    return {"kind": "Sinusoids"} | {name: np.asarray(getattr(reference, name)).tolist() for name in names}


def _first(interface: Interface, reference: Reference) -> Array:
    """Positions (r,) at which the run begins: on the reference where it is one of joints, else at home."""
    point = np.asarray(reference(0.0).p, dtype=np.float64)
    return point if interface.follows_joints else np.asarray(interface.controller.home)


def _sound(loop: ClosedLoop, sample: Sample, time: Array) -> tuple[bool, str | None]:
    """True where all is finite; and what is wrong, with the time of it, in words, None where nothing is."""
    finite = (
        np.isfinite(sample.torque).all(axis=1) & np.isfinite(sample.q).all(axis=1) & np.isfinite(sample.v).all(axis=1)
    )
    if not finite.all():
        when = time[int(finite.argmin())]
        return False, (
            f"the loop is not finite after {when:g} s: exported, this would be an arm that runs away; use smaller "
            "gains or a shorter period"
        )
    for mark, what in FAILURES.items():
        if mark in loop.marks and (marked := sample.marks[:, loop.marks.index(mark)] > 0.5).any():
            return True, what.format(time[int(marked.argmax())])
    return True, None


def _unlearned(interface: Interface, begun: float, ended: float) -> str | None:
    """Words on a law that adapts and whose error (rad or m) did not become small; else None."""
    if getattr(interface.innermost, "adaptation_law", None) is None or ended <= max(SMALL, LEARNED * begun):
        return None
    return f"it does not learn: an error of {begun:.3g} at first and {ended:.3g} in the end; use other gains"
