"""Protocols of closed-loop runs, whoever drove them: what is needed to judge how one went."""

from __future__ import annotations

from typing import Protocol

from adaptctl.arrays import Array


class TrackedRun(Protocol):
    """Protocol of a run: T control periods of r joints and of the reference they followed."""

    @property
    def p(self) -> Array:
        """Positions (T, r), rad or m."""
        ...

    @property
    def v(self) -> Array:
        """Velocities (T, r), rad/s or m/s."""
        ...

    @property
    def reference_p(self) -> Array:
        """The reference's positions (T, r), rad or m."""
        ...

    @property
    def reference_v(self) -> Array:
        """The reference's velocities (T, r), rad/s or m/s."""
        ...


class SampledRun(TrackedRun, Protocol):
    """Protocol of a run with its reference's accelerations and its sampling time."""

    @property
    def reference_a(self) -> Array:
        """Accelerations (T, r) of the reference, rad/s^2 or m/s^2."""
        ...

    @property
    def control_period(self) -> float:
        """Time between samples, s."""
        ...


class LearningRun(TrackedRun, Protocol):
    """Protocol of a run with the estimates of its adaptive controller."""

    @property
    def estimate(self) -> Array:
        """Parameter estimates (T, k)."""
        ...
