"""What is needed of a closed-loop run, whoever drove it, to judge how it went."""

from __future__ import annotations

from typing import Protocol

from adaptctl.arrays import Array


class Followed(Protocol):
    """A run of T periods of r joints, and what it was to follow."""

    @property
    def p(self) -> Array:
        """Positions (T, r)."""
        ...

    @property
    def v(self) -> Array:
        """Velocities (T, r)."""
        ...

    @property
    def reference_p(self) -> Array:
        """The reference's positions (T, r)."""
        ...

    @property
    def reference_v(self) -> Array:
        """The reference's velocities (T, r)."""
        ...
