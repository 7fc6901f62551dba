"""What a run of a sweep came to."""

from __future__ import annotations

from typing import NamedTuple


class Outcome(NamedTuple):
    """What a run came to, in numbers; None for what is not known."""

    status: str
    reason: str = ""
    rms_error: float | None = None
    rms_error_last: float | None = None
    largest_error: float | None = None
    diverged_at: float | None = None
    diverged_joint: int | None = None
    lyapunov_rise: float | None = None

    @classmethod
    def failed(cls, reason: str) -> Outcome:
        """That of a run that could not be."""
        return cls("failed", reason)


OUTCOME = {
    "status": ("string", "done, diverged, or failed"),
    "reason": ("string", "why, where it is not done"),
    "rms_error": ("double", "root mean square of the errors of all joints, rad or m; until it diverged"),
    "rms_error_last": ("double", "the same over the last two seconds, rad or m"),
    "largest_error": ("double", "of any joint, rad or m"),
    "diverged_at": ("double", "s"),
    "diverged_joint": ("int64", "from 1"),
    "lyapunov_rise": ("double", "largest rise of the Lyapunov function from one sample to the next, J"),
}
"""Kind and meaning of an outcome's columns."""
