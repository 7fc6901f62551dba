"""Ticks recorded from Python: what exported code is to repeat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface, status_of
from adaptctl.control import Reference, ReferencePoint, Sinusoids, TaskSpaceSlotineLi
from adaptctl.control.gains.workspace import position_range
from adaptctl.scalars import column

TICKS = 100
AMPLITUDE, OFF = 0.1, 0.02
"""rad or m: how far the default reference moves, and how far from it the arm is"""
SLOWEST, SPREAD = 0.2, 0.06
"""Hz: the first joint's frequency, and what each other has more"""
MARGIN = 0.15
"""rad or m between the default reference's centre and the joints' limits"""


@dataclass(frozen=True)
class RecordedTick:
    """A tick (the work of one control period) of a controller of r joints, recorded in Python for a test of its
    exported code: the arguments `p` and `v` (r,), rad and rad/s (m, m/s if prismatic), and `reference`, a
    `ReferencePoint`; and the results `torque` (r,), N m (N), and `status`, an integer, the sum of its guards' status
    bits. Nothing is checked."""

    p: Array
    v: Array
    reference: ReferencePoint
    torque: Array
    status: int


def default_reference(interface: Interface) -> Reference:
    """The reference on which a controller is checked by default, from its `interface`: `Sinusoids` of 0.1 rad or m
    (0.05 m for a task space in the world). Their centre is the controller's home configuration, or the nearest one that
    the joints' limits allow, in a task space its point there; their frequency is 0.2 Hz in the first coordinate and
    0.06 Hz more in each further one. Where the law's reference is in another space than joints or the world, the centre
    is 0. Nothing is raised."""
    law, size = interface.innermost, interface.controller.reference_size
    center, amplitude = centre(interface), AMPLITUDE
    if isinstance(law, TaskSpaceSlotineLi) and not law.reference_in_joints:
        x, _ = law.point(column(law.model.mechanism.configuration(center)))
        center, amplitude = np.array(x.of), 0.5 * AMPLITUDE
    elif not interface.follows_joints:
        center = np.zeros(size)
    return Sinusoids(center, np.full(size, amplitude), np.asarray(SLOWEST + SPREAD * np.arange(size)))


def centre(interface: Interface) -> Array:
    """The centre (r,), rad (m if prismatic), of the motion of the r joints in a controller's check, from its
    `interface`. It is the home configuration, moved so far that it is at least 0.15 rad (m), or half the joint's range
    where that is less, from joint limits; the home configuration itself where there are loops or no known mechanism.
    Nothing is raised."""
    home, mechanism = np.asarray(interface.controller.home, dtype=np.float64), interface.mechanism
    if mechanism is None or mechanism.description.loops is not None:
        return home
    lower, upper = position_range(mechanism)
    margin = np.minimum(MARGIN, 0.5 * (upper - lower))
    return np.clip(home, lower + margin, upper - margin)


def record(interface: Interface, reference: Reference, ticks: int = TICKS) -> tuple[list[RecordedTick], Any]:
    """A pair of a list of `RecordedTick`, the arguments and results of `ticks` control periods of the controller of an
    `interface` in Python, and of the controller's state after them. The periods count from time 0; there are 100 by
    default, and at least one. The motion is within 0.02 rad (m if prismatic) of `reference`, a function of time (s),
    or, where that is in another space than the joints', of the home position or the nearest one well within the joint
    limits (by 0.15 rad or m, or half a narrower range). Raises what the reference trajectory, `controller.init` and
    `controller.step` raise, such as `NonFiniteError`; `IndexError` where `ticks` is 0."""
    controller, rows = interface.controller, []
    time = np.asarray(interface.period * np.arange(ticks), dtype=np.float64)
    p, v = _motion(interface, reference, time)
    points = reference(time)
    state = controller.init(p[0], np.zeros(controller.dof))
    for k in range(ticks):
        point = ReferencePoint(*(np.ascontiguousarray(np.asarray(part)[k]) for part in points))
        torque, state = controller.step(state, p[k], v[k], point)
        rows.append(RecordedTick(p[k], v[k], point, torque, status_of(interface, state)))
    return rows, state


def first_torque(interface: Interface, tick: RecordedTick, held: Array) -> Array:
    """The torque (r,), N m (N), of the guarded controller of an `interface` in Python where a recorded `tick` is its
    first and the torque `held` (r,), N m (N), is applied to the arm before. Raises what `init` and `step` do."""
    law: Any = interface.controller
    state = law.init(tick.p, np.zeros(law.dof), torque=held)
    torque: Array = law.step(state, tick.p, tick.v, tick.reference)[0]
    return torque


def _motion(interface: Interface, reference: Reference, time: Array) -> tuple[Array, Array]:
    """Positions and velocities (T, r): along the reference where it is one of joints, a little off."""
    r = interface.controller.dof
    rate = np.asarray(2.0 * np.pi * (3.0 + np.arange(r)), dtype=np.float64)
    off, slope = OFF * np.sin(rate * time[:, None] + 1.0), OFF * rate * np.cos(rate * time[:, None] + 1.0)
    if not interface.follows_joints:
        return centre(interface) + off, slope
    points = reference(time)
    return np.asarray(points.p) + off, np.asarray(points.v) + slope
