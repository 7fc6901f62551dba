"""Drives whose torque cannot jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects.effect import ActuatorEffect, at_least_zero


@dataclass(frozen=True, eq=False)
class TorqueRateLimit(ActuatorEffect):
    """Torque rate limit (slew rate) of the drives: each joint's torque changes by at most `rate`, N m/s (N/s of a
    prismatic joint), as the supply voltage over the winding's inductance limits it; one number or one a joint (r,),
    infinity for no limit.

    `rank` is 2, the effect's position in the order from the controller to the joints: after a delay and a torque limit.
    `mark` is the name under which a rollout flags the control periods in which the rate limit changed a torque. The
    class itself checks nothing; a `Plant` raises `InputError` for rates that are no numbers, negative, NaN or do not
    fit its r joints.
    """

    rate: ArrayLike

    rank: ClassVar[int] = 2
    mark: ClassVar[str | None] = "rate_limited"

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the rate, N m/s (N/s for a prismatic joint), is one number of at least 0 or one for
        each of `dof` (r) joints; infinity is allowed. The names `links` and `control_period` (s) are not used."""
        at_least_zero(self.rate, dof, "torque rate limit")

    def start(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., r) of the rate limit: `torque` (..., r) itself, not a copy, the torque that
        held the r joints, N m (N for a prismatic joint). `control_period` (s) is not used. Nothing is checked."""
        return torque

    def act(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The rate-limited torque (r,) of r joints, N m (N for a prismatic joint), twice: passed on to the joints, and
        as the effect's internal state (r,) after it. It is the torque nearest to the `torque` (r,) asked for that
        differs from the last one, `memory` (r,), by at most the effect's `rate` times `control_period` (s). Vectors are
        Columns of scalars of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for rates that
        are negative, NaN or do not fit r joints, `ValueError` for an internal state of another length."""
        steps = (at_least_zero(self.rate, len(torque), "torque rate limit") * control_period).tolist()
        given = Column(clip(x, y - step, y + step) for x, y, step in zip(torque, memory, steps, strict=True))
        return given, given
