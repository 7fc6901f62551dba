"""Estimates kept within bounds that are known beforehand."""

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
    """Projection of another adaptation law's estimate (k,) of k parameters: it is clipped to [lower, upper] after each
    control period.

    `of` is that law, whose Lyapunov function must be a sum over the single parameters' errors; `lower` and `upper`
    (k,), in the parameters' SI units, may be infinite; `limits` makes them from parameters' names. Raises `InputError`
    for bounds that are NaN or of different shapes, unless lower < upper everywhere, and for a law whose Lyapunov
    function is no such sum (its property `by_parameter` is False), as one with a gain (k, k).

    Guarantees, where the truth is within the bounds: the estimate stays within, whatever disturbs; and what the law
    itself guarantees, because with a diagonal gain clipping is the projection in the distance of the law's Lyapunov
    function, which brings the estimate no farther from anything within (Goodwin and Mayne 1987).

    Gives up: nothing while the estimate is within the bounds. Bounds on fundamental (base) parameters are no guarantee
    of a positive definite mass matrix: the set of physically consistent parameters is a cone, not a box.
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
                raise InputError(f"projection: {name}: expected numbers (k,), infinite where there is no bound")
            object.__setattr__(self, name, frozen(bound))
        if self.lower.shape != self.upper.shape or not np.all(self.lower < self.upper):
            raise InputError("projection: expected lower < upper for every parameter")
        if not self.inner.by_parameter:
            raise InputError(
                f"projection: {type(self.inner).__name__} weighs parameters' errors together, so that clipping one of "
                "them could move the estimate away from the truth; give it a diagonal gain (k,)"
            )

    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` where the wrapped adaptation law does, for bounds of another number than the `model`'s k
        parameters, and for an initial estimate outside the bounds. `initial` is the initial estimate (k,), in SI units,
        `period` the control period in s."""
        self.inner.validate(model, initial, control_period)
        validate_size(self.lower, model, "projection: bounds")
        outside = np.flatnonzero((initial < self.lower) | (initial > self.upper))
        if outside.size:
            j = int(outside[0])
            raise InputError(
                f"projection: the first estimate of {model.names[j]} is {initial[j]:g}, outside its bounds "
                f"[{self.lower[j]:g}, {self.upper[j]:g}]: start within them, or widen them"
            )

    @property
    def by_parameter(self) -> bool:
        """True, as the adaptation law's Lyapunov function is a sum of one term for each parameter, so that parameters
        may be clipped one by one: construction refuses a law of which that does not hold, as one with a gain (k, k)."""
        return True

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Memory:
        """The wrapped adaptation law's internal state, a named tuple of arrays, before the first control period.

        `initial` is the initial estimate (k,) of the `model`'s k parameters, in SI units, q (..., n) are the positions
        of the spanning tree's n joints in rad (m for a prismatic joint), v (..., r) the velocities of the r primary
        (independent) joints in rad/s (m/s), with leading axes for arms, `period` is the control period in s. Raises
        what the wrapped law's method `start` does.
        """
        return self.inner.initial_state(model, initial, q, v, control_period)

    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Memory) -> tuple[Column, Memory]:
        """The estimate (k,) of the `model`'s k parameters after a step of the wrapped adaptation law, clipped to the
        projection's bounds, its attributes `lower` and `upper` (k,); and the wrapped law's internal state after the
        step.

        `estimate` (k,), in the parameters' SI units, and the internal state `memory` are those before the control
        period that `period` describes. Nothing is checked here.
        """
        moved, after = self.inner.law(model, estimate, period, memory)
        return Column(map(clip, moved, column(self.lower), column(self.upper))), after

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar | None:
        """The parameters' term, in J, of the wrapped adaptation law's Lyapunov function at an `estimate` (k,) of the
        `model`'s k parameters whose true values are `true` (k,), both in SI units. None where that law has no term that
        depends on the estimate alone. Nothing is checked here."""
        return self.inner.lyapunov_term(model, estimate, true)


def limits(model: ReducedModel, bounds: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """Lower and upper bounds, (k,) each, on the `model`'s k parameters, in their SI units: those in `bounds` for the
    parameters named there, -infinity and infinity for the others.

    `bounds` maps a parameter's full name, such as `link1.m`, to its pair (lower, upper). Raises `NotFoundError` for a
    parameter that is not one of the model's k, also where the model regroups it into other fundamental (base)
    parameters; `NonFiniteError` for NaN, and `InputError` for bounds that are no pair of numbers with lower < upper.
    """
    lower, upper = np.full(len(model.names), -np.inf), np.full(len(model.names), np.inf)
    for name, pair in bounds.items():
        if name not in model.names:
            raise NotFoundError(_unknown(model, name))
        j = model.names.index(name)
        lower[j], upper[j] = _pair(pair, f"bounds: {name}")
    return lower, upper


def _pair(values: ArrayLike, what: str) -> Array:
    """Lower and upper bound (2,)."""
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
            f"bounds: {name} is a parameter of {model.mechanism.name}, but the basis regroups it into others, so it is "
            "not adapted: bound one that is kept (model.names), or adapt all parameters with ReducedModel.full"
        )
    return f"bounds: {model.mechanism.name} has no parameter {name!r}{suggested_name(name, model.names)}"
