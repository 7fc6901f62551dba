"""Choice of how long the noise of torques lasts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.identification.autoregression import lasting_covariance
from adaptctl.identification.filtered_dynamics import ROWS_PER_PERIOD
from adaptctl.identification.fit import FitSettings, LogEvidence
from adaptctl.identification.uncertainty import scaled_inverse

# Times in s that noise may last; the largest share of the motion that these may be, so that what a model lacks is not
# taken for noise; share of the deviations that each joint's must take off; and rounds of the search over joints.
TIMES, MOST_SHARE, MIN_GAIN, ROUNDS = (0.3, 1.0, 3.0), 1.0 / 15.0, 0.05, 2


class _Told(NamedTuple):
    """Normal matrix (c, c) of a joint's rows in c parameters, and the covariance (c, c) of their moment."""

    normal: Array
    score: Array


def lasting_times(evidence: LogEvidence, settings: FitSettings) -> tuple[float, ...]:
    """Times (r,) in s that each joint's noise lasts, 0 if not, by which deviations are least; () if no joint's does."""
    every, r = range(evidence.blocks), evidence.mechanism.dof
    equations = evidence.equations(settings, every)
    lasts = float(equations.count.max()) / (ROWS_PER_PERIOD * settings.cutoff)
    times = (0.0, *(time for time in TIMES if time <= MOST_SHARE * lasts))
    if len(times) == 1:
        return ()
    x, own, columns = evidence.ordinary(settings, every), evidence.sampled, evidence.independent(settings)
    told = [_told_by(own, replace(settings, lasting=(time,) * r), x, columns) for time in times]
    best = [0] * r
    for j in ROUNDS * tuple(range(r)):
        tried = ([*best[:j], k, *best[j + 1 :]] for k in range(len(times)))
        sizes = [_size([told[k][i] for i, k in enumerate(one)]) for one in tried]
        least = int(np.argmin(sizes))
        best[j] = least if sizes[least] < sizes[best[j]] - MIN_GAIN else best[j]
    return tuple(times[k] for k in best) if any(best) else ()


def _told_by(evidence: LogEvidence, settings: FitSettings, x: Array, columns: NDArray[np.int64]) -> list[_Told]:
    rows, used = evidence.fitted_rows(settings), evidence.counted(settings)
    error, share, found = rows.regressor @ x - rows.torque, len(columns) / used.shape[1], list[_Told]()
    for j, here in enumerate(used.T):
        own = error[here, j]
        weight = 1.0 / (np.sqrt(np.mean(own**2)) or 1.0) if here.any() else 0.0
        Y = weight * rows.regressor[here, j][:, columns]
        score = lasting_covariance(Y, weight * own, share) if here.any() else np.zeros((len(columns), len(columns)))
        found.append(_Told(Y.T @ Y, score))
    return found


def _size(joints: Sequence[_Told]) -> float:
    """Mean logarithm of the parameters' deviations."""
    normal, score = (np.sum(part, axis=0) for part in zip(*joints, strict=True))
    inverse = scaled_inverse(normal, np.arange(len(normal)))
    return float(0.5 * np.mean(np.log(np.maximum(np.diag(inverse @ score @ inverse), 1e-300))))
