"""Sense of touch: an observer for a controller, and the wrench at the tool behind external torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, positive_per_joint, stacked
from adaptctl.control.adaptation.external_torque import ExternalTorque
from adaptctl.control.adaptation.guarded_learning import GuardedLearning
from adaptctl.control.controller import Controller
from adaptctl.control.safety_filter import SafetyFilter
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import moving_point
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Vec, column

WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
MIN_EFFECT = 0.02
"""torques of a wrench, relative to those of one that moves the arm best, below which the posture hides it"""
NEGLIGIBLE = 1e-6


def with_external_torque(controller: Any, *, cutoff: float = 60.0, alarms_per_hour: float = 1.0) -> Any:
    """
    Return a learning controller that observes external torques.

    Parameters
    ----------
    controller : Controller
        Controller with `GuardedLearning`, as of `adaptive_controller`, alone or in a `SafetyFilter`.
    cutoff : float, default 60.0
        Corner frequency of the observer's filters in rad/s. At 60 half of a sudden torque is seen after 28 ms.
    alarms_per_hour : float, default 1.0
        False alarms of the whole arm in an hour.

    Returns
    -------
    Controller
        The same controller with an `ExternalTorque`; its state's `law_state.touch` is a `Touch`.

    Raises
    ------
    InputError
        If the law is another, a number is not positive, or the cutoff is too fast for the control period.

    Examples
    --------
    >>> learning = adaptctl.control.GuardedLearning(np.full(6, 0.1))
    >>> feeling = adaptctl.control.with_external_torque(adaptctl.SlotineLi(model, 5.0, 4.0, learning))
    >>> torque, state = feeling.step(feeling.init(p, v), p, v, reference(0.0))
    >>> state.law_state.touch.torque.shape
    (2,)
    """
    if isinstance(controller, SafetyFilter):
        inner = with_external_torque(controller.inner, cutoff=cutoff, alarms_per_hour=alarms_per_hour)
        return replace(controller, inner=inner)
    law = getattr(controller, "adaptation", None)
    if not isinstance(controller, Controller) or not isinstance(law, GuardedLearning):
        raise InputError(
            f"controller: expected one with GuardedLearning, as adaptive_controller(...) gives, got {controller!r:.60} "
            f"with {type(law).__name__}"
        )
    observer = ExternalTorque(cutoff, alarms_per_hour)
    return replace(controller, adaptation=replace(law, external_torque=observer))  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class ToolWrench:
    """
    Force and moment at a point of a link that make external torques, in world axes.

    Parameters
    ----------
    force, moment : ndarray
        Force (3,) in N and moment (3,) about the point in N m, without what the posture hides.
    hidden : ndarray
        Wrenches (m, 6), rows of force and moment, that make no torque in this posture; their sums are hidden too.
    unexplained : ndarray
        Torques (r,) in N m (N) that no wrench at the point makes, as of a push elsewhere.

    Examples
    --------
    >>> wrench = adaptctl.control.tool_wrench(arm, p, [3.0, 1.0])
    >>> wrench.told
    'hidden: force_y, moment_x, force_x + 0.31 force_z - 0.15 moment_y, moment_z'
    """

    force: Array
    moment: Array
    hidden: Array
    unexplained: Array

    @property
    def told(self) -> str:
        """Hidden wrenches in a line; empty if there are none."""
        return f"hidden: {', '.join(map(_named, self.hidden))}" if len(self.hidden) else ""


def tool_wrench(
    mechanism: Mechanism,
    p: ArrayLike,
    torque: ArrayLike,
    *,
    link: str | None = None,
    point: Sequence[float] = (0.0, 0.0, 0.0),
    level: ArrayLike = 1.0,
) -> ToolWrench:
    """
    Return the least wrench at a point of a link that explains external torques.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism with r joints.
    p : array_like
        Positions (r,) in rad (m).
    torque : array_like
        External torques (r,) in N m (N), as `Touch.torque`.
    link : str, optional
        Link that is touched. Default: the last one.
    point : sequence of float, default (0, 0, 0)
        Point (3,) in the link's frame in m. The default is its origin.
    level : array_like, default 1.0
        Uncertainties of the torques, one number or (r,), as `Touch.level`; only their ratios count.

    Returns
    -------
    ToolWrench
        Force, moment, and the wrenches that the posture hides: those whose torques are under 2 % of the best one's,
        moments counted by the arm's lever.

    Raises
    ------
    InputError
        If a shape is wrong, a level is not positive, or the link is unknown.
    NonFiniteError
        If a number is not finite.

    Examples
    --------
    >>> wrench = adaptctl.control.tool_wrench(arm, p, [3.0, 1.0])
    >>> wrench.force.shape, wrench.hidden.shape, abs(wrench.unexplained).max() < 1e-12
    ((3,), (4, 6), np.True_)
    """
    r = mechanism.dof
    given, levels = checked(torque, r, "torque"), positive_per_joint(level, r, "level")
    effect = _effects(mechanism, checked(p, r, "p"), link, checked(point, 3, "point"))
    lever = float(np.linalg.norm(effect[:, :3], axis=1).max()) if np.abs(effect[:, 3:]).max() > 0.0 else 1.0
    units = np.array([1.0] * 3 + [lever or 1.0] * 3)
    left, sizes, right = np.linalg.svd(effect * units / levels[:, None])
    sizes = np.append(sizes, np.zeros(6))[:6]
    seen = sizes > MIN_EFFECT * sizes.max()
    parts = (left[:, : seen.sum()].T @ (given / levels)) / sizes[seen]
    wrench = units * (right[seen].T @ parts)
    return ToolWrench(wrench[:3], wrench[3:], _reduced(right[~seen] * units), given - effect @ wrench)


def _effects(mechanism: Mechanism, p: Array, link: str | None, point: Array) -> Array:
    """Torques (r, 6) of unit forces and moments at a point."""
    names = [one.name for one in mechanism.links]
    if link is not None and link not in names:
        raise InputError(f"link: {mechanism.name} has no link {link!r}; links: {', '.join(names)}")
    at = len(names) - 1 if link is None else names.index(link)
    q = column(mechanism.configuration(p))
    moving, rows = moving_point(mechanism.equations.links, q, at, Vec(*point.tolist())), []
    for i in range(mechanism.dof):
        rates = mechanism.equations.joint_velocities(q, Column(float(i == j) for j in range(mechanism.dof)))
        rows.append(stacked([*moving.velocity(rates), *moving.angular_velocity(rates)], ()))
    return np.array(rows)


def _reduced(rows: Array) -> Array:
    """Echelon form of rows, each with a greatest entry of 1 where the others have none."""
    rows = np.array(rows)
    for i in range(len(rows)):
        own = int(np.abs(rows[i]).argmax())
        rows[i] /= rows[i, own]
        others = np.arange(len(rows)) != i
        rows[others] -= np.outer(rows[others, own], rows[i])
    rows[np.abs(rows) < NEGLIGIBLE] = 0.0
    return np.asarray(rows)


def _named(row: Array) -> str:
    terms = [(value, name) for value, name in zip(row.tolist(), WRENCH, strict=True) if value]
    said = " + ".join(name if abs(value - 1.0) < NEGLIGIBLE else f"{value:.2g} {name}" for value, name in terms)
    return said.replace("+ -", "- ")
