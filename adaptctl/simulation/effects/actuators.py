"""Torques that arrive late."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column, clip
from adaptctl.simulation.effects.effect import ActuatorEffect, at_least_zero, validate_positive

BUFFER = 64
"""Control periods of torques that are kept."""


@dataclass(frozen=True)
class ControlDelay(ActuatorEffect):
    """Pure delay (dead time) of the commanded torque: it reaches the joints `ticks` control periods after it was
    commanded, by computing and communication.

    Sampling and hold alone delay by half a period; a controller that needs the period to compute delays by one more
    (Astrom and Wittenmark, Computer-Controlled Systems, 1997, section 2.3). Before the first torque arrives, the joints
    get the torque that held them. `rank` 0: the delay comes first of the actuator effects. It has no flag in a rollout.
    Raises `InputError` unless `ticks` (unitless) is an integer from 0 to 64 and not a bool.
    """

    ticks: int

    rank: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if isinstance(self.ticks, bool) or not isinstance(self.ticks, int | np.integer) or self.ticks < 0:
            raise InputError(f"control delay: expected a whole number of control periods, got {self.ticks!r}")
        if self.ticks > BUFFER:
            raise InputError(
                f"control delay: {self.ticks} control periods are longer than the buffer, which holds {BUFFER}: "
                "delay less, or lengthen the control period"
            )

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a delay fits any number of joints `dof`, any `links` and any control period (s)."""

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., ticks r) of the delay, the torques on their way to the r joints, the oldest
        first: `torque` (..., r), the torque that held the joints, N m (N for a prismatic joint), repeated `ticks`
        times, the delay's number of control periods. `control_period` (s) is not used. Nothing is checked."""
        return np.tile(torque, self.ticks)

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) of r joints that was commanded so many control periods ago as the delay's `ticks`, and the
        internal state (ticks r,) after this period: the torques commanded since, the oldest first and `torque` (r,),
        the one commanded now, last. All are in N m (N for a prismatic joint).

        `memory` (ticks r,) is the internal state before this period; its length is not checked. With `ticks` 0 both
        arguments are returned as they are. `control_period` (s) is not used. Vectors are Columns of scalars of any
        kind: floats, arrays, or symbols to be compiled.
        """
        if self.ticks == 0:
            return torque, memory
        dof = len(torque)
        return Column(memory.of[:dof]), Column((*memory.of[dof:], *torque))


@dataclass(frozen=True, eq=False)
class TorqueLimit(ActuatorEffect):
    """Torque limit (saturation) of the drives: each joint's torque is at most `limit` in magnitude, N m (N of a
    prismatic joint), whatever is asked of it; one number or one a joint (r,), infinity for no limit.

    An environment's own torque limits are those of its actions, which a controller can know; this one is hidden in the
    plant. `rank` is 1, the effect's position in the order from the controller to the joints: after a delay. `flag` is
    the name under which a rollout flags the control periods in which the limit cut a torque. The class itself checks
    nothing; a `Plant` raises `InputError` for limits that are no numbers, negative, NaN or do not fit its r joints.
    """

    limit: ArrayLike

    rank: ClassVar[int] = 1
    flag: ClassVar[str | None] = "torque_limited"

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the limit, N m (N for a prismatic joint), is one number of at least 0 or one for
        each of `dof` (r) joints; infinity is allowed. The names `links` and `control_period` (s) are not used."""
        at_least_zero(self.limit, dof, "torque limit")

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """An empty internal state (0,), one for all arms: a limit keeps nothing from one control period to the next.
        The `torque` (..., r) on the r joints and `control_period` (s) are not used. Nothing is raised."""
        return np.zeros(0)

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The torque (r,) of r joints clipped to the limits, N m (N for a prismatic joint), from the `torque` (r,)
        asked for, and the `memory` (0,) as it was. `control_period` (s) is not used. Vectors are Columns of scalars
        of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for limits that are negative, NaN or
        do not fit r joints."""
        limits = at_least_zero(self.limit, len(torque), "torque limit").tolist()
        return Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)), memory


@dataclass(frozen=True, eq=False)
class TorqueRateLimit(ActuatorEffect):
    """Torque rate limit (slew rate) of the drives: each joint's torque changes by at most `rate`, N m/s (N/s of a
    prismatic joint), as the supply voltage over the winding's inductance limits it; one number or one a joint (r,),
    infinity for no limit.

    `rank` is 2, the effect's position in the order from the controller to the joints: after a delay and a torque limit.
    `flag` is the name under which a rollout flags the control periods in which the rate limit changed a torque. The
    class itself checks nothing; a `Plant` raises `InputError` for rates that are no numbers, negative, NaN or do not
    fit its r joints.
    """

    rate: ArrayLike

    rank: ClassVar[int] = 2
    flag: ClassVar[str | None] = "rate_limited"

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `InputError` unless the rate, N m/s (N/s for a prismatic joint), is one number of at least 0 or one for
        each of `dof` (r) joints; infinity is allowed. The names `links` and `control_period` (s) are not used."""
        at_least_zero(self.rate, dof, "torque rate limit")

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., r) of the rate limit: `torque` (..., r) itself, not a copy, the torque that
        held the r joints, N m (N for a prismatic joint). `control_period` (s) is not used. Nothing is checked."""
        return torque

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The rate-limited torque (r,) of r joints, N m (N for a prismatic joint), twice: passed on to the joints, and
        as the effect's internal state (r,) after it. It is the torque nearest to the `torque` (r,) asked for that
        differs from the last one, `memory` (r,), by at most the effect's `rate` times `control_period` (s). Vectors are
        Columns of scalars of any kind: floats, arrays, or symbols to be compiled. Raises `InputError` for rates that
        are negative, NaN or do not fit r joints, `ValueError` for an internal state of another length."""
        steps = (at_least_zero(self.rate, len(torque), "torque rate limit") * control_period).tolist()
        given = Column(clip(x, y - step, y + step) for x, y, step in zip(torque, memory, steps, strict=True))
        return given, given


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    """First-order lag of a drive's torque x behind the commanded torque u, both N m (N for a prismatic joint), as of a
    current loop: time_constant dx/dt = u - x. `time_constant` is in s, one number for all joints.

    While u is held over a control period, x is an exponential. The joints get its mean over the period, so that the
    impulse is exact; the error of doing so is of third order in the period. `rank` 3: the lag comes last, after a
    delay, a torque limit and a rate limit. It has no flag in a rollout. Raises `InputError` unless `time_constant` is a
    positive finite number and not a bool.
    """

    time_constant: float

    rank: ClassVar[int] = 3

    def __post_init__(self) -> None:
        if isinstance(self.time_constant, bool):
            raise InputError(f"actuator lag: expected a positive number of s, got {self.time_constant}")
        validate_positive(self.time_constant, "actuator lag", "s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise nothing: a lag fits any number of joints `dof`, any `links` and any control period (s)."""

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """The initial internal state (..., r) of the lag, the torques of r drives, N m (N for a prismatic joint):
        `torque` (..., r) itself, not a copy, the torque that held the joints. `control_period` (s) is not used. Nothing
        is checked."""
        return torque

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """The mean torque (r,) that r joints get over one `control_period` (s), and the lag's internal state (r,) after
        it, the drives' torque x at the period's end; all N m (N for a prismatic joint). `torque` (r,) is the commanded
        torque u, held over the period, and `memory` (r,) is x at its start: time_constant dx/dt = u - x. Vectors are
        Columns of scalars of any kind: floats, arrays, or symbols to be compiled. Raises `ValueError` where these
        differ in length. The period, which must be positive, is not checked."""
        ratio = control_period / self.time_constant
        mean = -math.expm1(-ratio) / ratio
        behind = memory - torque
        return torque + mean * behind, torque + math.exp(-ratio) * behind
