"""Drives of joints (rotor and friction) and their limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from adaptctl.arrays import real_number
from adaptctl.errors import InputError


class DriveParameter(Enum):
    """Parameter of a joint's drive, in the order of the parameters."""

    ROTOR_INERTIA = "rotor_inertia"
    VISCOUS = "viscous"
    COULOMB = "coulomb"
    SQUARE_ROOT = "square_root"
    STRIBECK = "stribeck"
    OFFSET = "offset"

    @property
    def is_friction(self) -> bool:
        """True for all but the rotor inertia."""
        return self is not DriveParameter.ROTOR_INERTIA


MAY_BE_NEGATIVE = frozenset({DriveParameter.SQUARE_ROOT, DriveParameter.STRIBECK, DriveParameter.OFFSET})
"""Terms that only bend a friction curve, or have no direction of their own."""
MAX_DRIVE_TERM = 1e20
"""Term of a drive that a mechanism may have (SI units): energies and torques of larger ones overflow."""


@dataclass(frozen=True)
class Drive:
    r"""
    Rotor inertia and friction of a joint, at the speed s of its motor shaft.

    Parameters
    ----------
    rotor_inertia : float, optional
        Inertia in kg m^2 (kg if prismatic) as seen at the joint, through the gears.
    viscous : float, optional
        Viscous friction in N m s/rad (N s/m).
    coulomb : float, optional
        Coulomb friction in N m (N).
    square_root : float, optional
        Friction of lubricated gears in N m (s/rad)^(1/2).
    stribeck : float, optional
        Excess of static friction in N m (N).
    offset : float, optional
        Constant torque in N m (N).
    turns_with : tuple of (str, float), optional
        Names of other joints that turn the same shaft, with ratios: their velocities times ratio add to s, and the
        drive's torque acts on them in the same ratios.

    Raises
    ------
    InputError
        If a term is not finite or above 1e20 in size, rotor inertia, viscous or Coulomb friction is negative, or a
        ratio is 0 or not finite.

    Notes
    -----
    A term of None is not modelled and no parameter. Friction opposes the motion by [1]_

    .. math::

        f(s) = f_v s + \mathrm{sign}(s) \left( f_c + f_r \sqrt{|s|} + \frac{f_s}{1 + (s / 0.1)^2} \right) + f_0

    smoothed near rest: :math:`|s|` is :math:`\sqrt{s^2 + 0.01^2}`.

    References
    ----------
    .. [1] Armstrong-Helouvry, Dupont and Canudas de Wit, "A survey of models, analysis tools and compensation methods
       for the control of machines with friction", Automatica, 1994.

    Examples
    --------
    >>> from adaptctl.description.drive import Drive
    >>> Drive(viscous=0.1, coulomb=0.5).viscous
    0.1
    """

    rotor_inertia: float | None = None
    viscous: float | None = None
    coulomb: float | None = None
    square_root: float | None = None
    stribeck: float | None = None
    offset: float | None = None
    turns_with: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        for kind in DriveParameter:
            value, least = self.value(kind), -MAX_DRIVE_TERM if kind in MAY_BE_NEGATIVE else 0.0
            if value is not None and not least <= real_number(value, kind.value) <= MAX_DRIVE_TERM:
                allowed = f"of at least {least:g} and at most {MAX_DRIVE_TERM:g}"
                raise InputError(f"{kind.value}: expected a finite number {allowed}, got {value}")
        if isinstance(self.turns_with, str) or not isinstance(self.turns_with, Iterable):
            raise InputError(f"turns_with: expected pairs of a joint's name and a ratio, got {self.turns_with!r}")
        object.__setattr__(self, "turns_with", tuple(map(_pair, self.turns_with)))
        for name, ratio in self.turns_with:
            if not (math.isfinite(ratio) and ratio != 0.0):
                raise InputError(f"turns_with: {name}: expected a finite ratio other than 0, got {ratio}")

    def with_terms(self, terms: Mapping[DriveParameter, float | None]) -> Drive:
        """Copy of this drive with some of its terms changed."""
        values: dict[str, Any] = {kind.value: value for kind, value in terms.items()}
        return replace(self, **values)

    def value(self, kind: DriveParameter) -> float | None:
        """Value of a term; None where it is not modelled."""
        value: float | None = getattr(self, kind.value)
        return value


def _pair(given: object) -> tuple[str, float]:
    name, ratio = given if isinstance(given, tuple | list) and len(given) == 2 else (None, None)
    if not isinstance(name, str):
        raise InputError(f"turns_with: expected pairs of a joint's name and a ratio, got {given!r}")
    return name, real_number(ratio, f"turns_with: {name}")


@dataclass(frozen=True)
class Limits:
    """
    Position range, speed and effort limits of a joint.

    Parameters
    ----------
    lower, upper : float, optional
        Position range in rad (m if prismatic); unlimited by default.
    velocity : float, optional
        Greatest speed in rad/s (m/s); unlimited by default.
    effort : float, optional
        Greatest torque in N m (force in N); unlimited by default.

    Raises
    ------
    InputError
        If a limit is not a number, `lower` is not below `upper`, or another limit is not positive.

    Examples
    --------
    >>> from adaptctl.description import Limits
    >>> Limits(-1.0, 1.0, effort=60.0)
    Limits(lower=-1.0, upper=1.0, velocity=inf, effort=60.0)
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "effort"):
            object.__setattr__(self, name, real_number(getattr(self, name), f"limits: {name}"))
        if not self.lower < self.upper:
            raise InputError(f"position limits: expected lower < upper, got {self.lower} and {self.upper}")
        if not (self.velocity > 0.0 and self.effort > 0.0):
            raise InputError(f"limits: expected positive velocity and effort, got {self.velocity}, {self.effort}")
