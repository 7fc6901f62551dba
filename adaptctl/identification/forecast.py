"""Forecast of the parameters' uncertainty from a motion, before it is run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, per_joint
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
    """Forecast of an identification: standard deviations to be expected of the fundamental parameters."""

    model: ReducedModel
    condition: float
    """of the regressor, its columns scaled to one length"""
    deviations: Array
    """(k,)"""
    combinations: tuple[Combination, ...]
    """the least excited first"""

    @property
    def relative(self) -> Array:
        """Relative deviations (k,), over the parameters' own sizes as the robot's file has them; infinite where these
        are 0."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.deviations / np.abs(self.model.fundamental_parameters))


def forecast(mechanism: Mechanism, motion: RobotMotion, noise: ArrayLike | None = None) -> Forecast:
    """Forecast of least squares on a motion's rows, with torque residuals of `noise` N m, one number or one a joint."""
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    _, p, v, a, _ = motion.sampled(RATE)
    largest = np.abs(mechanism.inverse_dynamics(p, v, a)).max(axis=0)
    expected = NOISE * np.maximum(largest, LEAST * largest.max())
    deviations = expected if noise is None else per_joint(noise, mechanism.dof, "noise")
    Y = (model.torque_regressor(p, v, a) / deviations[:, None]).reshape(-1, len(model.columns))
    size = np.linalg.norm(Y, axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.svd(Y / size, compute_uv=False)
    spread = np.linalg.pinv((Y / size).T @ (Y / size), rcond=1e-12, hermitian=True) / np.outer(size, size)
    found = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return Forecast(model, float(values[0] / values[-1]), found, tuple(combinations(Y.T @ Y, model.names)))
