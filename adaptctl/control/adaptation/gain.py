"""Gradient descent with a constant gain, and the distance that the gain defines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array, numbers
from adaptctl.control.adaptation.law import AdaptationLaw
from adaptctl.control.gains.hold import scaled_eigenvalues
from adaptctl.control.memory import Memory
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, column


@dataclass(frozen=True, eq=False)
class Descent(AdaptationLaw[Memory]):
    """Base class of adaptation laws for k parameters by descent along a gradient (k,) with a constant adaptation gain
    Gamma. `gain` is Gamma, its diagonal (k,) or the whole matrix (k, k), in units of the parameters squared per J, and
    is kept as a read-only array.

    A subclass writes the methods `start(model, initial, q, v, period)`, which returns the internal state before the
    first control period, and `law(model, estimate, period, memory)`, which returns the estimate (k,) and the internal
    state after one; the method `applied` multiplies by Gamma for it. Raises `InputError` at construction for a gain
    that is not finite, positive and, as a matrix, symmetric and positive definite.
    """

    gain: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "gain", checked_gain(self.gain))

    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` where the adaptation gain is for another number of parameters than the `model`'s k.
        `initial`, the initial estimate (k,), and `period`, the control period in s, are not used."""
        require_size(self.gain, model, "adaptation gain")

    @property
    def by_parameter(self) -> bool:
        """True if the adaptation gain is diagonal, so that the law's Lyapunov function is a sum over the single
        parameters' errors, and clipping one parameter to a bound need not move any other."""
        return self.gain.ndim == 1

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar:
        """The parameters' term error' Gamma^-1 error / 2, in J, of the adaptation law's Lyapunov function. Gamma is the
        adaptation gain, a prime the transpose and error the `estimate` (k,) of the model's k parameters less their
        `true` values (k,), both in SI units, scalars of any kind: floats, arrays of samples, nodes of an expression
        graph. Raises `ValueError` for columns of different lengths."""
        error, gain = estimate - true, self._columns
        if isinstance(gain, list):
            return 0.5 * (error @ solve_symmetric([list(row) for row in gain], error))
        return 0.5 * (error @ Column(e / g for e, g in zip(error, gain, strict=True)))

    def applied(self, gradient: Column) -> Column:
        """The product Gamma x (k,) of the adaptation gain Gamma of k parameters and a `gradient` x (k,), in the unit of
        each parameter where x is in J per unit of it. Raises `ValueError` for a gradient of another length."""
        gain = self._columns
        return Column(row @ gradient for row in gain) if isinstance(gain, list) else gain * gradient

    @property
    def _columns(self) -> Column | list[Column]:
        """Gamma over scalars: its diagonal, or its rows."""
        rows: Any = self.gain
        if getattr(rows, "ndim", 1 + isinstance(rows, tuple)) == 2:  # an array, or a tuple of columns
            return [column(row) for row in rows]
        return column(rows)


def checked_gain(gain: ArrayLike) -> Array:
    """A read-only float64 copy of an adaptation `gain` of k parameters, its diagonal (k,) or whole (k, k), in units of
    the parameters squared per J. Raises `InputError` for another shape, for entries that are no finite numbers, for no
    entries at all, for a diagonal that is not positive, and for a matrix that is not symmetric (to 1e-12 of its largest
    entry) and positive definite (all eigenvalues above 0 once its diagonal is scaled to 1)."""
    array = numbers(gain, "adaptation gain")
    k = array.shape[:1]
    array = frozen_array(array, (*k, *k) if array.ndim == 2 else k, "adaptation gain")
    if array.ndim not in (1, 2) or not array.size:
        raise InputError(f"adaptation gain: expected numbers (k,), one a parameter, or (k, k), got shape {array.shape}")
    positive = np.all(array > 0.0) if array.ndim == 1 else _is_positive_definite(array)
    if not positive:
        raise InputError("adaptation gain: expected a positive diagonal or a symmetric positive definite matrix")
    return array


def require_size(values: Array, model: ReducedModel, what: str) -> None:
    """Raise `InputError` unless `values`, an array (k, ...), has one row for each of the `model`'s k parameters. `what`
    names it in the message."""
    k, given = len(model.columns), len(values)
    if given == k:
        return
    hint = ""
    if given == len(model.mechanism.parameter_names):
        hint = f"; these are for all {given} parameters, of which the basis keeps {k}: take model.columns of them"
    raise InputError(f"{what}: expected {k} numbers, one a parameter of the model, got {given}{hint}")


def _is_positive_definite(matrix: Array) -> bool:
    """True if a matrix is symmetric and positive definite, to round-off of its largest entry; its parameters' units are
    scaled out first."""
    symmetric = np.allclose(matrix, matrix.T, rtol=0.0, atol=1e-12 * np.abs(matrix).max(initial=0.0))
    return bool(symmetric and np.all(np.diagonal(matrix) > 0.0) and scaled_eigenvalues(matrix)[0] > 0.0)
