"""Energy that an impedance may give to its surroundings."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.doubt import PAYLOAD, YOUTH, Watch
from adaptctl.control.pytree import either
from adaptctl.scalars import Column, Scalar, absolute, maximum, minimum, where

RESERVE = 0.1
"""share of the tank below which it closes by and by"""
CALM, TRUST = 3.0, 5.0
"""s without a doubt after which an estimate begins to be trusted, and the time constant with which it then is"""
UNTRUSTED = -1.0
"""calm of a tank whose arm knows nothing: it trusts what is learned at once"""


class EnergyTank(NamedTuple):
    """
    Energy of the springs and the tank of an impedance, and what the next work is counted from.

    Parameters
    ----------
    energy : ndarray
        Energy (1,) of the springs and the tank in J.
    p : ndarray
        Positions (r,) at the last tick in rad (m).
    weight : ndarray
        Torque (r,) of gravity and friction of the trusted estimate at the last tick in N m (N), which does not count.
    opening : ndarray
        Share (1,) of stiffness and reference velocity that the energy carries, 1 unless the tank is nearly empty.
    trusted : ndarray
        Estimate (k,) whose gravity and friction cost nothing, in SI units: what is learned since then is paid for.
    calm : ndarray
        Time (1,) in s without a doubt; -1 as long as nothing is trusted yet.

    Examples
    --------
    >>> impedance = adaptctl.control.JointImpedance(model, 40.0, [6.0, 2.0], tank=5.0)
    >>> impedance.init(p, v).controller_state.energy
    array([5.])
    """

    energy: Any
    p: Any
    weight: Any
    opening: Any
    trusted: Any
    calm: Any


def full(size: float, p: Array, v: Array, initial: Array) -> EnergyTank:
    """Full tank at positions and velocities (..., r), which trusts an initial estimate (k,) unless that is zero."""
    calm = 0.0 if np.any(initial) else UNTRUSTED
    return EnergyTank(
        np.array([size]), np.array(p), np.zeros(np.shape(v)[-1]), np.ones(1), np.array(initial), np.array([calm])
    )


def trusting(tank: EnergyTank, estimate: Column, watch: Watch | None, period: float) -> EnergyTank:
    """Tank that trusts an estimate a little more while nothing is doubted, and at once a payload that was announced.

    A law without doubts learns pushes: of it only the initial estimate is trusted, unless that was zero.
    """
    fresh = where(tank.calm[0] < 0.0, 1.0, 0.0)
    if watch is None:
        return tank._replace(trusted=tank.trusted + fresh * (estimate - tank.trusted))
    young, doubts = watch.age[0] < YOUTH, watch.alarm[0] > 0.0
    calm = where(young, tank.calm[0], where(doubts, 0.0, maximum(tank.calm[0], 0.0) + period))
    share = where(young, fresh, where(calm > CALM, period / TRUST, 0.0))
    followed = tank.trusted + where(doubts, 0.0, share) * (estimate - tank.trusted)
    loaded = where(absolute(watch.decision[0] - PAYLOAD) < 0.5, watch.announced[0], 0.0) > 0.5
    return tank._replace(trusted=either(loaded, watch.trusted, followed), calm=Column((calm,)))


def opened(tank: EnergyTank, p: Column, torque: Column, stretched: Scalar, size: float) -> EnergyTank:
    """
    Tank at the next tick, after a held torque (r,), where the whole springs would hold some energy.

    The work of a held torque is exact: torque times the way.
    """
    left = tank.energy[0] - (torque - tank.weight) @ (p - tank.p)
    opening = minimum(maximum(left, 0.0) / (stretched + RESERVE * size), 1.0)
    energy = minimum(left, opening * stretched + size)
    return tank._replace(energy=Column((energy,)), p=p, opening=Column((opening,)))
