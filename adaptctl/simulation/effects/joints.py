"""Joint elasticity and payloads."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, frozen_array, numbers, real_number, whole_number
from adaptctl.caching import sent_as_made
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.link import MAX_INERTIAL_PARAMETER
from adaptctl.description.places import place_on_link
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.effects.effect import Effect, LoadEffect, at_least_zero

if TYPE_CHECKING:
    from adaptctl.description import Description

LINK, MOTOR = "link", "motor"
"""Encoder behind or before the spring."""


@dataclass(frozen=True, eq=False)
class ElasticJoints(Effect):
    r"""
    Springs and dampers between the motors and links of r joints.

    Parameters
    ----------
    stiffness : array_like
        Stiffness k in N m/rad (N/m if prismatic), positive, one number or (r,).
    damping : array_like, default 0.0
        Damping d in N m s/rad (N s/m), one number or (r,). Zero leaves oscillations of the springs undamped.
    motor_inertia : array_like, default 0.0
        Inertia in kg m^2 (kg) that is added to the rotor inertia of the drives, one number or (r,). Zero where the
        drives have all of it.
    encoders : {"link", "motor"}, default "link"
        Place of the encoders: behind the springs, or before them, as on most robots.

    Raises
    ------
    InputError
        If `encoders` is another text. `Plant` checks numbers, refuses rotors that turn with several joints and
        relations among inertial parameters, and needs enough substeps for an explicit integrator.

    Notes
    -----
    .. math:: J \dot w = \tau - f, \quad M(q) \dot v + C v + g + \tau_f = f, \quad f = k(\theta - p) + d(w - v)

    [1]_ with the motors' positions :math:`\theta` and velocities w (joint side), the last 2r numbers of
    `PlantState.drives`. J is the drives' rotor inertia plus `motor_inertia`. Rotors turn about their joints' axes
    alone; friction acts on the links.

    References
    ----------
    .. [1] M. W. Spong, "Modeling and control of elastic joint robots", Journal of Dynamic Systems, Measurement, and
       Control, 1987.

    Examples
    --------
    >>> from adaptctl.simulation.effects import ElasticJoints
    >>> soft = adaptctl.Plant(arm, period, substeps=4, effects=[ElasticJoints(2000.0, motor_inertia=0.05)])
    >>> soft.is_elastic, soft.sizes["drives"]
    (True, 4)
    """

    stiffness: ArrayLike
    damping: ArrayLike = 0.0
    motor_inertia: ArrayLike = 0.0
    encoders: str = LINK

    def __post_init__(self) -> None:
        if not isinstance(self.encoders, str) or self.encoders not in (LINK, MOTOR):
            raise InputError(f"elastic joints: encoders: expected {LINK!r} or {MOTOR!r}, got {self.encoders!r}")

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        stiffness = self.each("stiffness", dof)
        if not np.all(stiffness > 0.0):
            raise InputError(f"elastic joints: stiffness: expected positive numbers, got {stiffness.tolist()}")
        self.each("damping", dof), self.each("motor_inertia", dof)

    def each(self, name: str, dof: int) -> Array:
        """
        Return a setting as an array with one value for each joint.

        Parameters
        ----------
        name : str
            "stiffness", "damping" or "motor_inertia".
        dof : int
            Number r of joints.

        Returns
        -------
        ndarray
            Values (r,) in the setting's unit, read-only.

        Raises
        ------
        InputError
            If a value is negative, not finite, or of another shape.

        Examples
        --------
        >>> from adaptctl.simulation.effects import ElasticJoints
        >>> ElasticJoints(stiffness=500.0).each("stiffness", 2).tolist()
        [500.0, 500.0]
        """
        values = at_least_zero(getattr(self, name), dof, f"elastic joints: {name}")
        if not np.isfinite(values).all():
            raise InputError(f"elastic joints: {name}: expected finite numbers, got {getattr(self, name)}")
        return values


SYMMETRY_TOLERANCE = 1e-9
"""of a tensor's largest entry"""


@sent_as_made
@dataclass(frozen=True, eq=False)
class Payload:
    """
    Rigid body held by a link.

    Parameters
    ----------
    mass : float
        Mass in kg.
    center : array_like, optional
        Center of mass (3,) in m in the link's frame. Default: the frame's origin.
    inertia : array_like, optional
        Inertia tensor (3, 3) in kg m^2 about the center of mass, along the frame's axes. Default: zero, a point mass.

    Raises
    ------
    InputError
        If the mass is negative, a shape is wrong, numbers are not finite or too large (1e20), or no rigid body has this
        inertia.

    Examples
    --------
    >>> adaptctl.simulation.effects.Payload(0.5, center=[0.0, 0.0, 0.1]).mass
    0.5
    """

    mass: float
    center: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", real_number(self.mass, "payload: mass"))
        if not 0.0 <= self.mass <= MAX_INERTIAL_PARAMETER:
            raise InputError(f"payload: expected a mass of at least 0 kg, got {self.mass!r}")
        object.__setattr__(self, "center", frozen_array(self.center, (3,), "payload: center"))
        tensor = frozen_array(self.inertia, (3, 3), "payload: inertia")
        _validate_bounded(self.mass, self.center, tensor)
        if tensor.any() and not _is_inertia(tensor):
            raise InputError(
                f"payload: the inertia {tensor.tolist()} is not that of a body: expected a symmetric tensor whose "
                "principal moments satisfy the triangle inequality"
            )
        object.__setattr__(self, "inertia", frozen(0.5 * (tensor + tensor.T)))

    @classmethod
    def of(cls, given: float | Mapping[str, Any] | Payload) -> Payload:
        """
        Make a payload from a mass or a mapping.

        Parameters
        ----------
        given : float, Mapping or Payload
            Mass in kg, or a mapping with `mass` and perhaps `center` and `inertia`; a `Payload` is returned as it is.

        Returns
        -------
        Payload
            The payload.

        Raises
        ------
        InputError
            If no rigid body is described.
        NotFoundError
            If the mapping has an unknown entry.

        Examples
        --------
        >>> adaptctl.simulation.effects.Payload.of({"mass": 0.5, "center": [0.0, 0.0, 0.1]}).mass
        0.5
        """
        if isinstance(given, Payload):
            return given
        if not isinstance(given, Mapping):
            return cls(given)
        known = ("mass", "center", "inertia")
        if unknown := [key for key in given if key not in known]:
            raise NotFoundError(f"payload: unknown entry {unknown[0]!r}; entries: {', '.join(known)}")
        if "mass" not in given:
            raise InputError(f"payload: the mass is missing; entries: {', '.join(known)}")
        return cls(**given)

    def added_to(self, parameters: ArrayLike, link: int) -> Array:
        """
        Add the payload to the parameters of a link.

        Parameters
        ----------
        parameters : array_like
            Inertial and friction parameters (..., P), SI units; ten for each link first: m, mc_x, mc_y, mc_z, I_xx,
            I_xy, I_yy, I_xz, I_yz, I_zz about the frame's origin.
        link : int
            Index of the link.

        Returns
        -------
        ndarray
            Copy (..., P) with the link's ten changed.

        Raises
        ------
        InputError
            If there are no ten parameters of such a link.

        Examples
        --------
        >>> payload = adaptctl.simulation.effects.Payload(0.5)
        >>> heavier = payload.added_to(arm.inertial_parameters, 1)
        >>> round(float((heavier - arm.inertial_parameters).sum()), 3)
        0.5
        """
        loaded = numbers(parameters, "payload: parameters").copy()
        whole_number(link, "payload: link", 0, (loaded.shape[-1] if loaded.ndim else 0) // 10 - 1)
        loaded[..., 10 * link : 10 * link + 10] += from_center_of_mass(self.mass, self.center, self.inertia)
        return loaded


def _validate_bounded(mass: float, center: Array, tensor: Array) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        parameters = from_center_of_mass(mass, center, tensor)
    if not np.abs(parameters).max() <= MAX_INERTIAL_PARAMETER:
        raise InputError(
            f"payload: expected inertial parameters of at most {MAX_INERTIAL_PARAMETER:g}, got a mass of {mass:g} kg, "
            f"a center {center.tolist()} and an inertia {tensor.tolist()}"
        )


def _is_inertia(tensor: Array) -> bool:
    """True if a rigid body can have this tensor (3, 3)."""
    if np.abs(tensor - tensor.T).max() > SYMMETRY_TOLERANCE * np.abs(tensor).max():
        return False
    second_moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    return bool(np.linalg.eigvalsh(second_moments)[0] >= -1e-12 * np.trace(tensor))


@dataclass(frozen=True, eq=False)
class PayloadHeld(LoadEffect):
    """
    Payload that a link holds for a time interval.

    Parameters
    ----------
    payload : Payload, float or Mapping
        Rigid body, a mass in kg, or a mapping as in `Payload.of`.
    start : float, default 0.0
        Time in s at which it is picked up.
    stop : float, default infinity
        Time in s at which it is dropped.
    link : str, optional
        Name of the link, or of a frame on it, such as `tool0`, in whose axes the payload is given. Default: the last
        link that has mass.

    Raises
    ------
    InputError
        If no payload is described, or `start` is not finite and before `stop`.
    NotFoundError
        If a mapping has an unknown entry, or, in a `Plant`, if there is no such link with mass.

    Notes
    -----
    Velocities do not jump at pick-up or release.

    Examples
    --------
    >>> from adaptctl.simulation.effects import PayloadHeld
    >>> carrying = adaptctl.Plant(arm, period, effects=[PayloadHeld(0.5, start=1.0, stop=2.0)])
    >>> [carrying.payload_mass(t) for t in (0.0, 1.5, 2.5)]
    [0.0, 0.5, 0.0]
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

    def on(self, description: Description) -> PayloadHeld:
        """The same payload on the link that carries the one named, such as `tool0`."""
        if self.link is None or self.link in description.body_names:
            return self
        link, pose = place_on_link(description, self.link, "payload", description.body_names)
        body = Payload.of(self.payload)
        tensor = pose.rotation @ body.inertia @ pose.rotation.T
        moved = Payload(body.mass, pose.rotation @ body.center + pose.translation, tensor)
        return replace(self, payload=moved, link=link)

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Check the settings against a plant."""
        self._place(links)

    def mass(self, time: float) -> float:
        """Mass (kg) held at a time."""
        return Payload.of(self.payload).mass if self.start <= time < self.stop else 0.0

    def next_change_time(self, time: float) -> float:
        """Next time (s) of a pick-up or release."""
        return next((change for change in (self.start, self.stop) if time < change), math.inf)

    def loaded(self, parameters: Array, links: tuple[str, ...], time: float) -> Array:
        """Parameters (..., P) with the payload while held."""
        if not self.start <= time < self.stop:
            return parameters
        return Payload.of(self.payload).added_to(parameters, self._place(links))

    def _place(self, links: tuple[str, ...]) -> int:
        if self.link is None:
            return len(links) - 1
        if self.link not in links:
            raise NotFoundError(f"payload: unknown link {self.link!r}; links: {', '.join(links)}")
        return links.index(self.link)
