"""Friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.description.drive import DriveParameter
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED, friction
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute
from adaptctl.simulation.effects.effect import JointEffect, at_least_zero, validate_positive

KINDS = (DriveParameter.VISCOUS, DriveParameter.COULOMB, DriveParameter.STRIBECK)


@dataclass(frozen=True, eq=False)
class Friction(JointEffect):
    r"""
    Viscous, Coulomb and Stribeck friction of the joints, unknown to the controller.

    Parameters
    ----------
    viscous : array_like, default 0.0
        Viscous friction in N m s/rad (N s/m if prismatic), one number or (r,). Zero for none.
    coulomb : array_like, default 0.0
        Coulomb friction in N m (N), one number or (r,). Zero for none.
    stribeck : array_like, default 0.0
        Excess of static over Coulomb friction in N m (N), one number or (r,). Zero for none.
    stribeck_speed : float, default 0.1
        Speed in rad/s (m/s) at which half of that excess is gone.
    load : array_like, default 0.0
        Share of the torque on a joint by which Coulomb friction rises, one number or (r,). Zero for none.

    Raises
    ------
    InputError
        If the speed is not positive and finite; `Plant` checks the rest, and refuses explicit integrators with a load.

    Notes
    -----
    .. math:: \tau = f_v v + \left(f_c + f_l |u| + \frac{f_s}{1 + (v/v_s)^2}\right) \operatorname{sign}(v)

    [1]_ [2]_ with the torque u of the drives, or of the springs of elastic joints [3]_, and the sign smoothed to
    v/sqrt(v^2 + 0.01^2). It adds to the modelled friction of the drives.

    References
    ----------
    .. [1] D. P. Hess, A. Soom, "Friction at a lubricated line contact operating at oscillating sliding velocities",
       Journal of Tribology, 1990.
    .. [2] B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools and compensation
       methods for the control of machines with friction", Automatica, 1994, section 2.2.
    .. [3] P. Hamon, M. Gautier, P. Garrec, "Dynamic identification of robots with a dry friction model depending on
       load and velocity", IROS, 2010.

    Examples
    --------
    >>> from adaptctl.simulation.effects import Friction
    >>> rough = adaptctl.Plant(arm, period, effects=[Friction(viscous=0.5, coulomb=[2.0, 0.5])])
    >>> Friction(viscous=0.5, coulomb=[2.0, 0.5]).max_slope(2).tolist()
    [200.5, 50.5]
    """

    viscous: ArrayLike = 0.0
    coulomb: ArrayLike = 0.0
    stribeck: ArrayLike = 0.0
    stribeck_speed: float = 0.1
    load: ArrayLike = 0.0

    def __post_init__(self) -> None:
        validate_positive(self.stribeck_speed, "friction: stribeck_speed", "rad/s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        if not np.isfinite([*self._each(dof), self._share(dof)]).all():
            raise InputError("friction: expected finite numbers")

    def torque(self, v: Column, held: Column) -> Column:
        """Resisting torque (r,)."""
        viscous, coulomb, stribeck = self._each(len(v)).tolist()
        rising = zip(coulomb, self._share(len(v)).tolist(), held, strict=True)
        loaded = [level + share * absolute(x) if share else level for level, share, x in rising]
        terms = zip(KINDS, (viscous, loaded, stribeck), strict=True)
        each = (Column(values) * Column(friction(kind, x, self.stribeck_speed) for x in v) for kind, values in terms)
        return sum(each, Column.zeros(len(v)))

    def max_slope(self, dof: int) -> Array:
        """Slopes (r,) at rest, infinite with a load, as no torque bounds it."""
        viscous, coulomb, stribeck = self._each(dof)
        slopes = viscous + (coulomb + stribeck) / COULOMB_SMOOTHING_SPEED
        return np.where(self._share(dof) > 0.0, np.inf, slopes)

    def _each(self, dof: int) -> Array:
        given = ((kind.value, getattr(self, kind.value)) for kind in KINDS)
        return np.array([at_least_zero(values, dof, f"friction: {name}") for name, values in given])

    def _share(self, dof: int) -> Array:
        return at_least_zero(self.load, dof, "friction: load")
