"""Linear controllers: state feedback, and linear systems of python-control, on our plants and environments."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, positive_number
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column

if TYPE_CHECKING:
    import control

SIGNALS = ("p", "v", "reference_p", "reference_v", "reference_a")
"""Signals that a controller receives, r numbers each."""
ERRORS = {"error": ("reference_p", "p"), "error_rate": ("reference_v", "v")}
"""Signals made of two, the second subtracted from the first."""
_LABEL = re.compile(r"(\w+)\[(\d+)\]")


class LinearState(NamedTuple):
    """Internal state of a linear controller: `x` (n,), the n state variables, at first zero. Nothing is checked."""

    x: Any
    """(n,) the system's state"""


@dataclass(frozen=True, eq=False)
class LinearController(Controller[LinearState]):
    """Linear controller in discrete time: torque = C x + D z, then x = A x + B z, with n state variables x (n,) and
    signals z (5 r,).

    The signals are measured positions and velocities, then the reference's positions, velocities and accelerations, of
    r joints, in rad, rad/s and rad/s^2 (m, m/s and m/s^2 for a prismatic joint). Torques are in N m (N). `A` is (n, n),
    `B` (n, 5 r), `C` (r, n), `D` (r, 5 r); x is zero at first. They must be designed for the control period at which
    the loop runs, which is not checked. The torque that the inverse dynamics of the mechanism `feedforward` asks for on
    the reference is added, none for None. Raises `InputError` on wrong shapes, for numbers that are not finite, and for
    a `feedforward` that is no tree of r joints.

    Guarantees what the linear design does, near the motion that it was made for.

    Gives up: far from there nothing is proved, and nothing learns.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    feedforward: Mechanism | None = None

    def __post_init__(self) -> None:
        n, r = (np.shape(each)[0] if np.ndim(each) == 2 else 0 for each in (self.A, self.D))
        for name, shape in (("A", (n, n)), ("B", (n, 5 * r)), ("C", (r, n)), ("D", (r, 5 * r))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))
        mechanism = self.feedforward
        if mechanism is not None and (mechanism.dof != r or not mechanism.is_plain_tree):
            raise InputError(f"feedforward: expected a tree of {r} joints, got {mechanism!r}")

    @classmethod
    def state_feedback(cls, gain: ArrayLike, feedforward: Mechanism | None = None) -> LinearController:
        """State feedback of r joints as a `LinearController`: torque = -K (p - p_d, v - v_d), with measured positions p
        and velocities v and the desired ones p_d and v_d. `gain` is K (r, 2 r), r columns for positions, in N m/rad
        (N/m for a prismatic joint), then r for velocities, in N m s/rad (N s/m), as `control.lqr` and `control.dlqr`
        return it. The torque that the inverse dynamics of the mechanism `feedforward` asks for on the reference is
        added, none for None. Raises `InputError` for another shape, for a gain that is not finite, and for a
        `feedforward` that is no tree of r joints."""
        K = np.atleast_2d(numbers(gain, "state feedback: gain"))
        r = len(K)
        if K.shape != (r, 2 * r):
            raise InputError(f"state feedback: expected a gain (r, 2 r), got {K.shape}")
        D = np.concatenate([-K, K, np.zeros((r, r))], axis=1)
        return cls(np.zeros((0, 0)), np.zeros((0, 5 * r)), np.zeros((r, 0)), D, feedforward)

    @classmethod
    def of_system(
        cls, system: control.StateSpace, control_period: float, feedforward: Mechanism | None = None
    ) -> LinearController:
        """Linear controller made of `system`, a linear system of python-control in discrete time at the control
        `period` (s). The system's r outputs are the torques of the r joints, in their order, in N m (N for a prismatic
        joint).

        The system's inputs are named p[j], v[j], reference_p[j], reference_v[j], reference_a[j], error[j] (reference_p
        - p) or error_rate[j] (reference_v - v), with j from 0 to r - 1 for the r joints, in any order and number: p and
        v are measured positions and velocities, the others the reference's, a accelerations. The torque that the
        inverse dynamics of the mechanism `feedforward` asks for on the reference is added, none for None. Raises
        `InputError` for a period that is not positive, for a `system` that python-control makes no linear system of,
        for one in continuous time, at another period, or of inputs of other names, and for a `feedforward` that is no
        tree of r joints.
        """
        import control

        sampled = positive_number(control_period, "control_period: expected a positive time in s")
        try:
            linear = control.ss(system)
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"expected a linear system of python-control, got {type(system).__name__}") from error
        if linear.dt == 0:
            raise InputError(f"the system is in continuous time: sample it, control.c2d(system, {sampled:g})")
        if linear.dt not in (True, None) and not np.isclose(linear.dt, sampled):
            raise InputError(f"the system's period is {linear.dt:g} s, and the controller's {sampled:g} s")
        choice = _choice(list(system.input_labels), linear.noutputs)
        return cls(linear.A, linear.B @ choice, linear.C, linear.D @ choice, feedforward)

    @property
    def dof(self) -> int:
        """Number r of joints that the controller moves."""
        return len(self.D)

    def initial_state(self, p: Array, v: Array) -> LinearState:
        """The internal state before the first control period: n state variables (n,), zero for any positions p and
        velocities v (..., r) of the r joints, which are ignored."""
        return LinearState(np.zeros(len(self.A)))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: LinearState) -> tuple[Column, LinearState]:
        """The torque (r,) of r joints, N m (N for a prismatic joint), for one control period, and the internal state
        after it, n state variables (n,). Positions p in rad (m) and velocities v in rad/s (m/s), (r,), are measured;
        `reference` has the desired positions, velocities and accelerations (r,), in rad, rad/s and rad/s^2 (m, m/s and
        m/s^2 if prismatic); `memory` is the internal state of the last control period. Nothing is checked here: the
        method `step` checks shapes."""
        z = Column([*p, *v, *reference.p, *reference.v, *reference.a])
        torque = _sum(self.C, memory.x, self.D, z)
        mechanism = self.feedforward
        if mechanism is not None:
            equations, own = mechanism.equations, column(np.asarray(mechanism.inertial_parameters))
            torque = torque + equations.inverse_dynamics(reference.p, reference.v, reference.v, reference.a, own)
        return torque, LinearState(_sum(self.A, memory.x, self.B, z))


def _sum(first: Array, x: Column, second: Array, z: Column) -> Column:
    """The products of two matrices with columns, added; what is zero is not computed."""
    return Column(column(row) @ x + column(other) @ z for row, other in zip(first, second, strict=True))


def _choice(labels: list[str], r: int) -> Array:
    """The matrix (m, 5 r) from a controller's signals to a system's inputs, by their labels. Raises `InputError` for an
    unknown label."""
    choice = np.zeros((len(labels), 5 * r))
    for row, label in zip(choice, labels, strict=True):
        found = _LABEL.fullmatch(label)
        name, joint = (found[1], int(found[2])) if found else ("", 0)
        plus, minus = ERRORS.get(name, (name, ""))
        if plus not in SIGNALS or joint >= r:
            known = ", ".join((*SIGNALS, *ERRORS))
            raise InputError(f"input {label!r} is not known: expected {known}, each [0] to [{r - 1}]")
        row[SIGNALS.index(plus) * r + joint] = 1.0
        if minus:
            row[SIGNALS.index(minus) * r + joint] = -1.0
    return choice
