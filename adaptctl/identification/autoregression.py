"""Errors that last, as autoregressions, and what they do to weighted sums."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.identification.convolution import recursed

# Residuals of a joint are modelled as an autoregression e_t = a_1 e_(t-1) + ... + w_t; the variance of Y'e is then that
# of w times the sum of squares of Y filtered backwards by 1/(1 - a_1 z - ...).

ORDER = 4
# Times (1 + 3 a)/n by which the sum a of a short series' coefficients is raised, as residuals of fits persist less than
# the noise (Kendall 1954), and the largest that it may be.
PERSISTENCE_ROUNDS, MAX_PERSISTENCE = 2.0, 0.98


def lasting_covariance(Y: Array, error: Array, parameters: float) -> Array:
    """Covariance (k, k) of sums Y'e over rows Y (n, k) whose errors (n,) are autoregressive."""
    coefficients, variance = autoregression(error, parameters)
    lasting = recursed(coefficients, Y[::-1])
    return np.asarray(variance * lasting.T @ lasting)


def autoregression(error: Array, parameters: float) -> tuple[Array, float]:
    """Coefficients (4,) of an autoregression of residuals (n,), and the variance of its innovations."""
    n = len(error)
    products = np.array([error[: n - k] @ error[k:] for k in range(ORDER + 1)]) / n
    if products[0] == 0.0:
        return np.zeros(ORDER), 0.0
    first = products[:ORDER] * np.where(np.arange(ORDER) == 0, 1.0 + 1e-9, 1.0)
    found = np.linalg.solve(first[np.abs(np.subtract.outer(range(ORDER), range(ORDER)))], products[1:])
    variance = max(float(products[0] - found @ products[1:]), 0.0) * n / max(n - parameters, 0.5 * n)
    whole = float(found.sum())
    if whole > 0.2:
        more = PERSISTENCE_ROUNDS * (1.0 + 3.0 * whole) / n
        found = found * max(min(whole + more, MAX_PERSISTENCE), min(whole, MAX_PERSISTENCE)) / whole
    return np.asarray(found), variance
