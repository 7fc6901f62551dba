"""Choice of how long the noise of torques lasts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identification.filtered_dynamics import ROWS_PER_PERIOD, Rows
from adaptctl.identification.fit import FitSettings, LogEvidence

# Times in s that noise may last, the largest share of the motion that these may be, so that what a model lacks is not
# taken for noise, and the share of their distance by which pairs of rows may be nearer or further apart.
TIMES, MOST_SHARE, EVEN = (0.3, 1.0, 3.0), 1.0 / 15.0, 0.1


def lasting_times(evidence: LogEvidence, settings: FitSettings) -> tuple[float, ...]:
    """Times (r,) in s that each joint's noise lasts, 0 if not, by residuals of least squares; () if no joint's does."""
    every, own = range(evidence.blocks), evidence.sampled
    lasts = float(evidence.equations(settings, every).count.max()) / (ROWS_PER_PERIOD * settings.cutoff)
    times = (0.0, *(time for time in TIMES if time <= MOST_SHARE * lasts))
    rows, x = own.fitted_rows(settings), evidence.ordinary(settings, every)
    error = np.where(own.counted(settings), rows.regressor @ x - rows.torque, np.nan)
    found = tuple(_lasts(rows, each, times) for each in error.T)
    return found if any(found) else ()


def _lasts(rows: Rows, error: Array, times: Sequence[float]) -> float:
    """Time by which errors (n,) of a joint follow best from those of a period of the cut-off before."""
    # Rows that are nearer have their filter in common, and are alike whatever the noise.
    before, after = slice(None, -int(ROWS_PER_PERIOD)), slice(int(ROWS_PER_PERIOD), None)
    steps = rows.time[after] - rows.time[before]
    step = float(np.median(steps))
    pairs = (rows.log[after] == rows.log[before]) & (np.abs(steps - step) < EVEN * step)
    pairs &= np.isfinite(error[after] + error[before])
    shares = [np.exp(-step / time) if time else 0.0 for time in times]
    squares = [np.sum((error[after] - share * error[before])[pairs] ** 2) for share in shares]
    return times[int(np.argmin(squares))]
