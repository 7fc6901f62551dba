"""Instrumental variables: regressors freed of the encoders' noise, which biases least squares.

Even and odd samples of a log have the same motion and independent noise. The regressor of one is regressed on that of
the other (two-stage least squares: Young and Jakeman 1979; Janot, Vandanjon and Gautier 2014 take their instruments
from a simulation, which needs the controller): what is left of it knows nothing of its own noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import Rows
from adaptctl.identification.preparation import PreparedLog

NEGLIGIBLE = 1e-8


def halves(log: PreparedLog) -> tuple[PreparedLog, PreparedLog]:
    """Two halves of a log: the even samples, and the odd ones brought to their times by the mean of two neighbours;
    torques are those of all samples."""
    count = (len(log.time) - 3) // 2
    even = slice(2, 2 + 2 * count, 2)
    before, after = log.position[1 : 1 + 2 * count : 2], log.position[3 : 3 + 2 * count : 2]
    torque = (log.torque[1 : 1 + 2 * count : 2] + 2.0 * log.torque[even] + log.torque[3 : 3 + 2 * count : 2]) / 4.0
    own = replace(
        log,
        rate=0.5 * log.rate,
        time=log.time[even],
        position=log.position[even],
        torque=torque,
        moving=log.moving[even],
    )
    return own, replace(own, position=0.5 * (before + after))


def first_stage(rows: Rows, instruments: Rows) -> Rows:
    """Rows whose regressor (n, r, P) is, joint by joint, its regression on the instruments' regressor."""
    parts = [_regressed(rows.regressor[:, j], instruments.regressor[:, j]) for j in range(rows.regressor.shape[1])]
    return replace(rows, regressor=np.stack(parts, axis=1))


def joined_first_stage(rows: Sequence[Rows], instruments: Sequence[Rows]) -> list[Rows]:
    """Rows of `first_stage` at each cut-off."""
    return [first_stage(own, other) for own, other in zip(rows, instruments, strict=True)]


def _regressed(Y: Array, Z: Array) -> Array:
    """Z (Z'Z)^+ Z'Y, in Z's column space as far as it is clear of round-off."""
    size = np.linalg.norm(Z, axis=0)
    U, values, _ = np.linalg.svd(Z[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    U = U[:, values > NEGLIGIBLE * values[0]] if len(values) else U
    return np.asarray(U @ (U.T @ Y))
