"""Slotine and Li's Lyapunov function along a run: the proof, watched."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.run import LearningRun, TrackedRun
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError


def has_sliding_variable(controller: object) -> bool:
    """True if `controller` is Slotine and Li's law with its own sliding variable s = e' + Lambda e. e is the tracking
    error of the joints, measured less desired positions, e' its derivative in time and Lambda the bandwidth. False for
    laws with another s, such as `PassivityIntegral` and `TaskSpaceSlotineLi`, and for any other object. Nothing is
    raised."""
    own = SlotineLi.reference_velocity
    return isinstance(controller, SlotineLi) and type(controller).reference_velocity is own


def sliding_variable(controller: SlotineLi, run: TrackedRun) -> Array:
    """The sliding variable s = e' + Lambda e (T, r), rad/s or m/s, at the T samples of a `run` of r joints under
    Slotine and Li's law.

    e is the tracking error, measured less desired positions, e' its rate, and Lambda the `controller`'s bandwidth.
    Raises `InputError` for another law, such as `PassivityIntegral` or `TaskSpaceSlotineLi`, whose s is another one,
    and for a run of another number of joints.
    """
    if not has_sliding_variable(controller):
        law = type(controller).__name__
        raise InputError(f"sliding variable: that of {law} depends on more than the errors, which are all a run keeps")
    if run.p.shape[1] != controller.dof:
        raise InputError(f"run: expected {controller.dof} joints, as the controller has, got {run.p.shape[1]}")
    return run.v - run.reference_v + controller.bandwidth * (run.p - run.reference_p)


def lyapunov(controller: SlotineLi, run: LearningRun, mechanism: Mechanism) -> Array:
    """The Lyapunov function V (T,) = s'Ms/2 + error' Gamma^-1 error/2 of Slotine and Li's law, in J, at the T samples
    of a run, with the mass matrix M and the parameters of the true `mechanism`; these two primes are transposes.

    s = e' + Lambda e is the sliding variable, e the tracking error (measured less desired positions), e' its derivative
    in time, Lambda the `controller`'s bandwidth, `error` (k,) the estimate of k parameters less the true ones and Gamma
    the adaptation gain. An adaptation law may have its own distance for the second term; with adaptation off only the
    first is left. Where the parameters are no physical set, M need not be positive definite, and V is then no distance;
    it is reported as it is. Raises `InputError` for a run of another number of joints, a mechanism of other parameters
    than the controller's (friction, say, that its model leaves out), an adaptation law whose distance depends on more
    than the estimate, and for a control law with another s, such as `PassivityIntegral` or `TaskSpaceSlotineLi`.
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
    distance = controller.adaptation_law.distance(model, run.estimate, true)
    if distance is None:
        law = type(controller.adaptation_law).__name__
        raise InputError(f"lyapunov: that of {law} depends on more than the estimate, which a run does not keep")
    return kinetic + distance
