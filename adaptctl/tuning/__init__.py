"""Automatic tuning."""

from adaptctl.tuning.default_controller import adaptive_controller, learning_law, with_friction
from adaptctl.tuning.limits_alone import limits_alone
from adaptctl.tuning.tune import Tuning, tune
from adaptctl.tuning.verification import Verification

__all__ = ["Tuning", "Verification", "adaptive_controller", "learning_law", "limits_alone", "tune", "with_friction"]
