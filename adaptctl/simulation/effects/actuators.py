"""Actuator effects."""

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

MAX_DELAY_PERIODS = 64
"""control periods"""


@dataclass(frozen=True)
class ControlDelay(ActuatorEffect):
    """
    Pure delay (dead time) of the commanded torque.

    Parameters
    ----------
    periods : int
        Control periods, 0 to 64, by which a torque arrives late.

    Raises
    ------
    InputError
        If `periods` is not an int from 0 to 64.

    Notes
    -----
    First of the actuator effects. Until the first torque arrives, the holding torque is applied. A controller that
    computes for one period adds a period to the half of sampling and hold [1]_.

    References
    ----------
    .. [1] K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 1997, section 2.3.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ControlDelay
    >>> late = adaptctl.Plant(arm, period, effects=[ControlDelay(2)])
    >>> late.sizes["drives"]
    4
    """

    periods: int

    rank: ClassVar[int] = 0

    def __post_init__(self) -> None:
        if isinstance(self.periods, bool) or not isinstance(self.periods, int | np.integer) or self.periods < 0:
            raise InputError(f"control delay: expected a whole number of control periods, got {self.periods!r}")
        if self.periods > MAX_DELAY_PERIODS:
            raise InputError(
                f"control delay: {self.periods} control periods are more than the buffer length of "
                f"{MAX_DELAY_PERIODS}: reduce the delay, or lengthen the control period"
            )

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """Initial internal state."""
        return np.tile(torque, self.periods)

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """Torque and internal state after the period."""
        if self.periods == 0:
            return torque, memory
        dof = len(torque)
        return Column(memory.of[:dof]), Column((*memory.of[dof:], *torque))


@dataclass(frozen=True, eq=False)
class TorqueLimit(ActuatorEffect):
    """
    Torque limit (saturation) of the drives, unknown to the controller.

    Parameters
    ----------
    limit : array_like
        Largest torque in N m (N if prismatic), one number or (r,), infinity for no limit. `Plant` checks it.

    Notes
    -----
    Acts after a delay; flag "torque_limited".

    Examples
    --------
    >>> from adaptctl.simulation.effects import TorqueLimit
    >>> adaptctl.Plant(arm, period, effects=[TorqueLimit(5.0)]).flags
    ('torque_limited',)
    """

    limit: ArrayLike

    rank: ClassVar[int] = 1
    flag: ClassVar[str | None] = "torque_limited"

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        at_least_zero(self.limit, dof, "torque limit")

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """Initial internal state."""
        return np.zeros(0)

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """Torque and internal state after the period."""
        limits = at_least_zero(self.limit, len(torque), "torque limit").tolist()
        return Column(clip(x, -most, most) for x, most in zip(torque, limits, strict=True)), memory


@dataclass(frozen=True, eq=False)
class TorqueRateLimit(ActuatorEffect):
    """
    Torque rate limit (slew rate) of the drives.

    Parameters
    ----------
    rate : array_like
        Largest change of the torque in N m/s (N/s if prismatic), one number or (r,), infinity for no limit. `Plant`
        checks it.

    Notes
    -----
    Acts after a delay and a torque limit; flag "rate_limited".

    Examples
    --------
    >>> from adaptctl.simulation.effects import TorqueRateLimit
    >>> adaptctl.Plant(arm, period, effects=[TorqueRateLimit([2000.0, 500.0])]).flags
    ('rate_limited',)
    """

    rate: ArrayLike

    rank: ClassVar[int] = 2
    flag: ClassVar[str | None] = "rate_limited"

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        at_least_zero(self.rate, dof, "torque rate limit")

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """Initial internal state."""
        return torque

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """Torque and internal state after the period."""
        steps = (at_least_zero(self.rate, len(torque), "torque rate limit") * control_period).tolist()
        given = Column(clip(x, y - step, y + step) for x, y, step in zip(torque, memory, steps, strict=True))
        return given, given


@dataclass(frozen=True)
class ActuatorLag(ActuatorEffect):
    r"""
    First-order lag of the drives' torque.

    Parameters
    ----------
    time_constant : float
        Time constant T in s, for all joints.

    Raises
    ------
    InputError
        If the time constant is not positive and finite.

    Notes
    -----
    .. math:: T\,\dot x = u - x

    with the commanded torque u; the joints get the mean of x over the period. Last of the actuator effects.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ActuatorLag
    >>> lag = adaptctl.Plant(arm, period, effects=[ActuatorLag(0.002)])
    >>> state = lag.step(lag.init(p, [0.0, 0.0]), [0.0, 0.0])
    >>> bool(np.all(np.abs(state.applied_torque) > 0.0))
    True
    """

    time_constant: float

    rank: ClassVar[int] = 3

    def __post_init__(self) -> None:
        if isinstance(self.time_constant, bool):
            raise InputError(f"actuator lag: expected a positive number of s, got {self.time_constant}")
        validate_positive(self.time_constant, "actuator lag", "s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""

    def initial_state(self, torque: Array, control_period: float) -> Array:
        """Initial internal state."""
        return torque

    def apply(self, torque: Column, memory: Column, control_period: float) -> tuple[Column, Column]:
        """Torque and internal state after the period."""
        ratio = control_period / self.time_constant
        mean = -math.expm1(-ratio) / ratio
        behind = memory - torque
        return torque + mean * behind, torque + math.exp(-ratio) * behind
