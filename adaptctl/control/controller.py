"""What every controller is: a law over scalars, its memory, and a face on arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.compilation import Kernel, compile_function
from adaptctl.dynamics.arrays import checked
from adaptctl.errors import NonFiniteError
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column

LARGEST_COMPILED = 32
"""Links above which straight-line code takes too long to compile; the same law then runs on floats."""


class ReferencePoint(NamedTuple):
    """Where the arm should be: positions, velocities, accelerations, each (..., r) or a column."""

    p: Any
    v: Any
    a: Any


class Reference(Protocol):
    """A trajectory: a time (...) in s to a reference point (..., r)."""

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference at times t."""
        ...


Memory = TypeVar("Memory", bound=tuple[Any, ...])
"""What a law remembers between ticks: a NamedTuple of columns, arrays on the outside."""


class Controller(ABC, Generic[Memory]):
    """A control law for a mechanism of r joints, called once a control period.

    A subclass is a frozen dataclass of configuration. It writes `start` and `law`; `law` is an equation over
    scalars of any kind, so it is compiled to native code here, differentiated there, and run on floats when a
    mechanism is too long to compile. What changes over time is the memory, passed in and out.
    """

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number of joints r."""

    @abstractmethod
    def start(self, p: Array, v: Array) -> Memory:
        """The memory before the first tick."""

    @abstractmethod
    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Memory) -> tuple[Column, Memory]:
        """One tick: the torque, in N m, and the memory after it."""

    def init(self, p: ArrayLike, v: ArrayLike) -> Memory:
        """The state before the first tick, from measured positions and velocities (r,)."""
        return self.start(self._measured(p, "p"), self._measured(v, "v"))

    def step(self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Memory]:
        """One tick on arrays: the torque (r,) and the next state.

        Raises `InputError` on a wrong shape and `NonFiniteError` when a measurement, a reference or the
        outcome is not finite: nothing non-finite leaves a controller.
        """
        torque, *memory = self._tick(p, v, *reference, *state)
        if not np.isfinite(torque).all():
            self._blame(p, v, reference)
        return torque, type(state)(*memory)

    @property
    def kernel(self) -> Kernel | None:
        """The law as native code, which can count its operations; None above LARGEST_COMPILED joints."""
        return self._tick if isinstance(self._tick, Kernel) else None

    @cached_property
    def _tick(self) -> Callable[..., Sequence[Array]]:
        """The law on arrays, compiled where that is possible in reasonable time."""
        blank = self.start(np.zeros(self.dof), np.zeros(self.dof))
        if self.dof > LARGEST_COMPILED:
            return self._on_floats
        r = self.dof
        sizes = {"p": r, "v": r, "reference_p": r, "reference_v": r, "reference_a": r}
        memory = {f"memory_{name}": len(value) for name, value in zip(_fields(blank), blank, strict=True)}
        return compile_function(self._equation(type(blank)), sizes | memory, name=type(self).__name__)

    def _equation(self, memory: type[Memory]) -> Callable[..., tuple[Column, ...]]:
        def equation(
            p: Column, v: Column, reference_p: Column, reference_v: Column, reference_a: Column, **kept: Column
        ) -> tuple[Column, ...]:
            reference = ReferencePoint(reference_p, reference_v, reference_a)
            torque, after = self.law(p, v, reference, memory(*kept.values()))
            return (torque, *after)

        return equation

    def _on_floats(self, *arrays: ArrayLike) -> list[Array]:
        blank = self.start(np.zeros(self.dof), np.zeros(self.dof))
        p, v, *rest = (Column(np.asarray(array, dtype=float).tolist()) for array in arrays)
        torque, after = self.law(p, v, ReferencePoint(*rest[:3]), type(blank)(*rest[3:]))
        return [np.array(column.of, dtype=float) for column in (torque, *after)]

    def _measured(self, values: ArrayLike, what: str) -> Array:
        return checked(np.atleast_1d(np.asarray(values)), self.dof, f"{type(self).__name__}: {what}")

    def _blame(self, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> None:
        names = ("p", "v", "reference.p", "reference.v", "reference.a")
        for what, values in zip(names, (p, v, *reference), strict=True):
            self._measured(values, what)
        raise NonFiniteError(f"{type(self).__name__}: the torque is not finite, though all it was given is")


def _fields(memory: tuple[Any, ...]) -> Sequence[str]:
    return getattr(memory, "_fields", [str(i) for i in range(len(memory))])
