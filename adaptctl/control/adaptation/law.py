"""Base class of adaptation laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import fields
from typing import Any, ClassVar, Generic, NamedTuple, cast

import numpy as np

from adaptctl.arrays import Array, numbers, real_number, same_samples
from adaptctl.control.pytree import Memory
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, Tunable


class NoMemory(NamedTuple):
    """Empty internal state of a law without memory."""


class Period(NamedTuple):
    """
    Data of one control period for an adaptation law.

    Parameters
    ----------
    gradient : callable
        Function from a sliding variable s (r,) to the product Y^T s (k,), with the regressor Y at the period's start,
        or that of the torque which then arrived, see `AdaptationLaw.regressor_delay`.
    s_prev, s : Column
        Sliding variable (r,) at the period's start and end in rad/s (m/s).
    torque : Column
        Torque (r,) held over the period in N m (N).
    q : Column
        Positions (n,) of the spanning tree's joints at the end in rad (m).
    v : Column
        Velocities (r,) at the end in rad/s (m/s).
    period : float
        Length of the period in s.
    dt : scalar
        The same length, or 0 if nothing is to be learned from the period, such as at a torque limit.
    damping : Column
        Damping K (r,) of the control law in N m s/rad (N s/m).

    Examples
    --------
    >>> s = np.array([0.1, 0.2])
    >>> data = adaptctl.control.Period(None, 0.0 * s, s, s, p, v, period, period, s)
    >>> data.mean
    array([0.05, 0.1 ])
    """

    gradient: Callable[[Column], Column]
    s_prev: Column
    s: Column
    torque: Column
    q: Column
    v: Column
    period: float
    dt: Any
    damping: Column

    @property
    def dt_ratio(self) -> Any:
        """`dt` divided by `period`, 1 or 0."""
        return self.dt * (1.0 / self.period)

    @property
    def mean(self) -> Column:
        """Mean (r,) of the sliding variable in rad/s (m/s)."""
        return 0.5 * (self.s_prev + self.s)

    @property
    def integral(self) -> Column:
        """Integral (r,) of the sliding variable over `dt` in rad (m)."""
        return (0.5 * self.dt) * (self.s_prev + self.s)


class AdaptationLaw(Tunable, ABC, Generic[Memory]):
    """
    Base class of adaptation laws, which update the k parameter estimates in every control period.

    Notes
    -----
    A subclass is a frozen dataclass. `law` is compiled to native code, with attributes named in `tunable` as arguments.
    `needs_double` excludes single precision.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from adaptctl.control import AdaptationLaw
    >>> @dataclass(frozen=True, eq=False)
    ... class Euler(AdaptationLaw):
    ...     gain: float = 0.1
    ...
    ...     def validate(self, model, initial, control_period):
    ...         assert self.gain > 0.0
    ...
    ...     def law(self, model, estimate, period, memory):
    ...         return estimate - (self.gain * period.dt) * period.gradient(period.s_prev), memory
    >>> adaptctl.SlotineLi(model, 5.0, 4.0, Euler()).adaptation_law.gain
    0.1
    """

    needs_double: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in vars(cls):
            cls.__repr__ = AdaptationLaw.__repr__  # type: ignore[method-assign]  # a dataclass would print its arrays

    def __repr__(self) -> str:
        return f"<{type(self).__name__}>"

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # a subclass is a dataclass
            if field.type in ("float", float):
                real_number(getattr(self, field.name), f"{type(self).__name__}: {field.name}")

    @property
    def regressor_delay(self) -> int:
        """Control periods by which torques arrive late, for which `Period.gradient` has an earlier regressor."""
        return 0

    @abstractmethod
    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """
        Raise `InputError` if the law does not fit the model.

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
            If a setting, such as a gain, does not fit.

        Examples
        --------
        >>> law.adaptation_law.validate(model, np.zeros(len(model.names)), period)  # raises no error
        """

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Memory:
        """
        Return the initial internal state, empty unless overridden.

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
        none: Any = NoMemory()
        return cast(Memory, none)

    @abstractmethod
    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Memory) -> tuple[Column, Memory]:
        """
        Compute the next estimate and internal state.

        The law is traced to be compiled: where a value decides, use `scalars.where` instead of `if`.

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

    @property
    def by_parameter(self) -> bool:
        """True if the Lyapunov function has a separate term for each parameter."""
        return False

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar | None:
        """
        Compute the estimation error's term of the Lyapunov function on scalars.

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

        Examples
        --------
        >>> from adaptctl.scalars import column
        >>> true = column(model.fundamental_parameters)
        >>> round(law.adaptation_law.lyapunov_term(model, true, true), 3)
        0.0
        """
        return None

    def lyapunov_distance(self, model: ReducedModel, estimate: Array, true: Array) -> Array | None:
        """
        Compute the estimation error's term of the Lyapunov function on arrays.

        Parameters
        ----------
        model : ReducedModel
            Reduced model with k parameters.
        estimate : ndarray
            Estimates (..., k) in SI units.
        true : ndarray
            True values (k,) or (..., k) in SI units.

        Returns
        -------
        ndarray or None
            Energies (...) in J, or None if they depend on more than the estimate, such as a covariance.

        Raises
        ------
        InputError
            If a shape is wrong.

        Examples
        --------
        >>> estimates = np.zeros((3, len(model.names)))
        >>> law.adaptation_law.lyapunov_distance(model, estimates, model.fundamental_parameters).shape
        (3,)
        """
        given = {"estimate": numbers(estimate, "estimate"), "true": numbers(true, "true")}
        for what, x in given.items():
            if x.shape[-1:] != (len(model.columns),):
                raise InputError(f"{what}: expected shape (..., {len(model.columns)}), got {x.shape}")
        same_samples(**given)
        found = self.lyapunov_term(model, *(Column(np.moveaxis(x[..., None], -2, 0)) for x in given.values()))
        return None if found is None else np.asarray(found)[..., 0]
