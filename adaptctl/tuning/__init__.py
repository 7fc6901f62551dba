"""Gains, reference and integrator chosen for a mechanism, and verified in closed loop."""

from adaptctl.tuning.tune import Tuning, tune
from adaptctl.tuning.verification import Verification

__all__ = ["Tuning", "Verification", "tune"]
