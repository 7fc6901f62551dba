"""A controller's run in a comparison, its errors and the cost of its step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.errors import InputError
from adaptctl.recording.moving_average import moving_rms
from adaptctl.simulation.run import Rollout

if TYPE_CHECKING:
    pass


# Time in s at the end of a run over which its final error is taken.
FINAL_ERROR_TIME = 2.0


# Time in s at the start of a run over which its first error is taken.
FIRST_ERROR_TIME = 1.0


# Joints by their indices.
Joints: TypeAlias = slice | list[int]


ALL_JOINTS = slice(None)


@dataclass(frozen=True)
class StepCost:
    """
    Computing cost of a control step, which computes one torque vector.

    Nothing is checked at construction.

    Parameters
    ----------
    called : float, optional
        Median time in s of a call from Python. Default: None, not known.
    native : float, optional
        Mean time in s within a loop in native code. Default: None, not known.
    flops : int, optional
        Floating-point operations, without sines, cosines and roots. Default: None, not known.

    Examples
    --------
    >>> from adaptctl.recording import StepCost
    >>> StepCost(flops=420).flops
    420
    """

    called: float | None = None
    native: float | None = None
    flops: int | None = None


@dataclass(frozen=True, eq=False)
class ControllerRun:
    """
    Closed-loop run of one controller with its name, label and cost.

    Nothing is checked at construction.

    Parameters
    ----------
    name : str
        Short name, fit for a file, and unique in a comparison.
    label : str
        Label for legends and tables.
    prior_knowledge : str
        What the controller knows of the arm before the run, in words; empty for nothing.
    rollout : Rollout
        Run of T samples of r joints.
    lyapunov : numpy.ndarray, optional
        Values (T,) of the Lyapunov function in J; None where the law has none.
    cost : StepCost, optional
        Computing cost of a control step. Default: None, not measured.
    law : str, optional
        Names of the control law's class and, after a plus, of its adaptation law's. Default: empty, not known.

    Examples
    --------
    >>> from adaptctl.recording import ControllerRun
    >>> adaptive = ControllerRun("adaptive", "Slotine-Li", "", run)
    >>> adaptive.rms_error() > 0.0, adaptive.moving_rms_error(0.05).shape == run.time.shape
    (True, True)
    """

    name: str
    label: str
    prior_knowledge: str
    rollout: Rollout
    lyapunov: Array | None = None
    cost: StepCost | None = None
    law: str = ""

    def __repr__(self) -> str:
        return f"<ControllerRun {self.name!r}: {self.duration:.3g} s>"

    @property
    def duration(self) -> float:
        """Duration of the run in s, rounded up to a whole sample."""
        return self.rollout.duration

    def rms_error(self, start: float = 0.0, stop: float = np.inf, joints: Joints = ALL_JOINTS) -> float | None:
        """
        Compute the root mean square tracking error over a time and some joints.

        Parameters
        ----------
        start : float, default 0.0
            First time in s that counts. Zero is the beginning of the run.
        stop : float, default numpy.inf
            Time in s before which samples count. Infinity is the end of the run.
        joints : slice or list of int, optional
            Indices of the joints; all by default.

        Returns
        -------
        float or None
            Error in rad (m if prismatic), which mixes both where joints are of both kinds; None without samples.

        Raises
        ------
        IndexError
            If there is no joint of an index.
        InputError
            If no joint is selected.

        Examples
        --------
        >>> from adaptctl.recording import compared_runs
        >>> subject = compared_runs(arm, {"adaptive": run}).subject
        >>> subject.rms_error(start=0.1, joints=[0]) > 0.0
        True
        """
        inside = slice(*np.searchsorted(self.rollout.time, (start, stop)))
        errors = (self.rollout.p[inside] - self.rollout.reference_p[inside])[:, joints]
        if errors.shape[1] == 0:
            raise InputError(f"joints: expected at least one joint, got {joints}")
        return float(np.sqrt(np.mean(errors**2))) if len(errors) else None

    @property
    def first_rms_error(self) -> float | None:
        """Root mean square tracking error over the first second in rad (m)."""
        return self.first_rms_error_of(ALL_JOINTS)

    @property
    def final_rms_error(self) -> float | None:
        """Root mean square tracking error over the last two seconds in rad (m)."""
        return self.final_rms_error_of(ALL_JOINTS)

    def first_rms_error_of(self, joints: Joints) -> float | None:
        """
        Compute the tracking error of some joints over the first second.

        Parameters
        ----------
        joints : slice or list of int
            Indices, from 0, of the joints over which the mean is taken.

        Returns
        -------
        float or None
            Root mean square in rad (m if prismatic); None where the run is shorter.

        Raises
        ------
        IndexError
            If there is no joint of an index.
        InputError
            If no joint is selected.
        """
        return self.rms_error(stop=FIRST_ERROR_TIME, joints=joints) if self._lasts(FIRST_ERROR_TIME) else None

    def final_rms_error_of(self, joints: Joints) -> float | None:
        """
        Compute the tracking error of some joints over the last two seconds.

        Parameters
        ----------
        joints : slice or list of int
            Indices, from 0, of the joints over which the mean is taken.

        Returns
        -------
        float or None
            Root mean square in rad (m if prismatic); None where the run is shorter.

        Raises
        ------
        IndexError
            If there is no joint of an index.
        InputError
            If no joint is selected.
        """
        return (
            self.rms_error(start=self.duration - FINAL_ERROR_TIME, joints=joints)
            if self._lasts(FINAL_ERROR_TIME)
            else None
        )

    def _lasts(self, length: float) -> bool:
        """True if the run lasts that many seconds, to half a sample."""
        return self.duration > length - 0.5 * self.rollout.sample_time

    def moving_rms_error(self, window: float) -> Array:
        """
        Compute the tracking error over a moving window.

        Parameters
        ----------
        window : float
            Length in s of the window before each sample; it is shorter at the run's start.

        Returns
        -------
        numpy.ndarray
            Root mean squares (T,) over all joints in rad (m if prismatic); not finite from the first error that is not.

        Raises
        ------
        InputError
            If the window is not positive and finite.
        """
        positive_number(window, "window: expected a positive number of s", 0.0, np.inf)
        return moving_rms(self.rollout.error, window, self.rollout.sample_time)

    @property
    def is_estimating(self) -> bool:
        """True if the controller estimates parameters."""
        return bool(self.rollout.estimate.shape[1])

    @property
    def realtime_factor(self) -> float | None:
        """Simulated time divided by computing time; None if it was not measured."""
        return self.duration / self.rollout.wall_time if self.rollout.wall_time > 0.0 else None

    @property
    def lyapunov_max_increase(self) -> float | None:
        """Largest rise of the Lyapunov function between samples in J."""
        if self.lyapunov is None or len(self.lyapunov) == 0 or not np.isfinite(self.lyapunov).all():
            return None
        return max(0.0, float(np.diff(self.lyapunov).max(initial=0.0)))
