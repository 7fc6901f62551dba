"""Largest stiffness that a control period carries."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers, positive_period, whole_number
from adaptctl.errors import InputError

MAX_DELAY = 100


def largest_stiffness(damping: ArrayLike, control_period: float, delay: int = 0) -> Array:
    r"""
    Compute the largest stiffness that a damping keeps passive in a sampled loop.

    Parameters
    ----------
    damping : array_like
        Damping D (...) in N m s/rad (N s/m).
    control_period : float
        Time T in s for which a torque is held.
    delay : int, default 0
        Control periods d, up to 100, between a measurement and its torque, beyond the hold.

    Returns
    -------
    ndarray
        Stiffness (...) in N m/rad (N/m).

    Raises
    ------
    InputError
        If a damping is negative or not finite, the period is not positive or the delay no whole number.

    Notes
    -----
    A held torque -K x - D v of a motion of frequency :math:`\omega` takes energy if

    .. math:: K\le\frac{\omega D}{\tan(\omega\tau)},\quad\tau=T(d+1/2),

    which for slow motions is :math:`D\ge K\tau`, the condition of Colgate and Schenkel [1]_ with D on the damping side.
    Returned is the bound for :math:`\omega\tau=\pi/4`: passive up to a quarter of the sampling rate without delay. For
    all frequencies [1]_ asks for friction of the arm itself above :math:`K\tau+D`.

    References
    ----------
    .. [1] Colgate and Schenkel, J. Robotic Systems, 1997.

    Examples
    --------
    >>> adaptctl.control.largest_stiffness([6.0, 2.0], 0.004).round()
    array([2356.,  785.])
    """
    D = numbers(damping, "damping")
    if not np.all(np.isfinite(D) & (D >= 0.0)):
        raise InputError(f"damping: expected finite numbers of at least 0, got {D.tolist()}")
    lag = positive_period(control_period, "control_period") * (whole_number(delay, "delay", 0, MAX_DELAY) + 0.5)
    return np.asarray(0.25 * math.pi * D / lag)
