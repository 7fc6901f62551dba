"""Measured against predicted torques, on rows that no fit has seen."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, whole_number
from adaptctl.caching import cached_property
from adaptctl.description.drive import DriveParameter
from adaptctl.errors import InputError
from adaptctl.identification.fit import Fit, FitSettings, LogEvidence
from adaptctl.identification.friction_model import SIMPLE_FRICTION, FrictionModel
from adaptctl.identification.least_squares import least_squares, weighted_least_squares
from adaptctl.identification.normal_equations import NormalEquations
from adaptctl.stages import stage


@dataclass(frozen=True, eq=False)
class Validation:
    """
    Measured and predicted torques on all rows of a log, standstill included.

    Parameters
    ----------
    origin : str
        Origin of the rows in words, for reports.
    cutoff : float
        Cut-off in Hz of the low-pass filter that both torques went through.
    time : numpy.ndarray
        Times (n,) in s, as in the log.
    measured : numpy.ndarray
        Measured torques (n, r) in N m, or forces in N for a prismatic joint.
    predicted : numpy.ndarray
        Torques (n, r) in N m (N) predicted from the measured motion alone.
    units : tuple of str, optional
        Units of the joints' torques, "N m" or "N", which are never averaged; "N m" by default.
    left_out : tuple of int, optional
        Indices of joints that are not judged, because the log contradicts physics at them; none by default.

    Raises
    ------
    InputError
        If shapes differ, or there are no rows or joints.

    Examples
    --------
    >>> from adaptctl.identification import Validation
    >>> measured = np.array([[1.0], [2.0]])
    >>> validation = Validation("a test", 25.0, np.array([0.0, 0.1]), measured, 1.1 * measured)
    >>> round(validation.relative_error, 3)
    0.1
    """

    origin: str
    cutoff: float
    time: Array
    measured: Array
    predicted: Array
    units: tuple[str, ...] = ()
    left_out: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        time, measured, predicted = map(np.shape, (self.time, self.measured, self.predicted))
        if len(measured) != 2 or 0 in measured or predicted != measured or time != measured[:1]:
            raise InputError(
                "validation: expected times (n,) and measured and predicted torques of one shape (n, r), n and r at "
                f"least 1, got {time}, {measured} and {predicted}"
            )

    def __repr__(self) -> str:
        return f"<Validation on {len(self.time)} rows: torque error {self.relative_error:.2%}>"

    @property
    def rms_error(self) -> float:
        """Root mean square torque error of all joints in N m; of forces in N if there are no others."""
        return next(iter(self.rms_errors.values()))

    @property
    def rms_errors(self) -> dict[str, float]:
        """Root mean square errors of the joints that are judged, by unit, "N m" first."""
        squares = np.mean(np.square(self.error), axis=0)
        return {unit: float(np.sqrt(np.mean(squares[joints]))) for unit, joints in self._kinds.items()}

    @property
    def relative_errors(self) -> dict[str, float]:
        """Errors divided by the measured torques, both root mean squares of all joints of a unit."""
        error, size = (np.square(part).sum(axis=0) for part in (self.error, self.measured))
        pairs = ((unit, error[joints].sum(), size[joints].sum()) for unit, joints in self._kinds.items())
        return {unit: float(_relative(np.sqrt(off), np.sqrt(whole))) for unit, off, whole in pairs}

    @property
    def relative_error(self) -> float:
        """Error of all joints of the unit of `rms_error`, divided by their measured torque."""
        return next(iter(self.relative_errors.values()))

    @property
    def rms_measured(self) -> float:
        """Root mean square of all measured torques in N m (N)."""
        return float(np.sqrt(np.mean(np.square(self.measured))))

    @property
    def _kinds(self) -> dict[str, list[int]]:
        """Joints that are judged, by unit."""
        r = self.measured.shape[1]
        units = self.units or ("N m",) * r
        judged = [j for j in range(r) if j not in self.left_out] or list(range(r))
        found = {unit: [j for j in judged if units[j] == unit] for unit in sorted(set(units), reverse=True)}
        return {unit: joints for unit, joints in found.items() if joints}

    @property
    def joint_rms_errors(self) -> Array:
        """Root mean square torque error (r,) of each joint in N m (N for a prismatic joint)."""
        return np.sqrt(np.mean(np.square(self.error), axis=0))

    @property
    def joint_relative_errors(self) -> Array:
        """Torque error of each joint (r,) divided by its measured torque, both root mean square."""
        return _relative(np.linalg.norm(self.error, axis=0), np.linalg.norm(self.measured, axis=0))

    @cached_property
    def error(self) -> Array:
        """Torque errors (n, r), predicted minus measured, in N m (N for a prismatic joint)."""
        return self.predicted - self.measured

    def autocorrelation(self, lags: int = 50) -> Array:
        """
        Compute the autocorrelation of the torque errors, their means subtracted.

        Parameters
        ----------
        lags : int, default 50
            Largest lag, a number of rows of at least 0; values above n - 1 count as n - 1.

        Returns
        -------
        numpy.ndarray
            Autocorrelation (lags + 1, r) without unit: 1 at lag 0, and about 0 at other lags if errors are white.

        Raises
        ------
        InputError
            If the number of lags is no whole number of at least 0.

        Examples
        --------
        >>> from adaptctl.identification import Validation
        >>> noise = rng.normal(size=(200, 1))
        >>> validation = Validation("a test", 25.0, np.arange(200.0), noise, np.zeros((200, 1)))
        >>> validation.autocorrelation(3).shape
        (4, 1)
        """
        count = min(whole_number(lags, "lags", 0, sys.maxsize), len(self.error) - 1)
        centred = np.where(np.ptp(self.error, axis=0) > 0.0, self.error - self.error.mean(axis=0), 0.0)
        whole = np.square(centred).sum(axis=0)
        whole[whole == 0.0] = 1.0
        later = [(centred[: len(centred) - k] * centred[k:]).sum(axis=0) / whole for k in range(1, count + 1)]
        return np.stack([np.ones(len(whole)), *later])


def _relative(error: ArrayLike, size: ArrayLike) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.equal(error, 0.0), 0.0, np.divide(error, size))


class Alternative(NamedTuple):
    """Estimate by a simpler model: its name, and parameters (P,) in SI units."""

    name: str
    x: Array


def alternatives(evidence: LogEvidence, fit: Fit) -> list[Alternative]:
    """Estimates by simpler models on all blocks of the evidence that a fit was made from."""
    settings, every = fit.settings, range(evidence.blocks)
    simple = replace(settings, friction=SIMPLE_FRICTION)
    return [
        Alternative("weighted least squares, the same friction", evidence.ordinary(settings, every)),
        Alternative(f"weighted least squares, {SIMPLE_FRICTION.words}", evidence.ordinary(simple, every)),
        Alternative("links of the robot file, friction and rotors fitted", _drives_alone(evidence, fit, every, True)),
        Alternative("friction and rotors only", _drives_alone(evidence, fit, every, False)),
    ]


def _drives_alone(evidence: LogEvidence, fit: Fit, blocks: Sequence[int], links: bool) -> Array:
    """Links as the prior has them, or none."""
    A, b = evidence.equations(fit.settings, blocks).whitened(fit.deviations)
    tens = evidence.prior.tens.ravel()
    known = np.zeros(len(b))
    known[: tens.size] = tens if links else 0.0
    kept = np.flatnonzero(fit.settings.columns(evidence.mechanism))
    return known + least_squares(A, b - A @ known, kept[kept >= tens.size])


# Power of friction over the product of root mean square torque and speed, below which a sign must be wrong.
MIN_FRICTION_POWER = -0.3
# Squares without a joint's friction over those with it, from where on friction is seen.
MIN_FRICTION_EFFECT = 1.5
# Share of the torques that least squares may leave of its own rows.
MAX_UNEXPLAINED_SHARE = 0.5
# Mean of positions over their deviation, below which they swing about 0.
ABOUT_ZERO = 0.1


@stage("checking that the log is of this robot")
def validate_plausible(
    evidence: LogEvidence, source: str, cutoff: float, springs: tuple[DriveParameter, ...] = ()
) -> None:
    """Raise `InputError` for logs that are not their robot's: driving friction, or residuals above half the torques."""
    equations, x, deviations, left = _freely_fitted(evidence, FrictionModel(), cutoff)
    if left > MAX_UNEXPLAINED_SHARE and springs:
        strong = FrictionModel().also((DriveParameter.OFFSET, *springs))
        equations, x, deviations, left = _freely_fitted(evidence, strong, cutoff)
    values = dict(zip(evidence.mechanism.parameter_names, x.tolist(), strict=False))
    rows = evidence.rows[cutoff].moved
    for j, joint in enumerate(evidence.mechanism.primary_joints):
        v, torque = rows.velocity[:, j], rows.torque[:, j]
        rubbing = values[f"{joint.name}.viscous"] * v + values[f"{joint.name}.coulomb"] * np.sign(v)
        drives = np.mean(rubbing * v) < MIN_FRICTION_POWER * np.sqrt(np.mean(v**2) * np.mean(torque**2))
        if drives and _is_needed(evidence, equations, f"{joint.name}.", deviations):
            raise InputError(
                f"{source}: the friction estimated for joint {joint.name!r} is negative; check the signs of its "
                "gear ratio, torque column and position column"
            )
    if left > MAX_UNEXPLAINED_SHARE:
        motor = evidence.drives.motors[int(np.argmax(equations.misfit(x)))]
        raise InputError(
            f"{source}: the equations of {evidence.mechanism.name} do not explain {left:.0%} of the torques; "
            f"check that the log is this robot's, transmission, units and columns, such as {motor.position!r} and "
            f"{motor.torque!r}, of which most is left, and that positions are no velocities{_swing_words(evidence)}; "
            "with noisy encoders, add --instrumental-variables"
        )


def _swing_words(evidence: LogEvidence) -> str:
    """Words on positions that all swing about 0."""
    positions = np.concatenate([motion.position for motion in evidence.motions])
    about = np.all(np.abs(positions.mean(axis=0)) < ABOUT_ZERO * positions.std(axis=0))
    return " (all swing about 0, as velocities do)" if about else ""


def _freely_fitted(
    evidence: LogEvidence, terms: FrictionModel, cutoff: float
) -> tuple[NormalEquations, Array, Array, float]:
    """Equations, weighted least squares, deviations of the torques, and the share of these that is left."""
    settings = FitSettings(terms, 1.0, cutoff)
    equations = evidence.equations(settings, range(evidence.blocks))
    x, deviations = weighted_least_squares(equations, evidence.independent(settings))
    return equations, x, deviations, float(np.sqrt(equations.misfit(x).sum() / equations.square.sum()))


def _is_needed(evidence: LogEvidence, equations: NormalEquations, joint: str, deviations: Array) -> bool:
    """True if the rows are fitted much worse without a joint's friction."""
    names = evidence.mechanism.parameter_names
    columns = evidence.independent(FitSettings(FrictionModel(), 1.0, 1.0))
    energetic = evidence.mechanism.num_energy_parameters
    others = np.array([c for c in columns.tolist() if c < energetic or not names[c].startswith(joint)])
    whitened, weight = equations.whitened(deviations), 1.0 / deviations**2
    best, without = (equations.misfit(least_squares(*whitened, kept)) @ weight for kept in (columns, others))
    return bool(without > MIN_FRICTION_EFFECT * best)
