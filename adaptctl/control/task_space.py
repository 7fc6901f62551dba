"""Slotine and Li's law in task space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from adaptctl.arrays import Array, finite_number, frozen_array, stacked_rows
from adaptctl.control.adaptation.law import NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.control.passivity_based import ReferenceVelocity
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.description.places import tool_point
from adaptctl.dynamics.recursion.kinematics import moving_point
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual, Vec, column, maximum, sqrt
from adaptctl.scalars.column import combined

MIN_SINGULAR_VALUE_RATIO = 1e-6  # of a Jacobian: below it everywhere, an axis cannot be controlled
NEAR_SINGULAR_DETERMINANT = 3e-3  # of J J' scaled to a mean eigenvalue of 1, below which its inverse is damped
MAX_DAMPING = 1e-3  # over the mean eigenvalue
MAX_ERROR = 0.2  # rad, over which joints of mean effect move the point: larger errors are approached no faster
ERROR_DAMPING = 1.0  # 1/rad^2: of the error's square, so that targets out of reach do not straighten an arm at speed
MIN_SQUARE = 1e-12  # m^2, for a point that nothing moves


class Goal(NamedTuple):
    """Last reference configuration (n,), from which loops are followed."""

    q: Any


@dataclass(frozen=True, eq=False)
class TaskSpaceSlotineLi(SlotineLi):
    r"""
    Slotine and Li's controller whose error is that of a point of a link in task space.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    bandwidth : array_like
        Decay rate Lambda of the point's error in 1/s, one number or (d,).
    damping : array_like
        Damping K in N m s/rad (N s/m for a prismatic joint), one number or (r,).
    adaptation : AdaptationLaw or array_like, optional
        Adaptation law, or the gain of `Gradient`: its diagonal (k,) or the whole matrix (k, k), in units of the
        parameters squared per J. None switches adaptation off.
    initial : array_like, optional
        Initial estimate (k,) in SI units, zero unless given.
    control_period : float, default 0.001
        Time in s for which a torque is held. 1 kHz is the rate of most torque interfaces.
    workspace : Workspace, optional
        Joint positions for which the gains are checked. Unless given, all that the joints' limits allow.
    torque_limits : array_like, optional
        Limits in N m (N), one number or (r,). Nothing is learned from a period whose torque exceeds them; the
        mechanism's own limits unless given.
    prior : array_like, optional
        Largest plausible error (k,) of each initial parameter in SI units. With it, gains for which the estimates could
        make the sampled loop ring give a `StabilityWarning`.
    link : str, optional
        Link of the point, the last one unless given.
    tool : array_like, optional
        Point (3,) in the frame of the link in m, its origin unless given.
    axes : tuple of int, default (0, 1, 2)
        The d world axes, rising, along which the point is controlled.
    singularity : float, default 0.0
        Damping mu of the Jacobian's inverse in m. 0 inverts it exactly, or takes the least motion for d < r.
    posture : array_like, optional
        Positions (r,) in rad (m) to which the remaining motion tends for d < r, home unless given.
    posture_rate : float, default 1.0
        Rate in 1/s at which the posture is approached. At 1 the time constant is 1 s.
    reference_in_joints : bool, default False
        True if reference points are joint positions (r,), as in an environment, instead of the point's (d,) in m.

    Raises
    ------
    GainError
        If the sampling ratio with the greatest of bandwidth and posture rate is above 1.5.
    InputError
        If arguments that `SlotineLi` refuses are given, axes, link, tool or posture do not fit, or the joints cannot
        move the point along all axes.

    Notes
    -----
    .. math:: v_r=J^\#(\dot x_d-\Lambda(x-x_d))+(1-J^\#J)v_0,\quad J^\#=J^\top(JJ^\top+\mu^2)^{-1},

    with the posture's velocity :math:`v_0`. The point converges where J has full rank and :math:`\mu=0` [1]_; near
    singularities :math:`\mu` grows smoothly [2]_, as it does with the error [3]_. Errors count for at most
    what a turn of 0.2 rad changes. A target out of reach therefore asks for no large torques.

    References
    ----------
    .. [1] Slotine and Li, Int. J. Robotics Research, 1987.
    .. [2] Nakamura and Hanafusa, ASME J. Dynamic Systems, Measurement and Control, 1986.
    .. [3] Sugihara, IEEE Trans. Robotics, 2011.

    Examples
    --------
    >>> controller = adaptctl.control.TaskSpaceSlotineLi(
    ...     model, 5.0, [6.0, 2.0], axes=(0, 1), tool=[0.3, 0.0, 0.0], singularity=0.05
    ... )
    >>> controller.reference_size
    2
    """

    tunable = (*SlotineLi.tunable, "posture_rate")

    link: str | None = None
    tool: Array | None = None
    axes: tuple[int, ...] = (0, 1, 2)
    singularity: float = 0.0
    posture: Array | None = None
    posture_rate: float = 1.0
    reference_in_joints: bool = False
    _link: ClassVar[int]

    def __post_init__(self) -> None:
        axes = tuple(self.axes)
        if not axes or list(axes) != sorted(set(axes)) or not set(axes) <= {0, 1, 2}:
            raise InputError(
                f"task space: axes: expected some of 0, 1, 2 (x, y, z), in ascending order, got {list(axes)}"
            )
        if len(axes) > self.dof:
            raise InputError(
                f"task space: {self.dof} joints cannot move a point along {len(axes)} axes: give fewer axes"
            )
        object.__setattr__(self, "axes", axes)
        for name, size, default in (("tool", 3, np.zeros(3)), ("posture", self.dof, self.neutral_configuration)):
            given = getattr(self, name)
            object.__setattr__(self, name, frozen_array(default if given is None else given, (size,), name))
        for name in ("singularity", "posture_rate"):
            finite_number(getattr(self, name), f"task space: {name}")
        index, link, point = tool_point(
            self.model.mechanism.description, self.link, np.asarray(self.tool), "task space"
        )
        for name, value in (("_link", index), ("link", link), ("tool", frozen_array(point, (3,), "tool"))):
            object.__setattr__(self, name, value)
        self._validate_reach()
        super().__post_init__()

    @property
    def reference_size(self) -> int:
        """Number of coordinates of a reference point: task-space axes, or joints."""
        return self.dof if self.reference_in_joints else len(self.axes)

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """
        Compute the reference velocity along the point's path.

        Parameters
        ----------
        q : Column
            Positions (n,) in rad (m) of the n joints of the spanning tree.
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations of the point (d,) or of the joints (r,).
        memory : AdaptiveState
            Internal state of the last control period.

        Returns
        -------
        ReferenceVelocity
            Reference velocity (r,) in rad/s (m/s), its derivative in time (r,), and the law's further internal state.
        """
        goal, rate, more = self._goal(reference, memory)
        rates = self.model.mechanism.equations.joint_velocities(q, v)
        v_r = self._velocity(_moving(q, rates), _moving(p, v), goal, rate)
        return ReferenceVelocity(Column(x.value for x in v_r), Column(x.slope for x in v_r), more)

    def point(self, q: Column) -> tuple[Column, list[Column]]:
        """
        Compute the point's coordinates and Jacobian.

        Parameters
        ----------
        q : Column
            Positions (n,) in rad (m) of the n joints of the spanning tree.

        Returns
        -------
        tuple of Column and list of Column
            Coordinates (d,) in m, and d rows (r,) of the Jacobian in m/rad (1 for a prismatic joint).

        Examples
        --------
        >>> controller = adaptctl.control.TaskSpaceSlotineLi(model, 5.0, [6.0, 2.0], axes=(0, 1), singularity=0.05)
        >>> x, jacobian = controller.point(p)
        >>> len(x), len(jacobian)
        (2, 2)
        """
        equations = self.model.mechanism.equations
        moving = moving_point(equations.links, q, self._link, Vec(*np.asarray(self.tool).tolist()))
        units = [Column(float(i == j) for j in range(self.dof)) for i in range(self.dof)]
        columns = [tuple(moving.velocity(equations.joint_velocities(q, unit))) for unit in units]
        position = tuple(moving.position)
        return Column(position[i] for i in self.axes), [Column(column[i] for column in columns) for i in self.axes]

    def _controller_state(self, p: Array, v: Array) -> Any:
        return Goal(self.model.mechanism.configuration(p)) if self.reference_in_joints else NoMemory()

    def _goal(self, reference: ReferencePoint, memory: AdaptiveState) -> tuple[Column, Column, Any]:
        """Desired coordinates and velocities (d,), and the state."""
        if not self.reference_in_joints:
            return _moving(reference.p, reference.v), _moving(reference.v, reference.a), NoMemory()
        equations = self.model.mechanism.equations
        q = equations.closed(reference.p, memory.controller_state.q)
        position, rows = self.point(_moving(q, equations.joint_velocities(q, reference.v)))
        velocity = _moving(reference.v, reference.a)
        return position, Column(row @ velocity for row in rows), Goal(q)

    def _velocity(self, q: Column, p: Column, goal: Column, rate: Column) -> Column:
        position, rows = self.point(q)
        home = column(np.asarray(self.posture))
        free = -(self.posture_rate * (p - home)) if len(self.axes) < self.dof else Column.zeros(self.dof)
        gram = [[a @ b for b in rows] for a in rows]
        error = _bounded(position - goal, MAX_ERROR**2 * _mean_square(gram))
        task = rate - column(self.bandwidth) * error - Column(row @ free for row in rows)
        square = self.singularity**2 + ERROR_DAMPING * (error @ error) + _damping_of(gram)
        for i in range(len(rows)):
            gram[i][i] = gram[i][i] + square
        return free + combined(rows, solve_symmetric(gram, task))

    def _validate_reach(self) -> None:
        """Raise `InputError` if the point cannot move along every axis."""
        mechanism = self.model.mechanism
        p = sampled_configurations(mechanism)
        _, rows = self.point(column(mechanism.configuration(p)))
        values = np.linalg.svd(stacked_rows(rows, p.shape[:-1]), compute_uv=False)
        if self.singularity == 0.0 and float((values[:, -1] / values[:, 0]).max()) < MIN_SINGULAR_VALUE_RATIO:
            raise InputError(
                f"task space: the joints move the point of {mechanism.links[self._link].name} along fewer than "
                f"{len(self.axes)} axes: give fewer axes, or a link farther from the base"
            )

    @property
    def _velocity_feedback(self) -> Array:
        """Greatest bandwidth, a bound of J# Lambda J where J is regular."""
        return np.full(self.dof, max(float(self.bandwidth.max()), self.posture_rate))

    @property
    def _coordinates(self) -> int:
        return len(self.axes)


def _moving(values: Column, slopes: Column) -> Column:
    """Dual numbers in time."""
    return Column(map(Dual, values, slopes))


def _bounded(error: Column, square: Any) -> Column:
    """Error of the same direction, shorter than the root of `square`."""
    return (1.0 / sqrt(1.0 + (error @ error) / square)) * error


def _mean_square(gram: list[list[Any]]) -> Any:
    """Mean eigenvalue of J J' (m^2)."""
    return sum((gram[i][i] for i in range(1, len(gram))), gram[0][0]) * (1.0 / len(gram)) + MIN_SQUARE


def _damping_of(gram: list[list[Any]]) -> Any:
    """Square of mu (m^2), 0 where J is regular."""
    mean = _mean_square(gram)
    scaled = [[(1.0 / mean) * x for x in row] for row in gram]
    lack = maximum(1.0 - _determinant(scaled) * (1.0 / NEAR_SINGULAR_DETERMINANT), 0.0)
    return MAX_DAMPING * mean * lack * lack


def _determinant(rows: list[list[Any]]) -> Any:
    """Determinant by Laplace's expansion, without divisions."""
    first, *others = rows
    if not others:
        return first[0]
    minors = ([row[:j] + row[j + 1 :] for row in others] for j in range(len(first)))
    terms = [x * _determinant(minor) for x, minor in zip(first, minors, strict=True)]
    return sum((-x if j % 2 else x for j, x in enumerate(terms[1:], start=1)), terms[0])
