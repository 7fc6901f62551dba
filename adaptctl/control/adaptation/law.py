"""The interface of adaptation laws: an equation for the estimate after a control period, and its memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Generic, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.memory import Memory
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, Scalar, Tunable


class NoMemory(NamedTuple):
    """The empty memory of a law that needs no more than the estimate."""


class Period(NamedTuple):
    """One control period as a control law hands it to an adaptation law: tracking errors s, torque, regressor and
    time."""

    gradient: Callable[[Column], Column]
    """Y' s (k,) for any sliding variable s (r,), linear in it; Y is the regressor at the start of the period"""
    before: Column
    """(r,) s at the start"""
    after: Column
    """(r,) s at the end, which is now"""
    torque: Column
    """(r,) N m, held over the period"""
    q: Column
    """(n,) the tree's joints now"""
    v: Column
    """(r,) velocities now"""
    length: float
    """T_c, s"""
    elapsed: Any
    """T_c, or 0 where nothing is to be learned: before the first tick, and while adaptation is frozen"""
    damping: Column
    """(r,) K, where the control law's V falls as -s'Ks"""

    @property
    def share(self) -> Any:
        """Share of the period to learn from: 1, or 0 where nothing is to be learned."""
        return self.elapsed * (1.0 / self.length)

    @property
    def mean(self) -> Column:
        """The mean of s (r,) at the start and at the end of the period, in rad/s or m/s."""
        return 0.5 * (self.before + self.after)

    @property
    def integral(self) -> Column:
        """The integral (r,) of s over the period by the trapezium rule, in rad or m; 0 where nothing is to be
        learned."""
        return (0.5 * self.elapsed) * (self.before + self.after)


class AdaptationLaw(Tunable, ABC, Generic[Memory]):
    """An adaptation law: how the estimate of a model's k parameters moves, whatever control law uses it.

    A subclass is a frozen dataclass of configuration. `law` is an equation over scalars of any kind, traced
    into the control law's own native code, to which the numbers that the class names in `tunable` are arguments. What
    changes over time, besides the estimate, is the memory, of which runs keep its property `recorded`, if it has one.
    """

    needs_double: ClassVar[bool] = False
    """True if the law's memory is a matrix that single precision spoils."""

    @abstractmethod
    def require(self, model: ReducedModel, initial: Array, period: float) -> None:
        """Raise `InputError` where the law does not fit a model, a first estimate (k,) or a period T_c (s)."""

    @abstractmethod
    def start(self, model: ReducedModel, initial: Array, q: Array, v: Array, period: float) -> Memory:
        """The memory before the first tick, for a first estimate (k,), at configuration q (n,) and velocities v (r,)
        and a period T_c (s)."""

    @abstractmethod
    def law(self, model: ReducedModel, estimate: Column, period: Period, memory: Memory) -> tuple[Column, Memory]:
        """The estimate (k,) and the memory after a control period, over scalars of any kind."""

    @property
    def by_parameter(self) -> bool:
        """True if the law measures each parameter's error by itself, so that a bound on one moves no other."""
        return False

    def lyapunov_term(self, model: ReducedModel, estimate: Column, true: Column) -> Scalar | None:
        """The parameters' term, in J, of the law's Lyapunov function at an estimate (k,) where the truth is (k,); over
        scalars of any kind. None where it depends on more than the estimate."""
        return None

    def distance(self, model: ReducedModel, estimate: Array, true: Array) -> Array | None:
        """The Lyapunov function's term of the parameters (...), J, at estimates (..., k) where the truth is (k,) or
        (..., k): `lyapunov_term` on arrays. None where it depends on more than the estimate."""
        rows = (np.asarray(x, dtype=np.float64)[..., None] for x in (estimate, true))
        found = self.lyapunov_term(model, *(Column(np.moveaxis(x, -2, 0)) for x in rows))
        return None if found is None else np.asarray(found)[..., 0]
