"""A payload that comes and goes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from adaptctl.arrays import Array, real_number
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.effects.effect import LoadEffect
from adaptctl.simulation.effects.payload import Payload


@dataclass(frozen=True, eq=False)
class PayloadHeld(LoadEffect):
    """Plant effect of a payload, a rigid body that a link holds from the time `start` until the time `stop` (s): from 0
    on and for ever by default. `link` is the link's name, None, the default, for the last link that has mass.

    `payload` is a `Payload`, a mass in kg, or a mapping with `mass` (kg) and perhaps `center` of mass (3,) in m, in the
    link's frame, and `inertia` tensor (3, 3) in kg m^2 about the centre; it is stored as a `Payload`. When it is picked
    up it already moves with the link, and when it is dropped it moves on: the arm's velocities do not jump.

    Raises `InputError` where `payload` cannot be made into a `Payload`, such as a mapping without `mass` or a negative
    mass, and unless `start` is finite and before `stop`; `NotFoundError`, a subclass of it, for a mapping with unknown
    entries. A `Plant` raises `NotFoundError` for a link that it does not have or that has no mass, `InputError` for a
    mechanism with relations among its inertial parameters.
    """

    payload: Payload | float | Mapping[str, Any]
    start: float = 0.0
    stop: float = math.inf
    link: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "payload", Payload.of(self.payload))
        start, stop = real_number(self.start, "payload: start"), real_number(self.stop, "payload: stop")
        if not (math.isfinite(start) and start < stop):
            raise InputError(f"payload: expected a start before its stop, got {self.start} and {self.stop} s")

    def require(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Raise `NotFoundError` unless this effect's `link`, the name of the link that holds the payload, is None or
        among `links`, the names of the links with ten inertial parameters each. The number of joints `dof` and
        `control_period` (s) are not used."""
        self._place(links)

    def mass(self, time: float) -> float:
        """The mass, kg, that the payload adds at `time` (s): its own while it is held, `start` <= `time` < `stop` of
        this effect, else 0. Nothing is raised."""
        return Payload.of(self.payload).mass if self.start <= time < self.stop else 0.0

    def until(self, time: float) -> float:
        """The first time after `time` (s) at which the payload is picked up or dropped, s; infinity where there is
        none. Nothing is raised."""
        return next((change for change in (self.start, self.stop) if time < change), math.inf)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """The P inertial and friction parameters (..., P) of a mechanism at `time` (s): while the payload is held, a
        copy of `parameters` (..., P), SI units, with the payload added to the ten of its link; otherwise `parameters`
        itself, unchecked.

        The parameters begin with ten for each of the `links` (names), in their order: m, mc_x, mc_y, mc_z, I_xx, I_xy,
        I_yy, I_xz, I_yz, I_zz, in kg, kg m, kg m^2 about the origin of the link's frame; the drives' (rotor inertias
        and friction), if any, follow. While the payload is held, raises `NotFoundError` where its link is not among
        `links`, `InputError` for parameters that are no numbers or too few to include that link's.
        """
        if not self.start <= time < self.stop:
            return parameters
        return Payload.of(self.payload).added_to(parameters, self._place(links))

    def _place(self, links: tuple[str, ...]) -> int:
        """The index of the payload's link."""
        if self.link is None:
            return len(links) - 1
        if self.link not in links:
            raise NotFoundError(f"payload: there is no link {self.link!r}; links: {', '.join(links)}")
        return links.index(self.link)
