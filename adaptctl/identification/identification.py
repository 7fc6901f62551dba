"""Identified robots: their parameters with deviations, and all that these come from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.caching import cached_property
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability import EssentialSpace, ReducedModel
from adaptctl.identification.choice import Choice
from adaptctl.identification.drives_file import Drives
from adaptctl.identification.filtered_dynamics import SmoothMotion
from adaptctl.identification.preparation import PreparationStep
from adaptctl.identification.uncertainty import Combination, unexcited
from adaptctl.identification.validation import Validation


@dataclass(frozen=True, eq=False)
class Identification:
    """
    Identified robot: its fundamental parameters, their standard deviations and a validation.

    `identify` makes it; nothing is checked at construction.

    Parameters
    ----------
    mechanism : Mechanism
        Robot with the identified, physically consistent parameters and r joints.
    model : ReducedModel
        Its model in the k fundamental parameters.
    deviations : numpy.ndarray
        Standard deviations (k,) in SI units, by the block jackknife and by what the prior leaves open.
    nominal_deviations : numpy.ndarray
        Standard deviations (k,) in SI units for white torque residuals, which flatter.
    load : numpy.ndarray
        Coefficients (r,) of load-dependent friction without a unit, zero where it was not chosen.
    validation : Validation
        Measured and predicted torques on rows that the judged fit has not seen.
    alternatives : dict of str to Validation
        Validations of simpler models on the same rows.
    choice : Choice
        Settings of the fit, and what was tried.
    steps : tuple of PreparationStep
        Steps of the logs' preparation.
    warnings : tuple of str
        Remarks on logs and prior.
    misfit_ratio : float
        Ratio of the weighted residuals' root mean square to that of plain least squares.
    space : EssentialSpace
        Essential space, with the logs' motion as its states.
    components : int
        Number of essential components that give the motion's energy to 1 %.
    combinations : tuple of Combination
        Directions (k) of the parameters with the strength of their excitation, the weakest first.
    motions : tuple of SmoothMotion
        Smoothed motions of the logs.
    drives : Drives
        Drives with the torque constants used.

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
    load: Array
    validation: Validation
    alternatives: dict[str, Validation]
    choice: Choice
    steps: tuple[PreparationStep, ...]
    warnings: tuple[str, ...]
    misfit_ratio: float
    space: EssentialSpace
    components: int
    combinations: tuple[Combination, ...]
    motions: tuple[SmoothMotion, ...]
    drives: Drives

    def __repr__(self) -> str:
        error = f"torque error {self.validation.relative_error:.2%}"
        return f"<Identification of {self.mechanism.name!r}: {len(self.names)} parameters, {error}>"

    @property
    def estimate(self) -> Array:
        """Identified fundamental parameters (k,) in SI units: an initial estimate for an adaptive controller."""
        return self.model.fundamental_parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the k fundamental parameters, such as ``link2.mc_x``, in the order of `estimate`."""
        return self.model.names

    @property
    def inflation(self) -> float:
        """Median ratio of the standard deviations to those for white residuals."""
        known = self.nominal_deviations > 0.0
        return float(np.median(self.deviations[known] / self.nominal_deviations[known])) if known.any() else 1.0

    @cached_property
    def prior_ranges(self) -> Array:
        """Expected distances (k,) from the estimate in SI units: two deviations, at least a twentieth of its size."""
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
        Entries are the scale times the squares of `prior_ranges`, or of 1e-9 of the greatest where a range is smaller.
        """
        gain_scale = positive_number(gain_scale, "adaptation gain: rate: expected a positive number")
        return gain_scale * np.maximum(self.prior_ranges, 1e-9 * np.max(self.prior_ranges)) ** 2

    @property
    def unexcited(self) -> list[Combination]:
        """Combinations of parameters that the logs hardly excite: those of strength below 3 times `inflation`."""
        return unexcited(self.combinations, self.inflation)
