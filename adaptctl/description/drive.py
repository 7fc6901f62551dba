"""The drive of a joint, its geared rotor and its friction, and the joint's limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from adaptctl.arrays import real_number
from adaptctl.errors import InputError


class DriveParameter(Enum):
    """A parameter of a joint's drive, an enumeration in the order in which drive parameters follow the links' inertial
    ones: rotor inertia, viscous, Coulomb, square-root and Stribeck friction, and an offset, a constant torque.

    The rotor inertia enters the kinetic energy. The others, friction terms, do not: they are found from torques alone.
    """

    ROTOR_INERTIA = "rotor_inertia"
    VISCOUS = "viscous"
    COULOMB = "coulomb"
    SQUARE_ROOT = "square_root"
    STRIBECK = "stribeck"
    OFFSET = "offset"

    @property
    def is_friction(self) -> bool:
        """True for a friction term (every parameter but the rotor inertia), which adds a torque of its own and no
        energy."""
        return self is not DriveParameter.ROTOR_INERTIA


MAY_BE_NEGATIVE = frozenset({DriveParameter.SQUARE_ROOT, DriveParameter.STRIBECK, DriveParameter.OFFSET})
"""Terms that only bend a friction curve, or have no direction of their own."""
LARGEST_TERM = 1e20
"""Term of a drive that a mechanism may have (SI units): energies and torques of larger ones overflow."""


@dataclass(frozen=True)
class Drive:
    """A joint's drive: rotor inertia, and friction at the speed s of its motor shaft, rad/s or, for a prismatic joint,
    m/s.

    `rotor_inertia` (kg m^2; kg if prismatic) is that seen at the joint, through the gears. The friction torque that the
    drive must overcome (N m; N if prismatic), in the direction of positive s, is

        viscous s + sign(s) (coulomb + square_root sqrt|s| + stribeck/(1 + (s/0.1)^2)) + offset

    with `viscous` in N m s/rad, `square_root` in N m (s/rad)^(1/2) and the others in N m (prismatic: N for N m, m for
    rad) (Armstrong-Helouvry, Dupont and Canudas de Wit 1994, section 2.2; the square root is of lubricated gears). The
    equations of motion smooth it: there |s| is sqrt(s^2 + 0.01^2) and sign(s) is s/|s|, 0 at rest. A term that is None,
    the default, is not modelled and no parameter.

    `turns_with`, empty by default, has pairs (name, ratio) of other joints that turn the same shaft, as in a wrist
    whose last motor sits before its second joint. s is then the joint's own velocity plus each of theirs times its
    ratio, and the drive's torque acts on these joints in the same ratios. Raises `InputError` for a term that is no
    number, not finite or above 1e20 in size, for rotor inertia, viscous or Coulomb friction below 0, and for a ratio
    that is 0 or not finite.
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
            value, least = self.value(kind), -LARGEST_TERM if kind in MAY_BE_NEGATIVE else 0.0
            if value is not None and not least <= real_number(value, kind.value) <= LARGEST_TERM:
                allowed = f"of at least {least:g} and at most {LARGEST_TERM:g}"
                raise InputError(f"{kind.value}: expected a finite number {allowed}, got {value}")
        if isinstance(self.turns_with, str) or not isinstance(self.turns_with, Iterable):
            raise InputError(f"turns_with: expected pairs of a joint's name and a ratio, got {self.turns_with!r}")
        object.__setattr__(self, "turns_with", tuple(map(_pair, self.turns_with)))
        for name, ratio in self.turns_with:
            if not (math.isfinite(ratio) and ratio != 0.0):
                raise InputError(f"turns_with: {name}: expected a finite ratio other than 0, got {ratio}")

    def with_terms(self, terms: Mapping[DriveParameter, float | None]) -> Drive:
        """A copy of this drive with some of its terms changed: values in SI units by `DriveParameter`, None for a term
        that is no longer modelled. The others stay. Raises `InputError` for a value that is no number, not finite or
        above 1e20 in size, and for rotor inertia, viscous or Coulomb friction below 0."""
        values: dict[str, Any] = {kind.value: value for kind, value in terms.items()}
        return replace(self, **values)

    def value(self, kind: DriveParameter) -> float | None:
        """The value, in SI units, of this drive's term `kind`, such as its rotor inertia; None where the term is not
        modelled. Nothing is raised."""
        value: float | None = getattr(self, kind.value)
        return value


def _pair(given: object) -> tuple[str, float]:
    """The name of a joint and the ratio in which a shaft turns with it."""
    name, ratio = given if isinstance(given, tuple | list) and len(given) == 2 else (None, None)
    if not isinstance(name, str):
        raise InputError(f"turns_with: expected pairs of a joint's name and a ratio, got {given!r}")
    return name, real_number(ratio, f"turns_with: {name}")


@dataclass(frozen=True)
class Limits:
    """Limits of a joint: its position range `lower` to `upper` (rad, or m if prismatic), greatest speed `velocity`
    (rad/s, or m/s) and greatest torque or force `effort` (N m, or N), each infinite, so no limit, by default. Raises
    `InputError` for a limit that is no real number, and unless lower < upper and the others are positive."""

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
