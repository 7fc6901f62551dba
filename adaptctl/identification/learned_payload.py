"""Body that an arm carries, from what a controller learned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array
from adaptctl.description.inertia import PARAMETERS, from_center_of_mass
from adaptctl.identification.consistent_estimate import consistent_estimate
from adaptctl.identification.entropic import EntropicPrior
from adaptctl.identification.identified_payload import IdentifiedPayload
from adaptctl.identification.loaded_equations import BALL, UNKNOWN_MASS
from adaptctl.identification.loaded_fit import PRIOR_WEIGHT
from adaptctl.identification.uncertainty import INTERVAL

TEN = len(PARAMETERS)
# Share of the mass, m of the centre and m^2 of the inertia over the mass within which an interval of 95 % tells them.
TOLD, TOLD_LENGTH, TOLD_SQUARE = 1.0 / 3.0, 0.03, 0.003
# kg at least of the prior's body.
LEAST_MASS = 0.05
# kg within which a mass is told whatever its size.
TOLD_MASS = 0.1
# Eigenvalue of the information, relative to the prior's, from which on a direction is known.
KNOWN = 1.0


def learned_payload(controller: Any, state: Any, source: str = "the run") -> IdentifiedPayload | None:
    """
    Return the body that an arm carries beyond its controller's initial estimate.

    Parameters
    ----------
    controller : Controller
        `SlotineLi` with a law that has a covariance, alone or in a safety filter.
    state : tuple
        Its state for one arm after the motion.
    source : str, default "the run"
        Name for the log.

    Returns
    -------
    IdentifiedPayload or None
        Body in the frame of the last link. None if the law keeps no covariance, nothing was learned, the mechanism has
        loops or constraints, or the arm carries less than it was told of.

    Notes
    -----
    The change of the estimate is fitted by ten columns of the last link and by rotors and friction, weighted by what
    the law remembers; of these, ten that belong to a body are the estimate. Other links count as known. Deviations are
    those of the law's weights, or more if the fit leaves more.

    Examples
    --------
    >>> from adaptctl.identification import learned_payload
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, adaptctl.control.GuardedLearning(np.full(6, 0.1)))
    >>> learned_payload(controller, controller.init(p, v)) is None  # nothing was learned
    True
    """
    while hasattr(controller, "inner"):
        controller, state = controller.inner, state.inner
    fit = _Fit.of(controller)
    if fit is None or not np.isfinite(state.estimate).all():
        return None
    law, memory = controller.adaptation_law, state.law_state
    information = np.linalg.inv(law.covariance(memory) / np.outer(fit.scale, fit.scale)) - np.eye(len(fit.scale))
    watch = getattr(memory, "watch", None)
    trusted = state.estimate if watch is None or watch.alarm[0] <= 0.0 else watch.trusted
    return fit.body(information, (trusted - np.asarray(controller.initial)) / fit.scale, source)


def mass_of_change(controller: Any, p: ArrayLike, v: ArrayLike, a: ArrayLike, period: float) -> Array | None:
    """
    Return the payload's mass by the change of the estimate.

    Parameters
    ----------
    controller : Controller
        Controller as for `learned_payload`.
    p, v, a : array_like
        Positions, velocities and accelerations (n, r) of the motion in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
    period : float
        Time in s between them.

    Returns
    -------
    ndarray or None
        Row (k,) in kg per parameter, times which a change is the mass. None if the motion does not tell it.

    Examples
    --------
    >>> from adaptctl.identification import mass_of_change
    >>> controller = adaptctl.SlotineLi(model, 5.0, 4.0, adaptctl.control.GuardedLearning(np.full(6, 0.1)))
    >>> mass_of_change(controller, np.zeros((9, 2)), np.zeros((9, 2)), np.zeros((9, 2)), 0.1) is None  # at rest
    True
    """
    while hasattr(controller, "inner"):
        controller = controller.inner
    fit = _Fit.of(controller)
    if fit is None:
        return None
    weights = np.broadcast_to(controller.adaptation_law.prediction_weight, np.shape(p)[-1])
    rows = controller.model.torque_regressor(p, v, a) * fit.scale
    information = period * np.einsum("nri,r,nrj->ij", rows, weights, rows)
    normal, right = fit.equations(information)
    covariance = np.linalg.inv(normal + _prior(UNKNOWN_MASS).curvature(_ball(UNKNOWN_MASS), PRIOR_WEIGHT))
    if INTERVAL * covariance[0, 0] ** 0.5 > TOLD_MASS:
        return None
    return np.asarray(covariance[0] @ right / fit.scale)


def told(payload: IdentifiedPayload) -> NDArray[np.bool_]:
    """
    Return which numbers of a payload its log tells.

    Parameters
    ----------
    payload : IdentifiedPayload
        Payload.

    Returns
    -------
    ndarray
        Mask (3,) of mass, centre and inertia: those whose intervals of 95 % are within a third of the mass or 0.1 kg,
        30 mm, and 0.003 m^2 of the mass.

    Examples
    --------
    >>> from adaptctl.description.inertia import from_center_of_mass
    >>> from adaptctl.identification import IdentifiedPayload, told
    >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
    >>> told(IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10))).tolist()
    [True, True, False]
    """
    off = INTERVAL * payload.deviations
    centre, inertia = float(off[1:4].max()), float(off[4:].max())
    mass = bool(off[0] <= max(TOLD * payload.mass, TOLD_MASS))
    return np.array([mass, mass and centre <= TOLD_LENGTH, mass and inertia <= TOLD_SQUARE * payload.mass])


def told_numbers(payload: IdentifiedPayload) -> dict[str, Any]:
    """
    Return what `as_builtins` does, with None for numbers that the log does not tell.

    Parameters
    ----------
    payload : IdentifiedPayload
        Payload.

    Returns
    -------
    dict
        Numbers in JSON's types.

    Examples
    --------
    >>> from adaptctl.description.inertia import from_center_of_mass
    >>> from adaptctl.identification import IdentifiedPayload, told_numbers
    >>> ten = from_center_of_mass(2.0, [0.0, 0.0, 0.1], 0.01 * np.eye(3))
    >>> numbers = told_numbers(IdentifiedPayload("loaded.csv", "tool0", ten, 1e-4 * np.eye(10)))
    >>> numbers["center_of_mass"], numbers["inertia"]
    ([0.0, 0.0, 0.1], None)
    """
    numbers, (mass, centre, inertia) = payload.as_builtins(), told(payload).tolist()
    names = {"mass": mass, "center_of_mass": centre, "inertia": inertia, "inertia_six": inertia}
    deviations = numbers["deviations"]
    deviations |= {"inertia_at_center": deviations["inertia_at_center"] if inertia else None}
    for where in (numbers, deviations):
        where.update({name: None for name, is_told in names.items() if name in where and not is_told})
    return numbers


@dataclass(frozen=True, eq=False)
class _Fit:
    """Columns of the last link (k, 10) and of rotors and friction (k, d), in units of the gain's roots (k,)."""

    link: str
    scale: Array
    own: Array
    drives: Array

    @classmethod
    def of(cls, controller: Any) -> Self | None:
        """Columns of a controller whose law remembers; None for others."""
        law: Any = getattr(controller, "adaptation_law", None)
        model = getattr(controller, "model", None)
        if model is None or not hasattr(law, "covariance") or not model.mechanism.is_plain_tree:
            return None
        scale, names = np.sqrt(np.asarray(law.gain)), model.mechanism.description.body_names
        columns = np.asarray(model.regrouping) / scale[:, None]
        tens = TEN * len(names)
        return cls(names[-1], scale, columns[:, tens - TEN : tens], columns[:, tens:])

    def equations(self, information: Array) -> tuple[Array, Array]:
        """Normal matrix (10, 10) of the ten, with the rest free, and what makes moments (10, k) of changes."""
        free = self.drives.T @ information
        taken = (self.own.T @ free.T) @ np.linalg.pinv(free @ self.drives, rcond=1e-10, hermitian=True)
        right = self.own.T @ information - taken @ free
        return right @ self.own, right

    def body(self, information: Array, change: Array, source: str) -> IdentifiedPayload | None:
        """Body that a change (k,) shows; None where nothing is known, or it is of negative mass."""
        normal, right = self.equations(information)
        if np.linalg.eigvalsh(information)[-1] < KNOWN:
            return None
        raw = np.linalg.inv(normal + _prior(UNKNOWN_MASS).curvature(_ball(UNKNOWN_MASS), PRIOR_WEIGHT))
        mass = float(raw[0] @ right @ change)
        if mass < -INTERVAL * raw[0, 0] ** 0.5:
            return None
        prior = _prior(max(mass, LEAST_MASS))
        ten = consistent_estimate(normal, right @ change, prior, PRIOR_WEIGHT)
        spread = self._left(information, change) * np.linalg.inv(normal + prior.curvature(ten, PRIOR_WEIGHT))
        return IdentifiedPayload(source, self.link, ten, np.asarray(spread, dtype=np.float64))

    def _left(self, information: Array, change: Array) -> float:
        """Ratio of what the fit leaves to what the weights let expect; at least 1."""
        columns = np.concatenate([self.own, self.drives], axis=1)
        moment = columns.T @ information @ change
        found = np.linalg.pinv(columns.T @ information @ columns, rcond=1e-10, hermitian=True) @ moment
        known = int((np.linalg.eigvalsh(information) > KNOWN).sum())
        left = float(change @ information @ change - found @ moment)
        return max(1.0, left / max(known - columns.shape[1], 1))


def _ball(mass: float) -> Array:
    return from_center_of_mass(mass, np.zeros(3), 0.4 * mass * BALL**2 * np.eye(3))


def _prior(mass: float) -> EntropicPrior:
    return EntropicPrior(_ball(mass)[None], np.empty(0, dtype=np.int64), np.empty(0))
