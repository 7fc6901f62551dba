"""What sits in a joint besides its links: a geared rotor, and friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from adaptctl.errors import InputError


class DriveParameter(Enum):
    """The parameters of a joint's drive, in the order they follow the links' ten.

    A rotor's inertia enters the energy; friction does not, so energies can never find it and it is always kept.
    """

    ROTOR_INERTIA = "rotor_inertia"
    VISCOUS = "viscous"
    COULOMB = "coulomb"

    @property
    def is_friction(self) -> bool:
        """True where the parameter takes energy out instead of storing it."""
        return self is not DriveParameter.ROTOR_INERTIA


@dataclass(frozen=True)
class Drive:
    """A joint's rotor inertia through its gears (kg m^2, or kg for a prismatic joint), viscous friction
    (N m s/rad) and Coulomb friction (N m). None where it is not modelled: it is then no parameter at all."""

    rotor_inertia: float | None = None
    viscous: float | None = None
    coulomb: float | None = None

    def __post_init__(self) -> None:
        for kind in DriveParameter:
            value = self.value(kind)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{kind.value}: expected a finite number of at least 0, got {value}")

    def value(self, kind: DriveParameter) -> float | None:
        """The value of one parameter."""
        value: float | None = getattr(self, kind.value)
        return value
