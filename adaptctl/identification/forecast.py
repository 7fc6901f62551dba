"""Forecast of the parameters' uncertainty from a motion, before it is run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.identification.robot_motion import RobotMotion
from adaptctl.identification.unexcited import Combination, combinations

RATE = 50.0
"""Hz: rows a second that count as independent."""
NOISE = 0.02
"""Of the largest torque of the motion: what residuals are expected to be, unless given."""

LEAST = 0.01
"""Of the largest joint's torque: what any joint's is taken to be at least."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Forecast of an identification before it is run: the standard deviations to be expected of a robot's k fundamental
    (base) parameters from one motion.

    `model` is the reduced model on these parameters, and `deviations` (k,), SI units, are in its order. `condition`,
    without a unit, is the condition number (ratio of the largest to the smallest singular value) of the torque
    regressor along the motion, each joint's rows divided by its expected residual and each column scaled to length 1.
    `combinations` are k directions of the parameters in words, each with its `strength`, without a unit (the plausible
    range along it over the deviation), the least excited first. Made by `forecast`; nothing is checked at construction.
    """

    model: ReducedModel
    condition: float
    """condition number of the regressor, its columns scaled to one length"""
    deviations: Array
    """(k,)"""
    combinations: tuple[Combination, ...]
    """the least excited first"""

    @property
    def relative(self) -> Array:
        """Relative standard deviations (k,), without a unit, of the k fundamental (base) parameters:
        deviation/|parameter|, with the parameters' values in the robot's file; infinite where a parameter is 0 (NaN
        where its deviation is 0 too)."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.deviations / np.abs(self.model.fundamental_parameters))


def forecast(mechanism: Mechanism, motion: RobotMotion, noise: ArrayLike | None = None) -> Forecast:
    """The forecast, a `Forecast`, of the standard deviations that least squares on a `motion`, sampled at 50 Hz, will
    leave of a mechanism's fundamental (base) parameters.

    `noise` is the standard deviation of the torque residuals, N m (N for a prismatic joint), above zero: one number for
    all of r joints, or (r,). By default (None) it is 2 % of the largest torque on the motion, of each joint by itself;
    a joint whose largest torque is below 1 % of the largest of all joints counts with that 1 %. Raises `InputError` for
    noise of another shape or not positive and finite, `RankError` where the number of identifiable parameters cannot be
    certified, `SingularityError` near a singularity of kinematic loops.
    """
    given = None if noise is None else positive_per_joint(noise, mechanism.dof, "noise")
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    _, p, v, a, _ = motion.sampled(RATE)
    largest = np.abs(mechanism.inverse_dynamics(p, v, a)).max(axis=0)
    expected = NOISE * np.maximum(largest, LEAST * largest.max())
    deviations = expected if given is None else given
    Y = (model.torque_regressor(p, v, a) / deviations[:, None]).reshape(-1, len(model.columns))
    size = np.linalg.norm(Y, axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.svd(Y / size, compute_uv=False)
    spread = np.linalg.pinv((Y / size).T @ (Y / size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    found = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return Forecast(model, float(values[0] / values[-1]), found, tuple(combinations(Y.T @ Y, model.names)))
