"""Forecast of the parameters' uncertainty from a motion, before it is run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control.adaptation import PriorRanges
from adaptctl.control.gains.gains import positive_per_joint
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.identification.robot_motion import RobotMotion
from adaptctl.identification.unexcited import Combination, combinations

RATE = 50.0
"""Hz: rows a second that count as independent."""
NOISE = 0.02
"""Of the largest torque of the motion: what residuals are expected to be, unless given."""

LEAST = 0.01
"""Of the largest joint's torque: what any joint's is taken to be at least."""
SHORTEST = 1e-3
"""Of the longest column of the regressor, each times its parameter's prior range: what columns are scaled as at least,
so that one of round-off alone stays short."""
UNEXCITED = 1e-9
"""Of the largest singular value of the scaled regressor: directions up to here count as not excited. Round-off leaves
some 1e-16 and a poor motion 1e-3, so that nothing is near the bound; that of the certificates of rank is the same."""
COMPONENT = 1e-6
"""Component of a parameter in the unexcited directions that counts: they are known to round-off over UNEXCITED."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Forecast of an identification before it is run: the standard deviations to be expected of a robot's k fundamental
    (base) parameters from one motion.

    `model` is the reduced model on these parameters, and `deviations` (k,), SI units, are in its order: infinite for a
    parameter that has a component in a direction that the motion does not excite. `condition`, without a unit, is the
    condition number (ratio of the largest to the smallest singular value) of the torque regressor along the motion,
    each joint's rows divided by its expected residual and each column scaled to length 1 (less for a column next to
    nothing); it is infinite where a direction is not excited. `combinations` are k directions of the parameters in
    words, each with its `strength`, without a unit (the plausible range along it over the deviation), the least excited
    first. Made by `forecast`; nothing is checked at construction.
    """

    model: ReducedModel
    condition: float
    """condition number of the regressor, its columns scaled to one length"""
    deviations: Array
    """(k,) infinite where the motion tells nothing"""
    combinations: tuple[Combination, ...]
    """the least excited first"""

    @property
    def relative(self) -> Array:
        """Relative standard deviations (k,), without a unit, of the k fundamental (base) parameters:
        deviation/|parameter|, with the parameters' values in the robot's file; infinite where a parameter is 0, unless
        its deviation is 0 too: then 0, since the parameter is known."""
        value = np.abs(self.model.fundamental_parameters)
        unknown = np.where(self.deviations > 0.0, np.inf, 0.0)
        return np.divide(self.deviations, value, out=unknown, where=value > 0.0)


def forecast(mechanism: Mechanism, motion: RobotMotion, noise: ArrayLike | None = None) -> Forecast:
    """The forecast, a `Forecast`, of the standard deviations that least squares on a `motion`, sampled at 50 Hz, will
    leave of a mechanism's fundamental (base) parameters.

    `noise` is the standard deviation of the torque residuals, N m (N for a prismatic joint), above zero: one number for
    all of r joints, or (r,). By default (None) it is 2 % of the largest torque on the motion, of each joint by itself;
    a joint whose largest torque is below 1 % of the largest of all joints counts with that 1 %. A direction of the
    parameters counts as not excited where its singular value, of the scaled regressor, is at most 1e-9 of the largest.
    Raises `InputError` for noise of another shape or not positive and finite, and for a motion without torque where
    none is given, `RankError` where the number of identifiable parameters cannot be certified, `SingularityError` near
    a singularity of kinematic loops.
    """
    given = None if noise is None else positive_per_joint(noise, mechanism.dof, "noise")
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    _, p, v, a, _ = motion.sampled(RATE)
    expected = _expected(mechanism.inverse_dynamics(p, v, a)) if given is None else given
    Y = (model.torque_regressor(p, v, a) / expected[:, None]).reshape(-1, len(model.columns))
    condition, deviations = _least_squares(Y, PriorRanges().of(model.names))
    return Forecast(model, condition, deviations, tuple(combinations(Y.T @ Y, model.names)))


def _expected(torque: Array) -> Array:
    """The residuals to expect (r,) of torques (n, r)."""
    largest = np.abs(torque).max(axis=0)
    if not np.any(largest):
        raise InputError("noise: the motion takes no torque to be a share of: give the residuals to expect")
    return NOISE * np.maximum(largest, LEAST * largest.max())


def _least_squares(Y: Array, ranges: Array) -> tuple[float, Array]:
    """The condition number of a regressor (m, k) whose residuals have deviation 1, scaled, and the deviations (k,) that
    least squares leave, from the singular value decomposition: the normal matrix has only half of its digits."""
    size = np.linalg.norm(Y, axis=0)
    size = np.maximum(size, SHORTEST * (size * ranges).max() / ranges)
    size[size == 0.0] = 1.0
    _, values, directions = np.linalg.svd(Y / size, full_matrices=len(Y) < len(size))
    rank = int(np.sum(values > UNEXCITED * values[0]))
    excited, not_excited = directions[:rank], directions[rank:]
    found = np.linalg.norm(excited / values[:rank, None], axis=0) / size
    found[np.linalg.norm(not_excited, axis=0) > COMPONENT] = np.inf
    return float(values[0] / values[-1]) if rank == len(size) else np.inf, found
