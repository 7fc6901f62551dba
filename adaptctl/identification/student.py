"""Quantiles of Student's distribution, without SciPy's functions, which take long to load."""

from __future__ import annotations

from math import atan, exp, inf, lgamma, pi, sqrt
from statistics import NormalDist

import numpy as np

# Intervals of Simpson's rule for the integral of the density, and relative step at which the search ends.
INTERVALS, LAST_STEP = 512, 1e-12


def student_quantile(share: float, freedom: float) -> float:
    """Quantile above the median of Student's distribution with some degrees of freedom, by Newton's steps."""
    size = exp(lgamma(0.5 * freedom + 0.5) - lgamma(0.5 * freedom)) / sqrt(pi * freedom)
    rule = np.array([1.0, *([4.0, 2.0] * (INTERVALS // 2 - 1)), 4.0, 1.0]) / (3.0 * INTERVALS)
    t, step = NormalDist().inv_cdf(share), inf
    while abs(step) > LAST_STEP * t:  # from below, where steps stay, as the distribution is concave
        angle = atan(t / sqrt(freedom))
        densities = np.cos(np.linspace(0.0, angle, INTERVALS + 1)) ** (freedom - 1.0)
        below = 0.5 + size * sqrt(freedom) * angle * float(rule @ densities)
        step = (share - below) / (size * (1.0 + t * t / freedom) ** (-0.5 * freedom - 0.5))
        t += step
    return t
