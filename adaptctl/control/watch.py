"""Numbers that tell of a loop's stability during a run, by which sampled adaptive loops come to ring."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from adaptctl.arrays import Array, whole_count
from adaptctl.control.adaptation.gain import Descent
from adaptctl.control.gains.hold import hold_numbers
from adaptctl.control.lyapunov import sliding_variable
from adaptctl.control.ringing import ringing
from adaptctl.control.run import LearningRun, SampledRun
from adaptctl.control.slotine_li import SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError


class Watch(NamedTuple):
    """Stability numbers, without units, at T samples of a run: of the adaptation, of the held torque, and of ringing.

    `adaptation` (T,) is T_c lambda_max(K^-1 Y Gamma Y'), 0 with adaptation off: theorems of discrete adaptation ask for
    less than 2, or 2 - h. `hold` (T,) is h = T_c lambda_max(M^-1 (K + M^ Lambda)): velocities ring above 2; infinite
    where M is not positive definite. `ringing` (T, r) is the correlation rho of each joint's sliding variable s = e' +
    Lambda e with itself one control period ago, averaged over about 100 control periods: at -0.5 the loop rings, at
    -0.9 it is about to diverge.

    T_c is the control period (s), r the number of primary (independent) joints, lambda_max the largest eigenvalue, K
    the damping, Lambda the bandwidth, Gamma the adaptation gain, Y the torque regressor and Y' its transpose, M the
    true mass matrix, M^ the estimate's, e = p - p_d the tracking error of the joints' positions and e' its derivative
    in time. Nothing is checked.
    """

    adaptation: Array
    """(T,) T_c lambda_max(K^-1 Y Gamma Y'): theorems of discrete adaptation ask for less than 2, or 2 - h"""
    hold: Array
    """(T,) h = T_c lambda_max(M^-1 (K + M^ Lambda)) with the true M and the estimate's M^: velocities ring above 2"""
    ringing: Array
    """(T, r) rho of every joint: at -0.5 the loop rings, at -0.9 it is about to diverge"""


class _Run(LearningRun, SampledRun, Protocol):
    """A run with estimates and its reference's accelerations."""


def watch(controller: SlotineLi, run: _Run, mechanism: Mechanism, every: int = 1) -> Watch:
    """The stability numbers, a `Watch` without units, of a `run` of Slotine and Li's law, `controller`, at T of its
    samples: every `every`-th from the first on, by default all.

    Its fields are `adaptation` (T,), T_c lambda_max(K^-1 Y Gamma Y'), 0 with adaptation off, and `hold` (T,), T_c
    lambda_max(M^-1 (K + M^ Lambda)) of the held torque, both stable below 2; and `ringing` (T, r), the correlation of
    the sliding variable of each of the r primary (independent) joints with itself one control period ago. T_c is the
    control period, lambda_max the largest eigenvalue, K the damping, Lambda the bandwidth, Gamma the adaptation gain, Y
    the torque regressor and Y' its transpose, M the mass matrix of the true `mechanism` and M^ the estimated one. The
    run must have every control period as a sample: positions, velocities, the reference's and its accelerations, and
    the estimates. `adaptation` and `hold` cost a regressor and a mass matrix a sample. Raises `InputError` for an
    `every` that is not a whole number of at least 1, for relatives of Slotine and Li's law with another sliding
    variable, such as `TaskSpaceSlotineLi`, for a run of another number of joints than the controller's, and for an
    adaptation law without a constant gain; `SingularityError` near a singularity of the kinematic loops.
    """
    every = whole_count(every, "watch: every", 1)
    s = sliding_variable(controller, run)
    p, v, estimate = run.p[::every], run.v[::every], run.estimate[::every]
    parameters = controller.model.embed(estimate)
    hold = hold_numbers(mechanism, p, controller.damping, controller.period, controller.bandwidth, estimate=parameters)
    heard = ringing(s)[::every]
    law = controller.adaptation_law
    if law is None:
        return Watch(np.zeros(len(p)), hold, heard)
    if not isinstance(law, Descent):
        raise InputError(f"watch: {type(law).__name__} has no constant gain, which the adaptation number is of")
    e, e_rate = p - run.reference_p[::every], v - run.reference_v[::every]
    v_r = run.reference_v[::every] - controller.bandwidth * e
    a_r = run.reference_a[::every] - controller.bandwidth * e_rate
    Y = controller.model.slotine_li_regressor(p, v, v_r, a_r) / np.sqrt(controller.damping)[:, None]
    root = np.sqrt(law.gain) * Y if law.gain.ndim == 1 else Y @ np.linalg.cholesky(law.gain)
    largest = np.linalg.norm(root, ord=2, axis=(-2, -1))
    return Watch(np.asarray(controller.period * largest**2), hold, heard)
