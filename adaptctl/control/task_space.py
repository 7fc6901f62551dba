"""Slotine and Li's law for a point of the arm that is to follow a path in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array, frozen_array, stacked_rows
from adaptctl.caching import cached_property
from adaptctl.control.adaptation.law import NoMemory
from adaptctl.control.adaptive import AdaptiveState
from adaptctl.control.controller import ReferencePoint
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.control.slotine_li import ReferenceVelocity, SlotineLi
from adaptctl.dynamics.recursion.kinematics import moving_point
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual, Vec, column, maximum
from adaptctl.scalars.column import combined

UNREACHED = 1e-6
"""A Jacobian's smallest singular value over its largest, below which it is singular everywhere."""


NEARLY, GUARD = 1e-3, 1e-2
"""det(J J'), its mean eigenvalue scaled to 1, below which J is nearly singular; and the damping there at most, over the
mean eigenvalue"""
SMALLEST = 1e-12
"""m^2, for a point that nothing moves"""


class Goal(NamedTuple):
    """Internal state of a task-space law whose reference is given in joints: `q` (n,), the reference's positions of all
    n joints of the mechanism's spanning tree in the last control period, rad (m if prismatic), from which closed
    kinematic loops are followed. Nothing is checked."""

    q: Any


@dataclass(frozen=True, eq=False)
class TaskSpaceSlotineLi(SlotineLi):
    """Slotine and Li's law in task space: the reference velocity is chosen for a point x(p) of a link (Slotine and Li
    1987, section on Cartesian control).

        v_r = J# (x_d' - Lambda (x - x_d)) + (1 - J# J)(-posture_rate (p - posture)),  J# = J'(J J' + mu^2)^-1
        a_r = its exact derivative in time, by dual numbers;  s = v - v_r
        torque = Y_r(p, v, v_r, a_r) estimate - K s

    J (d, r) is x's Jacobian, x_d the desired x, p and v (r,) the measured positions and velocities of the r primary
    (independent) joints, Y_r (r, k) the torque regressor of k estimated parameters, K the damping, s the sliding
    variable. A prime is a derivative in time, but the transpose of J and, in V below, of s and error.

    x (d,) are d of the three world coordinates of the point, in metres: `axes`, in ascending order, 0 to 2 for x to z,
    by default all. `tool` (3,) is the point in the frame of `link`, in metres, None for the frame's origin; `link` is a
    name, None for the last one. With d < r the rest of the motion is drawn to `posture` (r,) in rad (m if prismatic),
    None for the mechanism's home configuration, at `posture_rate` in 1/s, by default 1. `singularity` is mu in m: zero,
    the default, inverts J itself (d = r) or takes the least motion (d < r). Where J J' is nearly singular, det(J
    J')/(tr(J J')/d)^d = w below w_0 = 1e-3, mu^2 grows by 1e-2 (1 - w/w_0)^2 tr(J J')/d, smoothly from 0 (Nakamura and
    Hanafusa 1986), so that v_r and a_r stay finite.

    Guarantees: s goes to zero with V = s'Ms/2 + error' Gamma^-1 error/2, as for `SlotineLi`, whatever J; M is the mass
    matrix, Gamma the adaptation gain, error the estimate's. Where J has full rank and mu is zero, x' - x_d' + Lambda (x
    - x_d) = J s, so the point goes to its path.

    Gives up: orientations. Near a singularity v_r becomes fast when mu is zero, and through it the point is not
    followed; with mu the point lags behind where J's singular values are not large against mu.

    The reference point is x_d, x_d', x_d'' (d,), in m, m/s and m/s^2; with `reference_in_joints` it is joint positions,
    velocities and accelerations (r,), in rad, rad/s and rad/s^2 (m, m/s and m/s^2 if prismatic), those that an
    environment has, and x_d is where they put the point. `bandwidth` is Lambda (1/s), a number or (d,); other arguments
    and defaults are those of `SlotineLi`: `model`, with its k parameters; `damping` K in N m s/rad (N s/m for a
    prismatic joint), one number or (r,); `adaptation`, a law, or Gamma (k,) or (k, k) in units of the parameters
    squared per J, or None, the default, for none; `initial` (k,), SI units, None for zero; `period` T_c, 1e-3 s;
    `workspace`, the set of joint positions for which the gains are checked, None for all that the joints' limits allow;
    `torque_limits`, one number or (r,), N m (N), beyond which nothing is learned, None for the mechanism's; `prior`
    (k,), SI units, the greatest errors of `initial`, for a `StabilityWarning` where estimates could ring, None for
    none. Raises `GainError` where T_c (lambda_max(M^-1 K) + the greatest of Lambda and `posture_rate`), lambda_max the
    largest eigenvalue, is above 1.5 or M not positive definite, and `InputError` for arguments that `SlotineLi`
    refuses, for axes, link, tool, posture, posture rate or mu that do not fit, and where, with mu zero, the joints
    cannot move the point along all axes.
    """

    tunable = (*SlotineLi.tunable, "posture_rate")

    link: str | None = None
    tool: Array | None = None
    axes: tuple[int, ...] = (0, 1, 2)
    singularity: float = 0.0
    posture: Array | None = None
    posture_rate: float = 1.0
    reference_in_joints: bool = False

    def __post_init__(self) -> None:
        axes = tuple(self.axes)
        if not axes or list(axes) != sorted(set(axes)) or not set(axes) <= {0, 1, 2}:
            raise InputError(f"task space: axes: expected some of 0, 1, 2 (x, y, z), rising, got {list(axes)}")
        if len(axes) > self.dof:
            raise InputError(f"task space: {self.dof} joints cannot move a point along {len(axes)} axes: choose fewer")
        object.__setattr__(self, "axes", axes)
        for name, size, default in (("tool", 3, np.zeros(3)), ("posture", self.dof, self.neutral_configuration)):
            given = getattr(self, name)
            object.__setattr__(self, name, frozen_array(default if given is None else given, (size,), name))
        for name in ("singularity", "posture_rate"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise InputError(f"task space: {name}: expected at least 0, got {getattr(self, name)}")
        self._validate_link()
        self._validate_reach()
        super().__post_init__()

    @property
    def reference_size(self) -> int:
        """Length of each part of a reference point (position, velocity or acceleration): d, the number of the law's
        attribute `axes`, or the number r of primary (independent) joints where its attribute `reference_in_joints` is
        True."""
        return self.dof if self.reference_in_joints else len(self.axes)

    def reference_velocity(
        self, q: Column, p: Column, v: Column, reference: ReferencePoint, memory: AdaptiveState
    ) -> ReferenceVelocity:
        """The reference velocity v_r (r,) of the r primary (independent) joints with which the tool follows its path,
        in rad/s (m/s if prismatic), with its derivative in time and a further internal state, as a `ReferenceVelocity`.
        The derivative a_r (r,), along the motion, is in rad/s^2 (m/s^2) and found by dual numbers.

        With a reference in joints, that state is the reference's configuration (n,) of the spanning tree's n joints,
        from which kinematic loops are followed; otherwise it is empty. q (n,) in rad (m) is the measured configuration,
        p (r,) in rad (m) and v (r,) in rad/s (m/s) the primary joints' measured positions and velocities, `memory` the
        controller's internal state of the last control period. `reference` is the tool's position, velocity and
        acceleration (d,), in m, m/s and m/s^2, along the d axes, or those of the joints (r,). Nothing is checked here.
        """
        goal, rate, more = self._goal(reference, memory)
        rates = self.model.mechanism.equations.rates(q, v)
        v_r = self._velocity(_moving(q, rates), _moving(p, v), goal, rate)
        return ReferenceVelocity(Column(x.value for x in v_r), Column(x.slope for x in v_r), more)

    def point(self, q: Column) -> tuple[Column, list[Column]]:
        """The tool's coordinates x (d,), in metres, along the law's d world axes, and the Jacobian J (d, r) of x with
        respect to the r primary (independent) joints, as a list of d rows (r,). J is in m/rad (no unit for a prismatic
        joint). The configuration is q (n,) of the spanning tree's n joints, in rad (m). Nothing is checked."""
        equations = self.model.mechanism.equations
        moving = moving_point(equations.links, q, self._link, Vec(*np.asarray(self.tool).tolist()))
        units = [Column(float(i == j) for j in range(self.dof)) for i in range(self.dof)]
        columns = [tuple(moving.velocity(equations.rates(q, unit))) for unit in units]
        position = tuple(moving.position)
        return Column(position[i] for i in self.axes), [Column(column[i] for column in columns) for i in self.axes]

    def _more(self, p: Array, v: Array) -> Any:
        return Goal(self.model.mechanism.configuration(p)) if self.reference_in_joints else NoMemory()

    def _goal(self, reference: ReferencePoint, memory: AdaptiveState) -> tuple[Column, Column, Any]:
        """x_d and x_d' (d,), both with their derivatives in time, and the memory."""
        if not self.reference_in_joints:
            return _moving(reference.p, reference.v), _moving(reference.v, reference.a), NoMemory()
        equations = self.model.mechanism.equations
        q = equations.closed(reference.p, memory.controller_state.q)
        position, rows = self.point(_moving(q, equations.rates(q, reference.v)))
        velocity = _moving(reference.v, reference.a)
        return position, Column(row @ velocity for row in rows), Goal(q)

    def _velocity(self, q: Column, p: Column, goal: Column, rate: Column) -> Column:
        """The reference velocity v_r (r,)."""
        position, rows = self.point(q)
        home = column(np.asarray(self.posture))
        free = -(self.posture_rate * (p - home)) if len(self.axes) < self.dof else Column.zeros(self.dof)
        task = rate - column(self.bandwidth) * (position - goal) - Column(row @ free for row in rows)
        gram = [[a @ b for b in rows] for a in rows]
        square = self.singularity**2 + _guard(gram)
        for i in range(len(rows)):
            gram[i][i] = gram[i][i] + square
        return free + combined(rows, solve_symmetric(gram, task))

    def _validate_link(self) -> None:
        """Raise `InputError` for a link that there is not."""
        names = [link.name for link in self.model.mechanism.links]
        if self.link is not None and self.link not in names:
            raise InputError(f"task space: there is no link {self.link!r}; links: {', '.join(names)}")

    def _validate_reach(self) -> None:
        """Raise `InputError` where, undamped, no configuration lets the point move along every axis."""
        mechanism = self.model.mechanism
        p = sampled_configurations(mechanism)
        _, rows = self.point(column(mechanism.configuration(p)))
        values = np.linalg.svd(stacked_rows(rows, p.shape[:-1]), compute_uv=False)
        if self.singularity == 0.0 and float((values[:, -1] / values[:, 0]).max()) < UNREACHED:
            raise InputError(
                f"task space: the joints move the point of {mechanism.links[self._link].name} along fewer than "
                f"{len(self.axes)} axes: choose fewer axes, or a link farther out"
            )

    @cached_property
    def _link(self) -> int:
        names = [link.name for link in self.model.mechanism.links]
        return len(names) - 1 if self.link is None else names.index(self.link)

    @property
    def _velocity_feedback(self) -> Array:
        """The point's greatest bandwidth: where J is regular J# Lambda J has no greater eigenvalue, and the rest of
        the motion has the posture's rate."""
        return np.full(self.dof, max(float(self.bandwidth.max()), self.posture_rate))

    @property
    def _coordinates(self) -> int:
        """Number of the point's coordinates m."""
        return len(self.axes)


def _moving(values: Column, slopes: Column) -> Column:
    """Dual numbers of values and their derivatives in time."""
    return Column(map(Dual, values, slopes))


def _guard(gram: list[list[Any]]) -> Any:
    """The square of mu (m^2) that keeps the inverse of J J' finite: 0 where it is regular."""
    m = len(gram)
    mean = sum((gram[i][i] for i in range(1, m)), gram[0][0]) * (1.0 / m) + SMALLEST
    scaled = [[(1.0 / mean) * x for x in row] for row in gram]
    lack = maximum(1.0 - _determinant(scaled) * (1.0 / NEARLY), 0.0)
    return GUARD * mean * lack * lack


def _determinant(rows: list[list[Any]]) -> Any:
    """The determinant of a small matrix by Laplace's expansion, which divides by nothing."""
    first, *others = rows
    if not others:
        return first[0]
    minors = ([row[:j] + row[j + 1 :] for row in others] for j in range(len(first)))
    terms = [x * _determinant(minor) for x, minor in zip(first, minors, strict=True)]
    return sum((-x if j % 2 else x for j, x in enumerate(terms[1:], start=1)), terms[0])
