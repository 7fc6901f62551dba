"""Protocols of closed-loop runs, whoever drove them: what is needed to judge how one went."""

from __future__ import annotations

from typing import Protocol

from adaptctl.arrays import Array


class TrackedRun(Protocol):
    """Protocol of a closed-loop run: T control periods of r joints, and the reference that they followed. Positions
    `p`, velocities `v`, and the reference's `reference_p` and `reference_v` are arrays (T, r), in rad and rad/s (m and
    m/s if prismatic), one row a sample. Nothing is checked."""

    @property
    def p(self) -> Array:
        """Positions (T, r) of the r joints at the run's T samples, rad (m if prismatic)."""
        ...

    @property
    def v(self) -> Array:
        """Velocities (T, r) of the r joints at the run's T samples, rad/s (m/s if prismatic)."""
        ...

    @property
    def reference_p(self) -> Array:
        """The reference's positions (T, r) for the r joints at the run's T samples, rad (m if prismatic)."""
        ...

    @property
    def reference_v(self) -> Array:
        """The reference's velocities (T, r) for the r joints at the run's T samples, rad/s (m/s if prismatic)."""
        ...


class SampledRun(TrackedRun, Protocol):
    """Protocol of a closed-loop run of T samples of r joints, a `TrackedRun` (positions and velocities, and the
    reference's) with two more attributes: its reference's accelerations `reference_a` (T, r), rad/s^2 (m/s^2 if
    prismatic), and its sampling time `control_period`, s. Nothing is checked."""

    @property
    def reference_a(self) -> Array:
        """The reference's accelerations (T, r) for the r joints at the run's T samples, rad/s^2 (m/s^2 if
        prismatic)."""
        ...

    @property
    def control_period(self) -> float:
        """Time from one sample of the run to the next, s: the control period."""
        ...


class LearningRun(TrackedRun, Protocol):
    """Protocol of a closed-loop run of T samples of r joints, a `TrackedRun` (positions and velocities, and the
    reference's) with one more attribute: its adaptive controller's estimates `estimate` (T, k) of k parameters, SI
    units. Nothing is checked."""

    @property
    def estimate(self) -> Array:
        """The adaptive controller's estimates (T, k) of its k parameters at the run's T samples, in the parameters' SI
        units."""
        ...
