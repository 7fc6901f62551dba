"""The long run that vouches for a controller before it leaves: ten minutes on its own arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface
from adaptctl.compilation.floats import LARGEST_COMPILED
from adaptctl.control import Reference, Sinusoids
from adaptctl.errors import InputError
from adaptctl.simulation import Plant
from adaptctl.simulation.closed_loop import ClosedLoop, Sample
from adaptctl.simulation.sampled_references import REFERENCE, sampled
from adaptctl.simulation.stiffness import integration

DURATION = 600.0
"""s"""
STRETCH = 10_000
"""control periods in one native call"""


def vouched(interface: Interface, reference: Reference, duration: float = DURATION) -> dict[str, Any]:
    """Outcome, a dict in JSON's types, of a simulation of the controller of an `interface` on its own mechanism along
    `reference`, a function of time (s), for `duration` s, 600 unless given.

    It has "duration", s; "reference", a dict of its class's name and, for `Sinusoids`, their numbers, by which the run
    can be repeated; "finite", True; and "rms_error_first_10_s" and "rms_error_last_10_s", the root mean square of the
    position errors over all joints together, rad (m if prismatic), and over the first and the last 10 s (the whole of a
    shorter run), None where the reference is not one of joints.

    Raises `InputError` where the run becomes non-finite or guards stop it, where no mechanism is known or it has more
    than 100 links, and for a reference for another number of coordinates; `NonFiniteError` for a reference that is not
    finite; `TraceError` for a law that cannot be traced.
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
    for first in range(0, steps, STRETCH):
        time = np.asarray(period * np.arange(first, min(first + STRETCH, steps)), dtype=np.float64)
        points = sampled(reference, time, controller.reference_size)
        signals = dict(zip(REFERENCE, points, strict=True)) | {"noise": np.zeros((len(time), 0))}
        sample = Sample(*(values[:, 0] for values in arms.run(len(time), signals, record=True)))
        _require_sound(interface, loop, sample, time)
        if interface.follows_joints:
            squares.append(((plant.positions(sample.q) - points.p) ** 2).mean(axis=1))
    errors = np.sqrt(np.concatenate(squares)) if squares else np.zeros(0)
    last = round(min(10.0, duration) / period)
    return {
        "duration": duration,
        "reference": stated(reference),
        "finite": True,
        "rms_error_first_10_s": float(np.sqrt((errors[:last] ** 2).mean())) if squares else None,
        "rms_error_last_10_s": float(np.sqrt((errors[-last:] ** 2).mean())) if squares else None,
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


def _require_sound(interface: Interface, loop: ClosedLoop, sample: Sample, time: Array) -> None:
    """Refuse what is not finite or was stopped, with the time of it."""
    finite = (
        np.isfinite(sample.torque).all(axis=1) & np.isfinite(sample.q).all(axis=1) & np.isfinite(sample.v).all(axis=1)
    )
    if not finite.all():
        when = time[int(finite.argmin())]
        raise InputError(
            f"check: in simulation the loop is not finite after {when:g} s: exported, this would be an arm that runs "
            "away; use smaller gains or a shorter period"
        )
    if "stopped" in loop.marks and (stopped := sample.marks[:, loop.marks.index("stopped")] > 0.5).any():
        when = time[int(stopped.argmax())]
        raise InputError(
            f"check: in simulation the guards stop the arm after {when:g} s: use smaller gains, or wider limits"
        )
