"""Energy that an impedance may give to its surroundings."""

from __future__ import annotations

from typing import Any, NamedTuple

from adaptctl.scalars import Column, Scalar, maximum, minimum

RESERVE = 0.1
"""share of the tank below which it closes by and by"""


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
        Torque (r,) of gravity and friction at the last tick in N m (N), which does not count.
    opening : ndarray
        Share (1,) of stiffness and reference velocity that the energy carries, 1 unless the tank is nearly empty.

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


def opened(tank: EnergyTank, p: Column, torque: Column, stretched: Scalar, size: float) -> EnergyTank:
    """
    Tank at the next tick, after a held torque (r,), where the whole springs would hold some energy.

    The work of a held torque is exact: torque times the way.
    """
    left = tank.energy[0] - (torque - tank.weight) @ (p - tank.p)
    opening = minimum(maximum(left, 0.0) / (stretched + RESERVE * size), 1.0)
    energy = minimum(left, opening * stretched + size)
    return EnergyTank(Column((energy,)), p, tank.weight, Column((opening,)))
