"""Pushes of a hand on an arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from adaptctl.arrays import MAX_DURATION, Array, frozen_array, positive_number, real_number
from adaptctl.caching import sent_as_made
from adaptctl.errors import InputError, shown


@sent_as_made
@dataclass(frozen=True, eq=False)
class HandPush:
    """
    Force of a hand on a body in MuJoCo, for a time.

    Parameters
    ----------
    force : array_like
        Force (3,) in N along the world's axes.
    start : float
        Time in s at which it begins.
    duration : float
        Time in s from its begin to its end.
    rise : float, default 0.0
        Time in s in which it grows from 0 and, at its end, falls to 0; 0 for a sudden one.
    body : str, optional
        Name of the body of MuJoCo's arm, which is that of the link. Default: the last one.
    point : array_like, optional
        Point (3,) in m at which it acts, in the body's frame of MuJoCo. Default: the center of mass.

    Raises
    ------
    InputError
        If a number is not finite, a time is negative, `duration` is not positive, or `rise` is above half of it.

    Examples
    --------
    >>> from adaptctl.simulation import HandPush
    >>> push = HandPush([0.0, 20.0, 0.0], start=8.0, duration=5.0, rise=1.0)
    >>> [push.at(t).tolist()[1] for t in (7.9, 8.5, 10.0, 12.75, 13.0)]
    [0.0, 10.0, 20.0, 5.0, 0.0]
    """

    force: Array
    start: float
    duration: float
    rise: float = 0.0
    body: str | None = None
    point: Array | None = None

    def __post_init__(self) -> None:
        for name in ("force", "point") if self.point is not None else ("force",):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (3,), f"push: {name}"))
        positive_number(self.duration, "push: duration: expected a time in s above 0")
        for name, most in (("start", MAX_DURATION), ("rise", 0.5 * self.duration)):
            if not 0.0 <= real_number(given := getattr(self, name), f"push: {name}") <= most:
                bound = f"{most:g}, half of the duration" if name == "rise" else f"{most:g}"
                raise InputError(f"push: {name}: expected a time in s from 0 to {bound}, got {given!r}")

    def at(self, time: float) -> Array:
        """
        Return the force at a time.

        Parameters
        ----------
        time : float
            Time in s.

        Returns
        -------
        ndarray
            Force (3,) in N along the world's axes.

        Raises
        ------
        InputError
            If `time` is not a number.

        Examples
        --------
        >>> adaptctl.simulation.HandPush([0.0, 20.0, 0.0], start=8.0, duration=5.0).at(9.0).tolist()
        [0.0, 20.0, 0.0]
        """
        real_number(time, "push: time")
        passed = min(time - self.start, self.start + self.duration - time)
        within = passed >= 0.0 and time < self.start + self.duration
        return self.force * (within and (min(1.0, passed / self.rise) if self.rise else 1.0))


def validate_pushes(pushes: object) -> None:
    """Raise `InputError` unless given a sequence of pushes, which may be empty."""
    if not isinstance(pushes, Sequence) or not all(isinstance(push, HandPush) for push in pushes):
        raise InputError(f"pushes: expected a sequence of HandPush, such as [HandPush(...)], got {shown(pushes)}")
