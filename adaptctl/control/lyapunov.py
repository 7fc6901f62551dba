"""Slotine and Li's Lyapunov function along a run: the proof, watched."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError


class TrackedRun(Protocol):
    """Protocol of a closed-loop run: T control periods of r joints, and the reference that they followed. Positions
    `p`, velocities `v`, and the reference's `reference_p` and `reference_v` are arrays (T, r), in rad and rad/s (m and
    m/s if prismatic), one row a sample. Nothing is checked."""

    @property
    def p(self) -> Array:
        """Positions (T, r) of the r joints at the run's T samples, rad (m if prismatic)."""
        ...

    @property
    def v(self) -> Array:
        """Velocities (T, r) of the r joints at the run's T samples, rad/s (m/s if prismatic)."""
        ...

    @property
    def reference_p(self) -> Array:
        """The reference's positions (T, r) for the r joints at the run's T samples, rad (m if prismatic)."""
        ...

    @property
    def reference_v(self) -> Array:
        """The reference's velocities (T, r) for the r joints at the run's T samples, rad/s (m/s if prismatic)."""
        ...


class SampledRun(TrackedRun, Protocol):
    """Protocol of a closed-loop run of T samples of r joints, a `TrackedRun` (positions and velocities, and the
    reference's) with two more attributes: its reference's accelerations `reference_a` (T, r), rad/s^2 (m/s^2 if
    prismatic), and its sampling time `control_period`, s. Nothing is checked."""

    @property
    def reference_a(self) -> Array:
        """The reference's accelerations (T, r) for the r joints at the run's T samples, rad/s^2 (m/s^2 if
        prismatic)."""
        ...

    @property
    def control_period(self) -> float:
        """Time from one sample of the run to the next, s: the control period."""
        ...


class LearningRun(TrackedRun, Protocol):
    """Protocol of a closed-loop run of T samples of r joints, a `TrackedRun` (positions and velocities, and the
    reference's) with one more attribute: its adaptive controller's estimates `estimate` (T, k) of k parameters, SI
    units. Nothing is checked."""

    @property
    def estimate(self) -> Array:
        """The adaptive controller's estimates (T, k) of its k parameters at the run's T samples, in the parameters' SI
        units."""
        ...


def has_sliding_variable(controller: object) -> bool:
    """True if `controller` is Slotine and Li's law with its own sliding variable s = e' + Lambda e. e is the tracking
    error of the joints, measured less desired positions, e' its derivative in time and Lambda the bandwidth. False for
    laws with another s, such as `PassivityIntegral` and `TaskSpaceSlotineLi`, and for any other object. Nothing is
    raised."""
    own = SlotineLi.reference_velocity
    return isinstance(controller, SlotineLi) and type(controller).reference_velocity is own


def sliding_variable(controller: SlotineLi, run: TrackedRun) -> Array:
    """The sliding variable s = e' + Lambda e (T, r), rad/s (m/s if prismatic), at the T samples of a `run` of r joints
    under Slotine and Li's law.

    e is the tracking error, measured less desired positions, e' its rate, and Lambda the `controller`'s bandwidth.
    Raises `InputError` for another law, such as `PassivityIntegral` or `TaskSpaceSlotineLi`, whose s is another one,
    and for a run of another number of joints than the controller's.
    """
    if not has_sliding_variable(controller):
        law = type(controller).__name__
        raise InputError(f"sliding variable: that of {law} depends on more than the errors, which are all a run keeps")
    if run.p.shape[1] != controller.dof:
        raise InputError(f"run: expected {controller.dof} joints, as the controller has, got {run.p.shape[1]}")
    return run.v - run.reference_v + controller.bandwidth * (run.p - run.reference_p)


def lyapunov(controller: SlotineLi, run: LearningRun, mechanism: Mechanism) -> Array:
    """The Lyapunov function V (T,) = s'Ms/2 + error' Gamma^-1 error/2 of Slotine and Li's law, in J, at the T samples
    of a `run`. M is the mass matrix of the true `mechanism`; these two primes are transposes.

    s = e' + Lambda e is the sliding variable, e the tracking error (measured less desired positions), e' its derivative
    in time, Lambda the `controller`'s bandwidth, `error` (k,) the estimate of k parameters less the true ones, those of
    `mechanism`, and Gamma the adaptation gain. An adaptation law may have its own distance in place of the second term;
    with adaptation off V is s'Ms/2 alone. Where the true parameters are not physically consistent, M need not be
    positive definite, and V may then be negative. Raises `InputError` for a run of another number of joints than the
    controller's, and for a control law with another s, such as `PassivityIntegral` or `TaskSpaceSlotineLi`; with
    adaptation on also for a mechanism of another number of parameters than that of the controller's model (with
    friction, say, which the model leaves out), and for an adaptation law whose distance depends on more than the
    estimate.
    """
    s, model = sliding_variable(controller, run), controller.model
    kinetic = 0.5 * np.einsum("ti,tij,tj->t", s, mechanism.mass_matrix(run.p), s)
    if controller.adaptation_law is None:
        return kinetic
    if len(mechanism.parameter_names) != len(model.mechanism.parameter_names):
        raise InputError(
            f"lyapunov: the parameters of {mechanism.name}, {len(mechanism.parameter_names)}, are not those of the "
            f"controller's {model.mechanism.name}, {len(model.mechanism.parameter_names)}, whose estimates the run has"
        )
    true = model.regrouping @ mechanism.inertial_parameters
    distance = controller.adaptation_law.lyapunov_distance(model, run.estimate, true)
    if distance is None:
        law = type(controller.adaptation_law).__name__
        raise InputError(f"lyapunov: that of {law} depends on more than the estimate, which a run does not keep")
    return kinetic + distance
