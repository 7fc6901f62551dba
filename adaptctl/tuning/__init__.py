"""Automatic tuning."""

from adaptctl.tuning.tune import Tuning, tune
from adaptctl.tuning.verification import Verification

__all__ = ["Tuning", "Verification", "tune"]
