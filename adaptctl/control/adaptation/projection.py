"""Projection onto bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, numbers
from adaptctl.control.adaptation.gradient import validate_size
from adaptctl.control.adaptation.law import AdaptationLaw, Period
from adaptctl.control.pytree import Memory
from adaptctl.errors import InputError, NonFiniteError, NotFoundError, suggested_name, validate_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, clip, column


@dataclass(frozen=True, eq=False)
class Projection(AdaptationLaw[Memory]):
    """
    Adaptation law whose estimate is clipped to bounds after every step of another law.

    Parameters
    ----------
    inner : AdaptationLaw
        Law with a diagonal gain, so that clipping one parameter cannot move the estimate away from the truth.
    lower, upper : array_like
        Bounds (k,) in SI units, infinite for none; `limits` makes them from names.

    Raises
    ------
    InputError
        If bounds are NaN, differ in shape or do not rise, or the law weighs parameters' errors together.

    Notes
    -----
    With the true values within the bounds, the law's guarantee holds [1]_.

    References
    ----------
    .. [1] Goodwin and Mayne, Automatica, 1987.

    Examples
    --------
    >>> from adaptctl.control import Gradient, Projection, limits
    >>> bounded = Projection(Gradient(np.full(6, 0.1)), *limits(model, {"lower.I_zz": (0.0, 1.0)}))
    >>> adaptctl.SlotineLi(model, 5.0, 4.0, bounded).dof
    2
    """

    tunable = ("lower", "upper")

    inner: AdaptationLaw[Memory]
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        super().__post_init__()
        validate_kind(self.inner, AdaptationLaw, "projection", "as Gradient(gain) is one")
        for name in ("lower", "upper"):
            bound = numbers(getattr(self, name), f"projection: {name}").copy()
            if bound.ndim != 1 or np.isnan(bound).any():
                raise InputError(f"projection: {name}: expected numbers (k,), infinite for no bound")
            object.__setattr__(self, name, frozen(bound))
        if self.lower.shape != self.upper.shape or not np.all(self.lower < self.upper):
            raise InputError("projection: expected lower < upper for every parameter")
        if not self.inner.by_parameter:
            raise InputError(
                f"projection: {type(self.inner).__name__} couples the errors of the parameters, so that clipping one "
                "of them could increase the estimation error; give it a diagonal gain (k,)"
            )

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise an error if law, bounds or initial estimate do not fit the model.

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
            If a size does not fit, or the initial estimate is outside the bounds.
        """
        self.inner.validate(model, initial, control_period)
        validate_size(self.lower, model, "projection: bounds")
        outside = np.flatnonzero((initial < self.lower) | (initial > self.upper))
        if outside.size:
            j = int(outside[0])
            raise InputError(
                f"projection: the initial estimate of {model.names[j]} is {initial[j]:g}, outside its bounds "
                f"[{self.lower[j]:g}, {self.upper[j]:g}]: start within the bounds, or widen the bounds"
            )

    @property
    def by_parameter(self) -> bool:
        """Always True."""
        return True

    @property
    def regressor_delay(self) -> int:
        """Control periods by which the wrapped law takes torques to arrive late."""
        return self.inner.regressor_delay

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Memory:
        """
        Return the wrapped law's internal state.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        initial : ndarray
            Initial estimate (k,) in SI units.
        q, v : ndarray
            Positions (..., n) in rad (m) of the n joints of the spanning tree, and velocities (..., r) of the primary
            joints in rad/s (m/s).
        control_period : float
            Control period in s.

        Returns
        -------
        tuple
            Internal state of the law. Leading axes of q are arms; a part that does not depend on q is without them.
        """
        return self.inner.initial_state(model, initial, q, v, control_period)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Memory) -> tuple[Column, Memory]:
        """
        Update the estimate by the wrapped law, and clip it to the bounds.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : Column
            Estimate (k,) before the period, in SI units.
        period : Period
            Sliding variable, torque and regressor of the control period, see `Period`.
        memory : tuple
            Internal state before the period.

        Returns
        -------
        tuple of Column and tuple
            Estimate (k,) in SI units and internal state after the period.
        """
        moved, after = self.inner.law(model, estimate, period, memory)
        return Column(map(clip, moved, column(self.lower), column(self.upper))), after

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar | None:
        """
        Compute the wrapped law's term of the Lyapunov function.

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
        return self.inner.lyapunov_term(model, estimate, true)


def limits(model: ReducedModel, bounds: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """
    Return lower and upper bounds of all parameters, from those given by name.

    Parameters
    ----------
    model : ReducedModel
        Reduced model with k parameters.
    bounds : dict
        Lower and upper bound in SI units by full name, such as `upper.I_zz`.

    Returns
    -------
    tuple of ndarray
        Lower and upper bounds (k,) in SI units, infinite for parameters that are not named.

    Raises
    ------
    NotFoundError
        If a name is not among the model's parameters.
    NonFiniteError
        If a bound is NaN.
    InputError
        If bounds are no pair, or do not rise.

    Examples
    --------
    >>> lower, upper = adaptctl.control.limits(model, {"lower.I_zz": (0.0, 1.0)})
    >>> float(upper[-1]), float(upper[0])
    (1.0, inf)
    """
    lower, upper = np.full(len(model.names), -np.inf), np.full(len(model.names), np.inf)
    for name, pair in bounds.items():
        if name not in model.names:
            raise NotFoundError(_unknown(model, name))
        j = model.names.index(name)
        lower[j], upper[j] = _pair(pair, f"bounds: {name}")
    return lower, upper


def _pair(values: ArrayLike, what: str) -> Array:
    bound = numbers(values, what, "(lower, upper)")
    if bound.shape != (2,):
        raise InputError(f"{what}: expected (lower, upper), got {values!r}")
    if np.isnan(bound).any():
        raise NonFiniteError(f"{what}: expected numbers, got {bound.tolist()}")
    if not bound[0] < bound[1]:
        raise InputError(f"{what}: expected lower < upper, got {bound.tolist()}")
    return bound


def _unknown(model: ReducedModel, name: str) -> str:
    if name in model.mechanism.parameter_names:
        return (
            f"bounds: {name} is a parameter of {model.mechanism.name}, but the basis regroups it into others, and it "
            "is not adapted: bound a base parameter (model.names), or adapt all parameters with ReducedModel.full"
        )
    return f"bounds: {model.mechanism.name} has no parameter {name!r}{suggested_name(name, model.names)}"
