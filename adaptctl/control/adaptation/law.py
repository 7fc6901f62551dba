"""The interface of adaptation laws: an equation for the estimate after a control period, and its memory."""

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
    """Internal state without fields, an empty named tuple, of an adaptation or control law that keeps nothing besides
    the estimate."""


class Period(NamedTuple):
    """Measurements, torque and regressor of one control period, which a control law hands to its adaptation law, for k
    parameters and r joints.

    `gradient` gives Y' s (k,), in W per unit of each parameter, for any sliding variable s (r,), Y (r, k) the torque
    regressor at the start of the period and a prime the transpose; `before` and `after` are s (r,) at its start and its
    end, in rad/s (m/s for a prismatic joint); `torque` (r,) was held over it, in N m (N); `q` (n,) are the positions of
    the spanning tree's n joints at its end, in rad (m), `v` (r,) the velocities then, in rad/s (m/s). `length` is T_c,
    the period's length in s, `elapsed` the same, or 0 where nothing is to be learned: before the first control period,
    and while adaptation is frozen. `damping` is K (r,) in N m s/rad (N s/m), with which the control law's Lyapunov
    function V has the derivative -s'Ks. Nothing is checked.
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
        """Fraction of the control period to learn from, without a unit: 1, or 0 where nothing is to be learned, that
        is, before the first control period and while adaptation is frozen."""
        return self.dt * (1.0 / self.period)

    @property
    def mean(self) -> Column:
        """The mean (r,) of the sliding variable of r joints at the start and at the end of the control period, in rad/s
        (m/s for a prismatic joint)."""
        return 0.5 * (self.s_prev + self.s)

    @property
    def integral(self) -> Column:
        """The integral (r,) of the sliding variable of r joints over the control period by the trapezium rule, in rad
        (m for a prismatic joint). It is 0 where nothing is to be learned: before the first control period and while
        adaptation is frozen."""
        return (0.5 * self.dt) * (self.s_prev + self.s)


class AdaptationLaw(Tunable, ABC, Generic[Memory]):
    """Base class of adaptation laws, which move the estimate (k,) of a model's k parameters from one control period to
    the next, under any control law.

    A subclass is a frozen dataclass of configuration that writes the methods `require(model, initial, period)`, a
    check, `start(model, initial, q, v, period)`, which returns the internal state before the first control period, and
    `law(model, estimate, period, memory)`, which returns the estimate (k,) and the internal state after one. A field of
    type float that is given no number raises `InputError` at construction. The method `law` is an equation over scalars
    of any kind (floats, arrays of samples, nodes of an expression graph), compiled into the control law's own native
    code. The attributes that the class names in `tunable`, a tuple of their names, are arguments of that code; all its
    other numbers are compiled in.

    What changes over time, besides the estimate, is the internal state, a NamedTuple of columns (each m numbers) and of
    further such tuples, `NoMemory` for none; recorded runs keep that state's property `recorded`, if it has one. The
    class attribute `needs_double` is True for a law whose internal state is a matrix that single precision spoils,
    False unless a subclass says so.
    """

    needs_double: ClassVar[bool] = False
    """True if the law's memory is a matrix that single precision spoils."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]  # a subclass is a dataclass
            if field.type in ("float", float):
                real_number(getattr(self, field.name), f"{type(self).__name__}: {field.name}")

    @abstractmethod
    def validate(self, model: ReducedModel, initial: Array, control_period: float) -> None:
        """Raise `InputError` where the adaptation law's settings, such as a gain, do not fit the `model`'s k parameters
        and r joints, the initial estimate `initial` (k,), in SI units, or the control `period` in s."""

    def initial_state(self, model: ReducedModel, initial: Array, q: Array, v: Array, control_period: float) -> Memory:
        """The adaptation law's internal state before the first control period, for an initial estimate `initial` (k,)
        of the model's k parameters, in SI units. q (..., n) are the positions of the spanning tree's n joints in rad (m
        for a prismatic joint), v (..., r) the velocities of the r primary (independent) joints in rad/s (m/s), leading
        axes for arms, `period` is the control period in s.

        It is a named tuple of arrays, or of such tuples: each array (..., h), h its own length, or (h,) where all arms
        begin alike; a `NoMemory` unless a subclass overrides this. An implementation raises `InputError` for a model
        that it cannot start on, and checks nothing else here.
        """
        none: Any = NoMemory()
        return cast(Memory, none)

    @abstractmethod
    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Memory) -> tuple[Column, Memory]:
        """The estimate (k,) of the model's k parameters, in their SI units, and the internal state after a control
        period, over scalars of any kind: floats, arrays of samples, nodes of an expression graph.

        `estimate` (k,) and the internal state `memory` are those before the period; `period`, a `Period`, has the
        torque held over it and the positions, velocities and sliding variables measured. The internal state, before and
        after, is the named tuple that the method `start` makes, each array in it now a `Column` of as many scalars. An
        implementation checks nothing here.
        """

    @property
    def by_parameter(self) -> bool:
        """True if the adaptation law's Lyapunov function is a sum over the single parameters' errors, as with a
        diagonal gain, so that clipping one parameter to a bound need not move any other; False unless a subclass
        overrides it."""
        return False

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar | None:
        """The parameters' term, in J, of the adaptation law's Lyapunov function at an `estimate` (k,) of the model's k
        parameters whose true values are `true` (k,), both in SI units. It is over scalars of any kind: floats, arrays
        of samples, nodes of an expression graph. None, as here unless a subclass overrides it, for a law whose term
        depends on more than the estimate. Nothing is checked."""
        return None

    def lyapunov_distance(self, model: ReducedModel, estimate: Array, true: Array) -> Array | None:
        """The parameters' term (...), in J, of the adaptation law's Lyapunov function at estimates (..., k) of the
        model's k parameters: the method `lyapunov_term` on arrays. `true`, (k,) or (..., k), are the true values; both
        are in SI units. None for a law whose term depends on more than the estimate. Raises `InputError` for arrays of
        another shape or of no numbers."""
        given = {"estimate": numbers(estimate, "estimate"), "true": numbers(true, "true")}
        for what, x in given.items():
            if x.shape[-1:] != (len(model.columns),):
                raise InputError(f"{what}: expected shape (..., {len(model.columns)}), got {x.shape}")
        same_samples(**given)
        found = self.lyapunov_term(model, *(Column(np.moveaxis(x[..., None], -2, 0)) for x in given.values()))
        return None if found is None else np.asarray(found)[..., 0]
