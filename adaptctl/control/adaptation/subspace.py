"""Gradient adaptation along directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.control.adaptation.gradient import validate_size
from adaptctl.control.adaptation.law import AdaptationLaw, NoMemory, Period
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column

MIN_SINGULAR_VALUE_RATIO = 1e-10  # of the directions, smallest over largest


@dataclass(frozen=True, eq=False)
class Subspace(AdaptationLaw[NoMemory]):
    r"""
    Gradient adaptation along given directions of the parameters.

    Parameters
    ----------
    gain : array_like
        Positive gains (d,) of the directions, in 1/J for directions in SI units.
    directions : array_like
        Matrix W (k, d), whose d independent columns are directions in the space of the k parameters.

    Raises
    ------
    InputError
        If a shape is wrong, a gain is not positive, or the directions are dependent (singular values to 1e-10).

    Notes
    -----
    .. math:: \dot{\hat\beta}=-W\operatorname{diag}(g)W^\top Y^\top s.

    Essential parameters [1]_ are such directions.

    References
    ----------
    .. [1] Sheu and Walker, Int. J. Robotics Research, 1991.

    Examples
    --------
    >>> adaptctl.control.Subspace(gain=[0.1, 0.1], directions=np.eye(6)[:, :2]).directions.shape
    (6, 2)
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
            raise InputError("subspace: gain: expected positive numbers, one per direction")
        values = np.linalg.svd(self.directions, compute_uv=False)
        if not values[-1] > MIN_SINGULAR_VALUE_RATIO * values[0]:
            raise InputError("subspace: the directions are linearly dependent: remove the dependent ones")

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if the directions do not fit the model.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters and r primary joints.
        initial : ndarray
            Initial estimate (k,) in SI units.
        control_period : float
            Control period in s.

        Raises
        ------
        InputError
            If `directions` has not one row for each parameter.
        """
        validate_size(self.directions, model, "subspace: directions")

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: NoMemory) -> tuple[Column, NoMemory]:
        """
        Update the estimate by a gradient step along each direction of the subspace.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : NoMemory
            Internal state before the period.

        Returns
        -------
        tuple of Column and NoMemory
            Estimate (k,) in SI units and internal state after the period.
        """
        gradient = period.gradient(period.integral)
        for step, direction in zip(column(self.gain), map(column, self.directions.T), strict=True):
            estimate = estimate - (step * (direction @ gradient)) * direction
        return estimate, memory

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """
        Compute the Lyapunov function's term within the subspace.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate, true : Column
            Estimate and true values (k,) in SI units.

        Returns
        -------
        scalar or None
            Energy in J, or None if it depends on more than the estimate, such as a covariance.
        """
        error = estimate - true
        along = Column(column(row) @ error for row in np.linalg.pinv(self.directions))
        return 0.5 * (along @ Column(x / g for x, g in zip(along, column(self.gain), strict=True)))
