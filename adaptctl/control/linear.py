"""Linear controllers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers, positive_period
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column

if TYPE_CHECKING:
    import control

SIGNALS = ("p", "v", "reference_p", "reference_v", "reference_a")
ERRORS = {"error": ("reference_p", "p"), "error_rate": ("reference_v", "v")}  # the second subtracted from the first
_LABEL = re.compile(r"(\w+)\[(\d+)\]")


class LinearState(NamedTuple):
    """State variables (n,), at first zero."""

    x: Any


@dataclass(frozen=True, eq=False)
class LinearController(Controller[LinearState]):
    r"""
    Linear discrete-time controller with n state variables for r joints.

    Parameters
    ----------
    A, B, C, D : array_like
        Matrices (n, n), (n, 5 r), (r, n) and (r, 5 r) of n state variables and r joints in SI units, designed for the
        control period at which the loop runs.
    feedforward : Mechanism, optional
        Tree of r joints whose inverse dynamics on the reference are added to the torque. Default: none, the linear law
        alone.

    Raises
    ------
    InputError
        If a shape is wrong, a number is not finite, or `feedforward` is no tree of r joints.

    Notes
    -----
    .. math:: \tau=Cx+Dz,\quad x^+=Ax+Bz,

    z being measured positions and velocities, and the reference's positions, velocities and accelerations.

    Examples
    --------
    >>> K = np.hstack([np.diag([60.0, 20.0]), np.diag([12.0, 4.0])])
    >>> controller = adaptctl.control.LinearController.state_feedback(K, feedforward=arm)
    >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))
    >>> torque.shape
    (2,)
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
        """
        Return state feedback of the error as a controller.

        Parameters
        ----------
        gain : array_like
            Gain (r, 2 r), as `control.lqr` and `control.dlqr` return it: r columns in N m/rad (N/m), then r in N m
            s/rad (N s/m).
        feedforward : Mechanism, optional
            Tree of r joints whose inverse dynamics on the reference are added to the torque. Default: none, the linear
            law alone.

        Returns
        -------
        LinearController
            Controller without state.

        Raises
        ------
        InputError
            If the shape is wrong, a number is not finite, or `feedforward` is no tree of r joints.

        Examples
        --------
        >>> from adaptctl.control import LinearController
        >>> gain = [[40.0, 0.0, 6.0, 0.0], [0.0, 10.0, 0.0, 2.0]]
        >>> LinearController.state_feedback(gain, feedforward=arm).dof
        2
        """
        K = np.atleast_2d(numbers(gain, "state feedback: gain"))
        r = len(K)
        if K.shape != (r, 2 * r):
            raise InputError(f"state feedback: expected a gain (r, 2 r), got {K.shape}")
        D = np.concatenate([-K, K, np.zeros((r, r))], axis=1)
        return cls(np.zeros((0, 0)), np.zeros((0, 5 * r)), np.zeros((r, 0)), D, feedforward)

    @classmethod
    def from_system(
        cls, system: control.StateSpace, control_period: float, feedforward: Mechanism | None = None
    ) -> LinearController:
        """
        Return a linear system of python-control as a controller.

        Parameters
        ----------
        system : control.StateSpace
            System in discrete time. Its r outputs are the torques; its inputs are named p[j], v[j], reference_p[j],
            reference_v[j], reference_a[j], error[j] (reference_p - p) or error_rate[j], j from 0 to r - 1.
        control_period : float
            Time in s for which a torque is held.
        feedforward : Mechanism, optional
            Tree of r joints whose inverse dynamics on the reference are added to the torque. Default: none, the linear
            law alone.

        Returns
        -------
        LinearController
            Controller with the system's state.

        Raises
        ------
        InputError
            If the system is no linear one, is in continuous time or of another period, has other inputs, or
            `feedforward` is no tree of r joints.

        Examples
        --------
        >>> import control
        >>> inputs = ["error[0]", "error[1]"]
        >>> system = control.ss([], [], [], 50.0 * np.eye(2), period, inputs=inputs, outputs=2)
        >>> adaptctl.control.LinearController.from_system(system, period).dof
        2
        """
        import control

        sampled = positive_period(control_period, "control_period")
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
        """Number r of joints."""
        return len(self.D)

    def initial_state(self, p: Array, v: Array) -> LinearState:
        """
        Return the initial state, n state variables of zero.

        Parameters
        ----------
        p, v : ndarray
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s).

        Returns
        -------
        LinearState
            Internal state before the first control period.
        """
        return LinearState(np.zeros(len(self.A)))

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: LinearState) -> tuple[Column, LinearState]:
        """
        Compute the torque and the next state variables.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : LinearState
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and LinearState
            Torque (r,) in N m (N) and internal state after the period.
        """
        z = Column([*p, *v, *reference.p, *reference.v, *reference.a])
        torque = _sum(self.C, memory.x, self.D, z)
        mechanism = self.feedforward
        if mechanism is not None:
            equations, own = mechanism.equations, column(np.asarray(mechanism.inertial_parameters))
            torque = torque + equations.inverse_dynamics(reference.p, reference.v, reference.v, reference.a, own)
        return torque, LinearState(_sum(self.A, memory.x, self.B, z))


def _sum(first: Array, x: Column, second: Array, z: Column) -> Column:
    return Column(column(row) @ x + column(other) @ z for row, other in zip(first, second, strict=True))


def _choice(labels: list[str], r: int) -> Array:
    """Matrix (m, 5 r) from signals to labelled inputs."""
    choice = np.zeros((len(labels), 5 * r))
    for row, label in zip(choice, labels, strict=True):
        found = _LABEL.fullmatch(label)
        name, joint = (found[1], int(found[2])) if found else ("", 0)
        plus, minus = ERRORS.get(name, (name, ""))
        if plus not in SIGNALS or joint >= r:
            known = ", ".join((*SIGNALS, *ERRORS))
            raise InputError(f"unknown input {label!r}: expected {known}, each [0] to [{r - 1}]")
        row[SIGNALS.index(plus) * r + joint] = 1.0
        if minus:
            row[SIGNALS.index(minus) * r + joint] = -1.0
    return choice
