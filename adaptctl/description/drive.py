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
    STIFFNESS = "stiffness"
    SINE = "sine"
    COSINE = "cosine"
    SINE_2 = "sine_2"
    COSINE_2 = "cosine_2"

    @property
    def is_rotor(self) -> bool:
        """True for the rotor inertia."""
        return self is DriveParameter.ROTOR_INERTIA

    @property
    def is_friction(self) -> bool:
        """True for the terms of the speed, and the offset."""
        return not (self.is_rotor or self.is_spring)

    @property
    def is_spring(self) -> bool:
        """True for the terms of the position, which store energy: the spring's and the harmonics of the angle."""
        return self is DriveParameter.STIFFNESS or self.is_harmonic

    @property
    def is_harmonic(self) -> bool:
        """True for the harmonics of the angle, which only a joint that turns has."""
        return self in HARMONICS


HARMONICS = (DriveParameter.SINE, DriveParameter.COSINE, DriveParameter.SINE_2, DriveParameter.COSINE_2)
"""Harmonics of the angle, the first two and then those of its double."""
DISSIPATIVE = tuple(kind for kind in DriveParameter if kind.is_friction and kind is not DriveParameter.OFFSET)
"""Friction that takes energy, whichever way the joint moves."""
MAY_BE_NEGATIVE = frozenset(DriveParameter) - {
    DriveParameter.ROTOR_INERTIA,
    DriveParameter.VISCOUS,
    DriveParameter.COULOMB,
}
"""Terms that only bend a friction curve, or have no direction of their own."""
MAX_DRIVE_TERM = 1e20
"""Term of a drive that a mechanism may have (SI units): energies and torques of larger ones overflow."""


@dataclass(frozen=True)
class Drive:
    r"""
    Rotor inertia, friction and springs of a joint, at the speed s of its motor shaft and the position q of the joint.

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
    stiffness : float, optional
        Stiffness in N m/rad (N/m) of a spring at the joint, which is at rest at q = -offset/stiffness.
    sine, cosine, sine_2, cosine_2 : float, optional
        Torque in N m of the first two harmonics of the joint's angle, as of a counterbalance, cables or cogging.
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
    A term of None is not modelled and no parameter. What the drive has to give for springs is

    .. math::

        k q + a_1 \sin q + b_1 \cos q + a_2 \sin 2q + b_2 \cos 2q

    at the joint itself, whatever else turns the shaft. Friction opposes the motion by [1]_

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
    stiffness: float | None = None
    sine: float | None = None
    cosine: float | None = None
    sine_2: float | None = None
    cosine_2: float | None = None
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
