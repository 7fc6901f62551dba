"""Identified robots: their parameters, with deviations, and all that these come from."""

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
    """Identified robot: its k fundamental (base) parameters as its logs show them, with their standard deviations and a
    validation.

    `mechanism` has the identified parameters, physically consistent links, and drives coupled as in the robot's
    transmission; `model` is its reduced model on the fundamental parameters. `deviations` (k,), SI units, in the order
    of `names`, are standard deviations by the block jackknife and what the prior (first guess of the links) leaves
    open, `nominal_deviations` (k,) those for white (uncorrelated) torque residuals. `load` (r,), without a unit, are
    the coefficients of load-dependent friction of r drives, its torque over the rigid torque (without friction), zero
    where it was not chosen. `validation` compares torques on rows (filtered equations) that the fit which it judges has
    not seen, `alternatives` are simpler models' validations on the same rows, by name; `choice` is the choice of the
    fit's settings (friction, low-pass cut-off, prior's weight), `steps` are those of the logs' preparation and
    `warnings` texts on logs and prior.

    `misfit_ratio`, without a unit, is the ratio of the root mean square of the fitted rows' torque residuals, each
    divided by its joint's standard deviation, to that of plain least squares. `space` is the essential space
    (directions of the inertial parameters that change energies and torques) with the logs' motion as its states,
    `components` the number of its components that give the motion's energy to an error of 1 %. `combinations` are k
    directions of the fundamental parameters in words, each with its `strength`, without a unit (the plausible range by
    kind of parameter, `PriorRanges`, over the deviation that the logs leave), the weakest first. `motions` are the
    logs' smoothed motions, and `drives` those used. Made by `identify`; nothing is checked at construction.
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

    @property
    def estimate(self) -> Array:
        """The k identified fundamental (base) parameters (k,), SI units, in the order of the property `names`: an
        initial estimate for an adaptive controller."""
        return self.model.fundamental_parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names, k of them, of the identified fundamental (base) parameters, such as ``link2.mc_x``, in the order of
        the property `estimate`."""
        return self.model.names

    @property
    def inflation(self) -> float:
        """Median ratio, without a unit, over the identified fundamental (base) parameters, of their standard deviations
        to those that white (uncorrelated) torque residuals would give; 1 where the latter are all zero."""
        known = self.nominal_deviations > 0.0
        return float(np.median(self.deviations[known] / self.nominal_deviations[known])) if known.any() else 1.0

    @cached_property
    def prior_ranges(self) -> Array:
        """Prior ranges (k,) of the k identified fundamental (base) parameters for an adaptive controller, SI units: the
        greatest expected distances of the true values from the estimate. Each is two standard deviations, and at least
        a twentieth of the estimate's magnitude."""
        return np.maximum(2.0 * self.deviations, 0.05 * np.abs(self.estimate))

    def adaptation_gain(self, gain_scale: float = 0.6) -> Array:
        """Diagonal (k,) of an adaptive controller's gain matrix Gamma for k fundamental (base) parameters, in units of
        the parameters squared per J. Gamma is that of d(estimate)/dt = -Gamma Y^T s, with the torque regressor Y (r,
        k), its transpose Y^T, and the sliding variable s (r,) of r joints. An entry is `rate` (1/J, 0.6 by default;
        larger adapts faster) times the square of the parameter's prior range, this object's `prior_ranges`, or of 1e-9
        times the greatest of these where the range is smaller. Raises `InputError` for a rate that is not positive and
        finite."""
        gain_scale = positive_number(gain_scale, "adaptation gain: rate: expected a positive number")
        return gain_scale * np.maximum(self.prior_ranges, 1e-9 * np.max(self.prior_ranges)) ** 2

    @property
    def unexcited(self) -> list[Combination]:
        """Combinations of the fundamental (base) parameters that the logs hardly excite, a list of `Combination`, the
        least excited first. They are those with a `strength` below 3 times `inflation`, the property that is the ratio
        of the standard deviations to those for white (uncorrelated) residuals. `strength`, without a unit, is the ratio
        of the plausible range before the logs, by kind of parameter (`PriorRanges`), to the standard deviation after
        them for white residuals; `words` describes the combination."""
        return unexcited(self.combinations, self.inflation)
