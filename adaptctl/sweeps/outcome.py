"""Outcomes of a sweep's runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.simulation import Rollouts


class RunOutcome(NamedTuple):
    """Outcome of a run, in numbers; None for what is not known."""

    status: str
    reason: str = ""
    rms_error: float | None = None
    rms_error_last: float | None = None
    largest_error: float | None = None
    diverged_at: float | None = None
    diverged_joint: int | None = None
    lyapunov_rise: float | None = None

    @classmethod
    def failed(cls, reason: str) -> RunOutcome:
        """Outcome of a run that could not be made."""
        return cls("failed", reason)

    @classmethod
    def of(cls, runs: Rollouts, m: int) -> RunOutcome:
        """Outcome of run m of many."""
        lost = bool(runs.diverged_joint[m] >= 0)
        message = f"joint {runs.diverged_joint[m] + 1} left its bound at {runs.diverged_at[m]:g} s"
        return cls(
            status="diverged" if lost else "done",
            reason=message if lost else "",
            rms_error=_mean(runs.rms_error[m]),
            rms_error_last=None if lost else _mean(runs.final_rms_error[m]),
            largest_error=float(runs.largest_error[m].max()),
            diverged_at=float(runs.diverged_at[m]) if lost else None,
            diverged_joint=int(runs.diverged_joint[m]) + 1 if lost else None,
            lyapunov_rise=_known(runs.lyapunov_rise[m]),
        )


OUTCOME = {
    "status": ("string", "done, diverged, or failed"),
    "reason": ("string", "why, where it is not done"),
    "rms_error": ("double", "root mean square of the errors of all joints, rad or m; until it diverged"),
    "rms_error_last": ("double", "the same over the last two seconds, rad or m; None of shorter runs"),
    "largest_error": ("double", "of any joint, rad or m"),
    "diverged_at": ("double", "s"),
    "diverged_joint": ("int64", "from 1"),
    "lyapunov_rise": ("double", "largest rise of the Lyapunov function from one sample to the next, J"),
}
"""Kind and meaning of an outcome's columns."""


def _mean(values: Array) -> float | None:
    """Root mean square over joints (r,); None where it is not known."""
    return _known(float(np.sqrt(np.mean(values**2))))


def _known(value: float) -> float | None:
    """The number, or None where there is none."""
    return float(value) if np.isfinite(value) else None
