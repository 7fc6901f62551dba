"""Measured against predicted torques, on rows that no fit has seen."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, whole_number
from adaptctl.caching import cached_property
from adaptctl.errors import InputError
from adaptctl.identification.filtered_dynamics import Rows


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a model on n rows of a log: `measured` and `predicted` torques (n, r) of r joints, N m (N for a
    prismatic joint), at instants when the arm moves. Both went through one low-pass filter of `cutoff` Hz.

    `origin` says in words which rows these are, and `time` (n,) is in s, as in the log; predictions are from the
    measured motion alone. Raises `InputError` for arrays of other shapes, and for no rows or no joints.
    """

    origin: str
    """which samples, in words"""
    cutoff: float
    time: Array
    """(n,) s, as in the log"""
    measured: Array
    predicted: Array
    """from the measured motion alone"""

    def __post_init__(self) -> None:
        time, measured, predicted = map(np.shape, (self.time, self.measured, self.predicted))
        if len(measured) != 2 or 0 in measured or predicted != measured or time != measured[:1]:
            raise InputError(
                "validation: expected times (n,) and measured and predicted torques of one shape (n, r), n and r at "
                f"least 1, got {time}, {measured} and {predicted}"
            )

    @property
    def rms_error(self) -> float:
        """Root mean square torque error (predicted less measured) over all joints and instants, N m (N for prismatic
        joints)."""
        return float(np.sqrt(np.mean(np.square(self.error))))

    @property
    def relative_error(self) -> float:
        """Relative torque error, without a unit: sqrt(sum of errors^2 / sum of measured torques^2), both sums over all
        joints and instants. 0 where all errors are zero; else infinite where all measured torques are zero."""
        return float(_relative(np.linalg.norm(self.error), np.linalg.norm(self.measured)))

    @property
    def joint_rms_errors(self) -> Array:
        """Root mean square torque errors (r,) of each of r joints over all instants, N m (N for a prismatic joint)."""
        return np.sqrt(np.mean(np.square(self.error), axis=0))

    @property
    def joint_relative_errors(self) -> Array:
        """Relative torque errors (r,) of r joints, without a unit: for each joint sqrt(sum of errors^2 / sum of
        measured torques^2), both sums over all instants. 0 where all its errors are zero; else infinite where all its
        measured torques are zero."""
        return _relative(np.linalg.norm(self.error, axis=0), np.linalg.norm(self.measured, axis=0))

    @cached_property
    def error(self) -> Array:
        """Torque errors (n, r) at n instants, of r joints, predicted minus measured, N m (N for a prismatic joint)."""
        return self.predicted - self.measured

    def autocorrelation(self, lags: int = 50) -> Array:
        """Autocorrelation (lags + 1, r) of the torque errors of r joints less their means, without a unit, at 0 to
        `lags` rows apart (a whole number of at least 0; any above n - 1, for n rows, counts as n - 1). It is 1 at lag
        0, and about 0 at others for white errors; for a joint whose errors are all equal it is 0 at others. Raises
        `InputError` for other lags."""
        count = min(whole_number(lags, "lags", 0, sys.maxsize), len(self.error) - 1)
        centred = np.where(np.ptp(self.error, axis=0) > 0.0, self.error - self.error.mean(axis=0), 0.0)
        whole = np.square(centred).sum(axis=0)
        whole[whole == 0.0] = 1.0
        later = [(centred[: len(centred) - k] * centred[k:]).sum(axis=0) / whole for k in range(1, count + 1)]
        return np.stack([np.ones(len(whole)), *later])


def _relative(error: ArrayLike, size: ArrayLike) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.equal(error, 0.0), 0.0, np.divide(error, size))


def predicted_torques(rows: Rows, x: Array, load: Array | None) -> Array:
    """Torques (n, r) of r joints, N m (N for a prismatic joint), that parameters `x` predict at the n instants of
    low-pass filtered equations of motion, `rows`. `x` (P + r,), SI units, are the P parameters of the rows' regressor
    and the r coefficients (unitless) of load-dependent friction, its torque over that of the joint without friction.
    `load` (n, r, r), N m (N), are the columns of these; None leaves that friction out. Raises `ValueError` for arrays
    of unlike shapes."""
    P = rows.regressor.shape[-1]
    rigid = rows.regressor @ x[:P]
    return rigid if load is None else rigid + load @ x[P:]
