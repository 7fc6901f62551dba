"""Uncertainty of torques elsewhere that a motion leaves in each parameter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.excitation.deviations import least_squares_deviations
from adaptctl.control.gains.workspace import everywhere
from adaptctl.control.lyapunov import SampledRun
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.identifiability.factorisation import triangle_by_joint

TORQUE_ERROR_SHARE, CORRELATION_TIME = 3e-3, 1.0
"""Error of torques over their limits, about what a drive's current loop keeps, and time in s that it stays the same."""
OPEN_SHARE = 0.01
"""Share of a torque limit from which on a parameter counts as open."""
LEAST = 0.1
"""Velocity in rad/s (m/s) and acceleration in rad/s^2 (m/s^2) that a joint has elsewhere, at least."""
NUM_SAMPLES = 1000
"""Samples of a run that are enough."""


def torque_uncertainty(model: ReducedModel, run: SampledRun, torque_limits: ArrayLike) -> Array:
    r"""
    Compute the torques that each parameter leaves uncertain elsewhere, when it is learned from one run.

    Parameters
    ----------
    model : ReducedModel
        Reduced model of the mechanism with k parameters and r primary joints.
    run : Rollout
        Run of T samples; those that are not finite are left out.
    torque_limits : array_like
        Torque limits (r,) in N m (N if prismatic), finite.

    Returns
    -------
    ndarray
        Standard deviations (k,) of torques at random positions over their limits, without a unit; infinite for a
        parameter that the run does not show at all.

    Raises
    ------
    InputError
        If the run has another number of joints, or limits are not positive and finite.

    Notes
    -----
    .. math:: \sqrt{(W^{-1})_{ii}}\;y_i,\qquad W=\frac{1}{1\,\mathrm{s}}\int Y^\top\Sigma^{-2}Y\,dt

    with the regressor Y along the run, measured torques wrong by :math:`\Sigma`, 0.3 % of the limits, for 1 s at a
    time, and :math:`y_i`, the root mean square of a column of Y over the limits at random positions, with the run's
    root mean square velocities and accelerations, at least 0.1 rad/s and rad/s^2 (m/s, m/s^2). W is Fisher's
    information [1]_.

    References
    ----------
    .. [1] Fedorov, Theory of Optimal Experiments, 1972.

    Examples
    --------
    >>> adaptctl.control.torque_uncertainty(model, run, arm.effort_limits).shape
    (6,)
    """
    r = model.mechanism.dof
    limits = frozen_array(torque_limits, (r,), "torque_limits")
    if not np.all(limits > 0.0):
        raise InputError(f"torque_limits: expected {r} positive numbers, got {limits.tolist()}")
    if (joints := run.p.shape[1]) != r:
        raise InputError(f"run: expected {r} joints, as {model.mechanism.name} has, got {joints}")
    every = max(1, len(run.p) // NUM_SAMPLES)
    chosen = [array[::every] for array in (run.p, run.v, run.reference_v, run.reference_a)]
    finite = np.isfinite(np.concatenate(chosen, axis=1)).all(axis=1)
    if not finite.any():
        return np.full(len(model.columns), np.inf)
    shares = model.slotine_li_regressor(*(array[finite] for array in chosen))
    shares *= np.sqrt(every * run.sample_time / CORRELATION_TIME) / TORQUE_ERROR_SHARE / limits[:, None]
    rows = triangle_by_joint(shares)
    elsewhere = _shares_elsewhere(model, run, limits)
    felt = elsewhere > 0.0
    found = np.zeros(len(elsewhere))
    if felt.any():
        rows = rows if felt.all() else rows[:, felt]
        found[felt] = least_squares_deviations(rows, 1.0 / elsewhere[felt])[1] * elsewhere[felt]
    return found


def _shares_elsewhere(model: ReducedModel, run: SampledRun, limits: Array) -> Array:
    """Root mean squares (k,) of columns over limits at random positions."""
    p = everywhere(model.mechanism).samples
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (2, *p.shape))
    v, a = signs[0] * _size(run.reference_v), signs[1] * _size(run.reference_a)
    shares = model.slotine_li_regressor(p, v, v, a) / limits[:, None]
    return np.sqrt((shares**2).sum(axis=1).mean(axis=0))


def _size(array: Array) -> Array:
    """Root mean squares (r,) over samples (T, r), at least `LEAST`."""
    return np.maximum(np.sqrt((array**2).mean(axis=0)), LEAST)
