"""Identified robots: their parameters with deviations, and all that these come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.caching import cached_property
from adaptctl.description.drive import MAY_BE_NEGATIVE, DriveParameter
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace, ReducedModel
from adaptctl.identification.choice import Choice
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.held_out import HeldOut
from adaptctl.identification.hypotheses import TriedHypothesis
from adaptctl.identification.identified_payload import IdentifiedPayload
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.uncertainty import INTERVAL, Combination, unexcited
from adaptctl.identification.validation import Validation


@dataclass(frozen=True, eq=False)
class Identification:
    """
    Identified robot: its base parameters, their standard deviations and a validation.

    `identify` makes it; nothing is checked at construction.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with the identified, physically consistent parameters and r joints.
    model : ReducedModel
        Its model in the k base parameters.
    deviations : numpy.ndarray
        Standard deviations (k,) of the base parameters in SI units, from a block jackknife, plus an uncertainty where
        the prior decides.
    nominal_deviations : numpy.ndarray
        Standard deviations (k,) in SI units if torque residuals were white, which is mostly too optimistic.
    validation : Validation
        Torques measured and predicted by `mechanism` on rows that were not used for the fit, below 25 Hz.
    validation_in_band : Validation
        Likewise in the band of the motion.
    held_out : HeldOut
        These rows, on which its `judged` validates any mechanism of these joints, such as a written file's.
    alternatives : dict of str to Validation
        Validations of simpler models on the same rows.
    choice : Choice
        Settings of the fit, and the trials by which they were chosen.
    steps : tuple of PreparationStep
        Steps of the logs' preparation, such as resampling.
    warnings : tuple of str
        Warnings about logs and prior, as texts.
    misfit_ratio : float
        Ratio, without unit, of the root mean square of weighted residuals to that of unconstrained least squares.
    residual : float
        Height of the fit's objective over its minimum, relative to the squares it explains; round-off leaves 1e-12.
    space : EssentialSpace
        Essential space, with the logs' motion as its states.
    components : int
        Number of essential components that give the motion's energy within 1 %.
    combinations : tuple of Combination
        Combinations of the k base parameters with the strength of their excitation, the weakest first.
    motions : tuple of SmoothMotion
        Smoothed motions of the logs.
    drives : Drives
        Transmission, with the torque constants that were used.
    hypotheses : tuple of TriedHypothesis, optional
        Hypotheses about what the logs' columns mean, the log as it is first, with their errors. None by default.
    payloads : tuple of IdentifiedPayload, optional
        Bodies carried in a log of which mass, centre or inertia was identified. None by default.
    interval_deviations : numpy.ndarray, optional
        Deviations (k,) in SI units for the intervals: those of the logs alone where the prior decides, infinite where
        these tell nothing. Default: `deviations`.

    Examples
    --------
    >>> time = np.arange(0.0, 8.0, 0.01)
    >>> positions, *rates = reference(time)
    >>> rows = np.column_stack([time, positions, arm.inverse_dynamics(positions, *rates)])
    >>> names = "time,position.shoulder,position.elbow,torque.shoulder,torque.elbow"
    >>> np.savetxt(tmp / "log.csv", rows, delimiter=",", header=names, comments="")
    >>> units = {"time": "s", "position": "rad", "torque": "N m"}
    >>> found = adaptctl.identify(tmp / "log.csv", arm, units=units, friction="viscous", cutoff=12.5, prior_weight=1.0)
    >>> found.names[0], found.estimate.shape == found.deviations.shape == found.adaptation_gain().shape
    ('upper.mc_x', True)
    """

    mechanism: Mechanism
    model: ReducedModel
    deviations: Array
    nominal_deviations: Array
    validation: Validation
    validation_in_band: Validation
    held_out: HeldOut
    alternatives: dict[str, Validation]
    choice: Choice
    steps: tuple[PreparationStep, ...]
    warnings: tuple[str, ...]
    misfit_ratio: float
    residual: float
    space: EssentialSpace
    components: int
    combinations: tuple[Combination, ...]
    motions: tuple[SmoothMotion, ...]
    drives: Drives
    hypotheses: tuple[TriedHypothesis, ...] = ()
    payloads: tuple[IdentifiedPayload, ...] = ()
    interval_deviations: Array | None = None

    def __repr__(self) -> str:
        error = f"torque error {self.validation.relative_error:.2%}"
        return f"<Identification of {self.mechanism.name!r}: {len(self.names)} parameters, {error}>"

    @property
    def estimate(self) -> Array:
        """Identified base parameters (k,) in SI units: an initial estimate for an adaptive controller."""
        return self.model.fundamental_parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k base parameters, such as ``link2.mc_x``, in the order of `estimate`."""
        return self.model.names

    @property
    def intervals(self) -> Array:
        """Intervals (k, 2) of 95 %, from 0 on where negative values cannot be; NaN where logs tell nothing."""
        from_zero = np.array(
            [_is_positive(name, row) for name, row in zip(self.names, self.model.regrouping, strict=True)]
        )
        own = self.interval_deviations
        half = INTERVAL * (self.deviations if own is None else own)
        lower, upper = self.estimate - half, self.estimate + half
        found = np.column_stack([np.where(from_zero, np.maximum(lower, 0.0), lower), upper])
        found[~np.isfinite(half)] = np.nan
        return found

    @property
    def deviation_ratio(self) -> float:
        """Median ratio of `deviations` to `nominal_deviations`: 1 if torque residuals are white."""
        known = self.nominal_deviations > 0.0
        return float(np.median(self.deviations[known] / self.nominal_deviations[known])) if known.any() else 1.0

    @cached_property
    def prior_ranges(self) -> Array:
        """Expected errors (k,) of the estimate in SI units: two standard deviations, at least a twentieth of it."""
        return np.maximum(2.0 * self.deviations, 0.05 * np.abs(self.estimate))

    def adaptation_gain(self, gain_scale: float = 0.6) -> Array:
        """
        Return a gain matrix for an adaptive controller that starts from the estimate.

        Parameters
        ----------
        gain_scale : float, default 0.6
            Scale in 1/J; the larger, the faster the adaptation.

        Returns
        -------
        numpy.ndarray
            Diagonal (k,) of the gain matrix in units of the parameters squared per J.

        Raises
        ------
        InputError
            If the scale is not positive and finite.

        Notes
        -----
        Entries are the scale times the squares of `prior_ranges`, each range at least 1e-9 of the largest.
        """
        gain_scale = positive_number(gain_scale, "adaptation gain: rate: expected a positive number")
        return gain_scale * np.maximum(self.prior_ranges, 1e-9 * np.max(self.prior_ranges)) ** 2

    @property
    def unexcited(self) -> list[Combination]:
        """Combinations of base parameters that the logs hardly excite: strength below 3 times `deviation_ratio`."""
        return unexcited(self.combinations, self.deviation_ratio)


def _is_positive(name: str, regrouping: Array) -> bool:
    """True for a drive's own parameter that is never negative."""
    kinds = {kind.value for kind in DriveParameter if kind not in MAY_BE_NEGATIVE}
    return name.rsplit(".", 1)[1] in kinds and np.count_nonzero(regrouping) == 1
