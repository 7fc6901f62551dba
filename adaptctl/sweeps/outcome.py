"""Outcomes of a sweep's runs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptctl.errors import AdaptctlError
from adaptctl.simulation import Rollouts

FAILURES = (AdaptctlError, ArithmeticError, np.linalg.LinAlgError)
"""Errors of an experiment that make its run a failed one and leave others as they are."""


class RunOutcome(NamedTuple):
    """Outcome of one run of a sweep. `status` is "done", "diverged" or "failed", and `reason` says why it is not
    "done". Errors are of joint positions, actual less reference, rad (m if prismatic), joints of both kinds counting
    alike: `rms_error` is their root mean square over all joints and control periods until the run ended or diverged,
    `rms_error_last` that over the last two seconds (None for a run that diverged or is shorter), `largest_error` the
    largest magnitude of any joint. `diverged_at` is the time, s, and `diverged_joint` the joint, from 1, of the first
    error out of bounds; `lyapunov_rise`, J, is the largest rise of the control law's Lyapunov function from one sample
    to the next. All but the status are None or empty by default: None stands for a number that is not known. Nothing is
    checked."""

    status: str
    reason: str = ""
    rms_error: float | None = None
    rms_error_last: float | None = None
    largest_error: float | None = None
    diverged_at: float | None = None
    diverged_joint: int | None = None
    lyapunov_rise: float | None = None

    @classmethod
    def failed(cls, reason: str | Exception) -> RunOutcome:
        """Outcome "failed", a `RunOutcome`, of a run that could not be made or computed, for the `reason` given, a text
        or an error, as one line; its numbers are None. Nothing is raised."""
        return cls("failed", " ".join(str(reason).split()))

    @classmethod
    def each_of(cls, runs: Rollouts) -> list[RunOutcome]:
        """List of the `RunOutcome` of each of many simulated `runs`, a `Rollouts`, in their order: "diverged" where a
        joint's position error left its bound, "done" otherwise. Root mean squares and rises of the Lyapunov function
        that are not finite become None. Nothing is raised."""
        means = (np.sqrt(np.mean(errors**2, axis=-1)) for errors in (runs.rms_error, runs.final_rms_error))
        largest, rises = runs.largest_error.max(axis=-1), runs.lyapunov_rise
        columns = (x.tolist() for x in (*means, largest, rises, runs.diverged_at, runs.diverged_joint))
        return [cls._of(*numbers) for numbers in zip(*columns, strict=True)]

    @classmethod
    def _of(cls, rms: float, last: float, largest: float, rise: float, diverged_at: float, joint: int) -> RunOutcome:
        if joint < 0:
            return cls("done", "", _known(rms), _known(last), largest, lyapunov_rise=_known(rise))
        message = f"joint {joint + 1} left its bound at {diverged_at:g} s"
        return cls("diverged", message, _known(rms), None, largest, diverged_at, joint + 1, _known(rise))


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


def _known(value: float) -> float | None:
    """The number, or None where there is none."""
    return value if math.isfinite(value) else None
