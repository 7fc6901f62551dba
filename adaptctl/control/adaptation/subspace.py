"""Adaptation along some directions only: a controller that carries fewer numbers than parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.gradient import validate_size
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column

INDEPENDENT = 1e-10
"""Smallest singular value of the directions over their largest."""


@dataclass(frozen=True, eq=False)
class Subspace(AdaptationLaw[NoMemory]):
    """Gradient adaptation of the estimate (k,) of k parameters along the d columns of W only: estimate' = -W diag(gain)
    W'Y' s.

    `directions` is W (k, d), independent columns, d of at most k; `gain` (d,) is positive, in 1/J where W is in the
    parameters' SI units. Y (r, k) is the torque regressor and s (r,) the sliding variable of r joints in rad/s (m/s for
    a prismatic joint). A prime is the transpose, but on estimate a derivative in time. Raises `InputError` for
    directions and gains of other shapes or not finite, dependent directions (a singular value of at most 1e-10 of the
    greatest) and gains that are not positive. With W = K V_d, K (k, P) the model's regrouping matrix of all P
    parameters and V_d (P, d) some right singular vectors of the matrix of total energies, a column a parameter, it
    adapts the essential parameters of a model that is reduced as by Sheu and Walker (1991, section 3.2).

    Guarantees, without disturbance, where the truth is within the initial estimate plus the span of W: as with
    `Gradient`, the tracking error goes to zero and the estimate stays bounded.

    Gives up: the parameters' error beyond the span acts as a disturbance torque, Y times it, which leaves a tracking
    error and, without excitation, a drift.
    """

    tunable = ("gain",)

    gain: Array
    directions: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        shape = np.shape(self.directions)
        if len(shape) != 2 or not 0 < shape[1] <= shape[0]:
            raise InputError(f"subspace: directions: expected shape (k, s) with 0 < s <= k, got {shape}")
        object.__setattr__(self, "directions", frozen_array(self.directions, shape, "subspace: directions"))
        object.__setattr__(self, "gain", frozen_array(self.gain, shape[1:], "subspace: gain"))
        if np.any(self.gain <= 0.0):
            raise InputError("subspace: gain: expected positive numbers, one a direction")
        values = np.linalg.svd(self.directions, compute_uv=False)
        if not values[-1] > INDEPENDENT * values[0]:
            raise InputError("subspace: the directions are not independent: leave out what others combine to")

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` unless the adapted directions have one row for each of the `model`'s k parameters.
        `initial`, the initial estimate (k,), and `period`, the control period in s, are not used."""
        validate_size(self.directions, model, "subspace: directions")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """The estimate (k,) of the `model`'s k parameters after a step along each of the d adapted directions w (k,),
        minus w times its gain times w'g; and the empty internal state. g (k,) is the integral of the gradient Y' s over
        the control period by the trapezium rule, Y' the transpose of the torque regressor Y (r, k) at the period's
        start, s (r,) the sliding variable of r joints, rad/s (m/s if prismatic).

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        gradient = period.gradient(period.integral)
        for step, direction in zip(column(self.gain), map(column, self.directions.T), strict=True):
            estimate = estimate - (step * (direction @ gradient)) * direction
        return estimate, memory

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """The parameters' term x' diag(g)^-1 x / 2, in J, of the adaptation law's Lyapunov function within the adapted
        subspace. x = W^+ (estimate - true) and x' is its transpose, W (k, d) the d adapted directions, W^+ its
        pseudo-inverse and g (d,) their gains. `estimate` (k,) are estimates of the `model`'s k parameters, `true` (k,)
        their true values, both in SI units. An error orthogonal to the columns of W does not count. Raises `ValueError`
        for columns of different lengths."""
        error = estimate - true
        along = Column(column(row) @ error for row in np.linalg.pinv(self.directions))
        return 0.5 * (along @ Column(x / g for x, g in zip(along, column(self.gain), strict=True)))
