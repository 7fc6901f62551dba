"""Dynamic friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, exp, where
from adaptctl.simulation.effects.effect import JointEffect, at_least_zero, validate_positive

POSITIVE, OTHERS = ("stiffness", "coulomb"), ("stribeck", "damping", "viscous")


@dataclass(frozen=True, eq=False)
class LuGre(JointEffect):
    r"""
    Dynamic friction of the joints by the deflection of bristles, unknown to the controller.

    Parameters
    ----------
    coulomb : array_like
        Coulomb friction in N m (N if prismatic), positive, one number or (r,).
    stiffness : array_like
        Stiffness of the bristles in N m/rad (N/m), positive, one number or (r,). Joints stick by friction that rises
        with it, up to deflections of friction divided by it.
    stribeck : array_like, default 0.0
        Excess of static over Coulomb friction in N m (N), one number or (r,). Zero for none.
    stribeck_speed : float, default 0.05
        Speed in rad/s (m/s) at which 63 % of that excess are gone. Lubricated gears have some hundredths.
    damping : array_like, default 0.0
        Damping of the bristles in N m s/rad (N s/m), one number or (r,). Zero lets stuck joints ring.
    viscous : array_like, default 0.0
        Viscous friction in N m s/rad (N s/m), one number or (r,). Zero for none.

    Raises
    ------
    InputError
        If the speed is not positive and finite; `Plant` checks the rest, and refuses explicit integrators.

    Notes
    -----
    .. math::

        \tau = \sigma_0 z + \sigma_1 \dot z + f_v v, \quad
        \dot z = v - \frac{\sigma_0 |v|}{f_c + f_s e^{-(v/v_s)^2}}\,z

    [1]_ with the deflections z (r,), zero at first, in `PlantState.drives` behind the actuators' states.

    References
    ----------
    .. [1] C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, "A new model for control of systems with
       friction", IEEE Trans. Automatic Control, 1995.

    Examples
    --------
    >>> from adaptctl.simulation import LinearlyImplicitEuler
    >>> from adaptctl.simulation.effects import LuGre
    >>> sticking = LuGre(coulomb=[2.0, 0.5], stiffness=1e4, stribeck=0.2)
    >>> adaptctl.Plant(arm, period, 4, LinearlyImplicitEuler(), effects=[sticking]).sizes["drives"]
    2
    """

    has_state = True

    coulomb: ArrayLike
    stiffness: ArrayLike
    stribeck: ArrayLike = 0.0
    stribeck_speed: float = 0.05
    damping: ArrayLike = 0.0
    viscous: ArrayLike = 0.0

    def __post_init__(self) -> None:
        validate_positive(self.stribeck_speed, "LuGre: stribeck_speed", "rad/s")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        for name in (*POSITIVE, *OTHERS):
            values = at_least_zero(getattr(self, name), dof, f"LuGre: {name}")
            if not np.isfinite(values).all() or (name in POSITIVE and not values.all()):
                kind = "positive, finite" if name in POSITIVE else "finite"
                raise InputError(f"LuGre: {name}: expected {kind} numbers, got {values.tolist()}")

    def torque(self, v: Column, held: Column) -> Column:
        """Resisting torque (r,) of steady sliding."""
        signs = Column(where(x < 0.0, -1.0, where(x > 0.0, 1.0, 0.0)) for x in v)
        return signs * self._level(v) + self._each("viscous", v) * v

    def max_slope(self, dof: int) -> Array:
        """Infinite slopes (r,): a joint sticks."""
        return np.full(dof, np.inf)

    def moved_state(self, z: Column, v: Column, time: float) -> Column:
        """Deflections (r,) after a step, by the implicit Euler method."""
        return self._kept(v, time) * (z + time * v)

    def resistance(self, z: Column, v: Column, held: Column, time: float) -> tuple[Column, Column]:
        """Torques (r,) and slopes (r,) of bristles and oil."""
        kept, stiffness, damping = self._kept(v, time), self._each("stiffness", v), self._each("damping", v)
        bent = kept * (stiffness - damping * self._fading(v)) * z
        return bent, kept * (time * stiffness + damping) + self._each("viscous", v)

    def _kept(self, v: Column, time: float) -> Column:
        return Column(1.0 / (1.0 + time * rate) for rate in self._fading(v))

    def _fading(self, v: Column) -> Column:
        """Rates (r,) in 1/s at which deflections fade."""
        parts = zip(self._each("stiffness", v), v, self._level(v), strict=True)
        return Column(k * absolute(x) / level for k, x, level in parts)

    def _level(self, v: Column) -> Column:
        excess = Column(exp(-(x * x) * (1.0 / self.stribeck_speed**2)) for x in v)
        return self._each("coulomb", v) + self._each("stribeck", v) * excess

    def _each(self, name: str, v: Column) -> Column:
        return Column(np.broadcast_to(np.asarray(getattr(self, name), dtype=np.float64), len(v)).tolist())
