"""Quantiles of Student's distribution, without SciPy's functions, which take long to load."""

from __future__ import annotations

from math import exp, lgamma, pi, sqrt, tan

import numpy as np

# Intervals of Simpson's rule for the integral of the density.
INTERVALS = 512


def student_quantile(share: float, freedom: float) -> float:
    """Quantile above the median of Student's distribution with some degrees of freedom, by halving angles to it."""
    size = exp(lgamma(0.5 * freedom + 0.5) - lgamma(0.5 * freedom)) / sqrt(pi)
    rule = np.array([1.0, *([4.0, 2.0] * (INTERVALS // 2 - 1)), 4.0, 1.0]) / (3.0 * INTERVALS)
    low, high = 0.0, 0.5 * pi
    while low < (angle := 0.5 * (low + high)) < high:
        densities = np.cos(np.linspace(0.0, angle, INTERVALS + 1)) ** (freedom - 1.0)
        below = 0.5 + size * angle * float(rule @ densities)
        low, high = (angle, high) if below < share else (low, angle)
    return sqrt(freedom) * tan(angle)
