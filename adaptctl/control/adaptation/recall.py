"""Least squares that recall stored information."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation.least_squares import ForgettingLeastSquares
from adaptctl.control.adaptation.symmetric import from_triangle
from adaptctl.control.pytree import Memory
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel

MAX_RECALL = 0.5
"""recall times the control period: half of what the memory misses in one period"""


@dataclass(frozen=True, eq=False)
class RecallingLeastSquares(ForgettingLeastSquares[Memory]):
    """Base class of least squares with stored information."""

    recall: float = 2.0

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if the law does not fit the model and the control period.

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
            If a size is wrong, the cutoff or the recall is too high for the control period, or linear constraints fix
            parameters at values other than zero.
        """
        super().validate(model, initial, control_period)
        if self.recall * control_period > MAX_RECALL:
            raise InputError(
                f"{self.called}: recall: {self.recall:g} 1/s is too fast for a control period of {control_period:g} s; "
                f"use at most {MAX_RECALL / control_period:g} 1/s"
            )

    def _covariance(self, information: Any) -> Array:
        """Inverse (k, k) of the initial gain's inverse and the information, whose triangle is in its units."""
        k, scale = len(self.gain), np.sqrt(self.gain)
        return np.asarray(np.linalg.inv(np.eye(k) + from_triangle(information, k)) * np.outer(scale, scale))
