"""Trial estimate, which follows missed torques while they are in doubt."""

from __future__ import annotations

from functools import reduce

from adaptctl.control.adaptation.doubt import CLEAR, TorqueEquations, Watch
from adaptctl.scalars import Column, Scalar, maximum, minimum, where

RETURN_AFTER, RETURN = 0.1, 0.03
"""s without a miss that start the return to the trusted estimate; its time constant"""
MIN_TRIAL_GAIN = 0.1
"""least share of the gain with which a trial estimate follows: noise drives it with all of it"""
LEAK = 0.5
"""1/s, return of the trial estimate to the trusted one"""


def returning(doubt: Column, period: float) -> Scalar:
    """Share of the way back to the trusted estimate that a trial estimate goes in a period."""
    calm = reduce(maximum, doubt) < CLEAR - RETURN_AFTER
    return where(calm, held(period), LEAK * period)


def held(period: float) -> float:
    """The same of an estimate that follows nothing."""
    return min(period / RETURN, 1.0)


def trial_share(sample: TorqueEquations, watch: Watch) -> Scalar:
    """Share of the gain with which a trial estimate follows, less where torques are noisier than is stated."""
    shares = (1.0 / (1.0 + weight * noise) for weight, noise in zip(sample.weights, watch.noise, strict=True))
    return maximum(MIN_TRIAL_GAIN, reduce(minimum, shares))
