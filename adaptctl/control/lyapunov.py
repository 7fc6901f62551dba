"""Slotine and Li's Lyapunov function."""

from __future__ import annotations

from typing import Protocol, TypeGuard

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.controller import Controller
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, shown, validate_kind
from adaptctl.scalars import column

SAMPLES = 4000
"""samples of a run whose energies by parameter are in memory at once"""


class TrackedRun(Protocol):
    """Run with motion and reference."""

    @property
    def p(self) -> Array:
        """Positions (T, r), rad (m if prismatic)."""
        ...

    @property
    def v(self) -> Array:
        """Velocities (T, r), rad/s (m/s if prismatic)."""
        ...

    @property
    def reference_p(self) -> Array:
        """Positions (T, r) of the reference."""
        ...

    @property
    def reference_v(self) -> Array:
        """Velocities (T, r) of the reference."""
        ...


class SampledRun(TrackedRun, Protocol):
    """Run with accelerations and the time between samples."""

    @property
    def reference_a(self) -> Array:
        """Accelerations (T, r) of the reference."""
        ...

    @property
    def sample_time(self) -> float:
        """Time between successive samples in s."""
        ...


class LearningRun(TrackedRun, Protocol):
    """Run with estimates."""

    @property
    def estimate(self) -> Array:
        """Estimates (T, k) in SI units."""
        ...


def has_sliding_variable(controller: object) -> TypeGuard[SlotineLi]:
    """Return True if s depends on errors alone."""
    own = SlotineLi.reference_velocity
    return isinstance(controller, SlotineLi) and type(controller).reference_velocity is own


def sliding_variable(controller: SlotineLi, run: TrackedRun) -> Array:
    """
    Compute Slotine and Li's sliding variable along a run.

    Parameters
    ----------
    controller : SlotineLi
        Controller with r joints.
    run : Rollout
        Run of T samples, such as `rollout` returns.

    Returns
    -------
    ndarray
        Error rate plus bandwidth times error (T, r) in rad/s (m/s if prismatic).

    Raises
    ------
    InputError
        If the law has another sliding variable, such as `PassivityIntegral`, or the run another number of joints.

    Examples
    --------
    >>> adaptctl.control.sliding_variable(law, run).shape
    (200, 2)
    """
    validate_kind(controller, Controller, "sliding variable", "as SlotineLi(...) is one")
    if not has_sliding_variable(controller):
        law = type(controller).__name__
        raise InputError(f"sliding variable: that of {law} needs more than the recorded tracking errors")
    if not hasattr(run, "reference_v"):
        raise InputError(f"run: expected a Rollout, as simulate(...) gives one, got {shown(run)}")
    if run.p.shape[1] != controller.dof:
        raise InputError(f"run: expected {controller.dof} joints, like the controller, got {run.p.shape[1]}")
    return run.v - run.reference_v + controller.bandwidth * (run.p - run.reference_p)


def lyapunov(controller: SlotineLi, run: LearningRun, mechanism: Mechanism) -> Array:
    r"""
    Compute Slotine and Li's Lyapunov function.

    Parameters
    ----------
    controller : SlotineLi
        Controller of the run.
    run : Rollout
        Run of T samples, with the estimates.
    mechanism : Mechanism
        True mechanism, whose parameters the estimates are compared with.

    Returns
    -------
    ndarray
        Energies (T,) in J. They may be negative where the true parameters are not physically consistent.

    Raises
    ------
    InputError
        If the law has another sliding variable, the run or mechanism another number of joints or parameters, or the
        adaptation law's distance depends on more than the estimate.

    Notes
    -----
    .. math:: V=\tfrac12 s^\top Ms+\tfrac12\tilde\beta^\top\Gamma^{-1}\tilde\beta.

    An adaptation law may have another second term.

    Examples
    --------
    >>> V = adaptctl.lyapunov(law, run, arm)
    >>> bool(V[-1] < V[0])
    True
    """
    s, model = sliding_variable(controller, run), controller.model
    parts = [slice(k, k + SAMPLES) for k in range(0, max(len(s), 1), SAMPLES)]
    kinetic = np.concatenate([_kinetic_energy(mechanism, run.p[k], s[k]) for k in parts])
    if controller.adaptation_law is None:
        return kinetic
    if len(mechanism.parameter_names) != len(model.mechanism.parameter_names):
        raise InputError(
            f"lyapunov: the {len(mechanism.parameter_names)} parameters of {mechanism.name} are not those of the "
            f"controller's mechanism {model.mechanism.name} ({len(model.mechanism.parameter_names)} parameters)"
        )
    true = model.regrouping @ mechanism.inertial_parameters
    distances = [controller.adaptation_law.lyapunov_distance(model, run.estimate[k], true) for k in parts]
    found = [distance for distance in distances if distance is not None]
    if not found:
        law = type(controller.adaptation_law).__name__
        raise InputError(f"lyapunov: that of {law} needs more than the recorded estimate")
    return kinetic + np.concatenate(found)


def _kinetic_energy(mechanism: Mechanism, p: Array, v: Array) -> Array:
    equations, q = mechanism.equations.without_gravity(), column(mechanism.configuration(p))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(equations.energy_regressor(q, column(v)) @ column(mechanism.inertial_parameters))
