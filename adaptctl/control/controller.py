"""Base class of controllers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import lru_cache
from inspect import get_annotations
from itertools import chain, islice
from math import prod
from typing import Any, ClassVar, Generic, NamedTuple, NoReturn, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, numbers, stacked, vectors
from adaptctl.caching import cached_property, replaced_by
from adaptctl.compilation import Kernel
from adaptctl.compilation.builtin import Finite, Form, Place, has_builtins
from adaptctl.compilation.kernel import Given, OnFloats, native_or_floats
from adaptctl.control.pytree import (
    Memory,
    PackedState,
    checked_step,
    leaves,
    like,
    packed_state,
    paths,
    row_each,
    rows_of_arms,
    validate_point,
    validate_state,
    validate_step,
)
from adaptctl.errors import InputError, NonFiniteError, shown
from adaptctl.scalars import Column, Structure, Tunable


class ReferencePoint(NamedTuple):
    """
    Desired positions, velocities and accelerations of a motion.

    Parameters
    ----------
    p : ndarray
        Positions (..., r) in rad (m for a prismatic joint), or task-space coordinates (..., d) in m.
    v : ndarray
        Velocities in rad/s (m/s), of the same shape.
    a : ndarray
        Accelerations in rad/s^2 (m/s^2), of the same shape.

    Examples
    --------
    >>> rest = adaptctl.control.ReferencePoint(p, np.zeros(2), np.zeros(2))
    >>> torque, _ = law.step(law.init(p, v), p, v, rest)
    """

    p: Any
    v: Any
    a: Any


class Reference(Protocol):
    """
    Protocol of a reference: function from times to a `ReferencePoint`.

    Parameters
    ----------
    *args, **kwargs : object
        Not used: a protocol has no constructor.

    Examples
    --------
    >>> def ramp(t):
    ...     t = np.asarray(t, dtype=float)[..., None]
    ...     return adaptctl.control.ReferencePoint(t * [0.1, 0.2], 0.0 * t + [0.1, 0.2], 0.0 * t * [1.0, 1.0])
    >>> ramp(2.0).p
    array([0.2, 0.4])
    """

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """
        Return the reference point at some times.

        Parameters
        ----------
        t : array_like
            Times (...) in s.

        Returns
        -------
        ReferencePoint
            Positions, velocities and accelerations (..., r) in rad, rad/s and rad/s^2 (m for a prismatic joint).
        """
        ...


GAINS, MEMORY = "gains", "memory"  # columns of a law's gains, and of its state in one array


class _RequiredField:
    """Attribute of instances alone: a dataclass would take the inherited property as the default of its field."""

    def __get__(self, instance: Any, owner: Any) -> NoReturn:
        raise AttributeError("dof")


class Controller(Tunable, ABC, Generic[Memory]):
    """
    Base class of control laws, for one or many arms.

    Notes
    -----
    A subclass is a frozen dataclass. Its `law` is compiled to native code, up to 100 joints; attributes named in
    `tunable` are its arguments. `finite` says which numbers `step` requires to be finite: "results", True for arguments
    too, False for none.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from adaptctl.control import Controller
    >>> from adaptctl.control.adaptation.law import NoMemory
    >>> @dataclass(frozen=True, eq=False)
    ... class PD(Controller):
    ...     tunable = ("stiffness",)
    ...     stiffness: float = 20.0
    ...     dof = 2
    ...
    ...     def initial_state(self, p, v):
    ...         return NoMemory()
    ...
    ...     def law(self, p, v, reference, memory):
    ...         return self.stiffness * (reference.p - p) - 2.0 * v, memory
    >>> controller = PD()
    >>> torque, state = controller.step(controller.init(p, v), p, v, reference(0.0))
    >>> torque.round(3)
    array([-0.4,  0.2])
    """

    finite: ClassVar[Finite] = "results"

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "dof" in get_annotations(cls) and "dof" not in vars(cls):
            cls.dof = _RequiredField()  # type: ignore[assignment,method-assign]
        if "__repr__" not in vars(cls):
            cls.__repr__ = Controller.__repr__  # type: ignore[method-assign]  # a dataclass would print all its arrays

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.dof} joints>"

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number r of joints."""

    @property
    def neutral_configuration(self) -> Array:
        """Neutral positions (r,) in rad (m), near which the law is traced."""
        return np.zeros(self.dof)

    @property
    def reference_size(self) -> int:
        """Number of coordinates of a reference point: r, or d in task space."""
        return self.dof

    @abstractmethod
    def initial_state(self, p: Array, v: Array) -> Memory:
        """
        Return the internal state before the first control period; `init` calls it with checked arrays.

        Parameters
        ----------
        p, v : ndarray
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s).

        Returns
        -------
        tuple
            Internal state before the first control period.
        """

    @abstractmethod
    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Memory) -> tuple[Column, Memory]:
        """
        Compute the torque for one control period.

        The law is traced to be compiled: where a value decides, use `scalars.where` instead of `if`.

        Parameters
        ----------
        p, v : Column
            Measured positions (r,) in rad (m) and velocities (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations (r,) in rad, rad/s and rad/s^2 (m, m/s, m/s^2).
        memory : tuple
            Internal state of the last control period.

        Returns
        -------
        tuple of Column and tuple
            Torque (r,) in N m (N) and internal state after the period.
        """

    def init(self, p: ArrayLike, v: ArrayLike, gains: Mapping[str, Array] | None = None) -> Memory:
        """
        Return the internal state before the first control period.

        Parameters
        ----------
        p, v : array_like
            Measured positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s). Leading axes are arms.
        gains : dict, optional
            Tunable gains of each arm by their names in `numbers`, each with the leading axes of p. Default: those of
            the controller.

        Returns
        -------
        tuple
            Named tuple of arrays, each with the leading axes of p.

        Raises
        ------
        InputError
            If a shape is wrong.
        NotFoundError
            If a gain has another name.
        NonFiniteError
            If a number is not finite.
        SingularityError
            If p is near a singularity of the kinematic loops.

        Examples
        --------
        >>> law.init(p, v).estimate.shape
        (6,)
        """
        positions, velocities = self._measured(p, "p"), self._measured(v, "v")
        with np.errstate(over="ignore", invalid="ignore"):
            law = self.having(gains) if gains else self
            started: Memory = validate_state(law, law.initial_state(positions, velocities))
        if not all(np.isfinite(part).all() for part in leaves(started)):
            raise NonFiniteError(f"{type(self).__name__}: the initial state is not finite for finite arguments")
        return self._remembering(self._array_of(started, positions.shape[:-1]))

    def reset(self, state: Memory, arms: ArrayLike, p: ArrayLike, v: ArrayLike) -> Memory:
        """
        Return the state with some arms reset.

        Parameters
        ----------
        state : tuple
            Internal state of the arms, which is not changed.
        arms : array_like
            Mask (...) of bools, True for arms to reset.
        p, v : array_like
            Positions (..., r) in rad (m) and velocities (..., r) in rad/s (m/s). Rows of other arms are not used.

        Returns
        -------
        tuple
            Internal state; the given one if no arm is chosen.

        Raises
        ------
        InputError
            If a shape is wrong or the mask not of bools.
        NonFiniteError
            If p or v is not finite where the mask is True.

        Examples
        --------
        >>> many = np.stack([p, p]), np.stack([v, v])
        >>> law.reset(law.init(*many), np.array([True, False]), *many).estimate.shape
        (2, 6)
        """
        chosen, p, v = np.asarray(arms), numbers(p, "reset: p"), numbers(v, "reset: v")
        if chosen.dtype != np.bool_ or not (*chosen.shape, self.dof) == p.shape == v.shape:
            raise InputError(
                f"reset: expected p and v (..., {self.dof}) and a mask of bools (...), got p {p.shape}, v {v.shape} "
                f"and a mask of {chosen.dtype} {chosen.shape}"
            )
        if not chosen.any():
            return state
        memory = np.array(self._array_of(state, chosen.shape))
        memory[chosen] = self._array_of(self.init(p[chosen], v[chosen]), (int(chosen.sum()),))
        return self._remembering(memory)

    @replaced_by("_step_one")
    def step(self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Memory]:
        """
        Compute torque and internal state for one control period.

        Parameters
        ----------
        state : tuple
            Internal state, at first that of `init`. It is never changed, so that a step can be repeated.
        p, v : array_like
            Measured positions (..., r) in rad (m) and velocities (..., r) or (r,) in rad/s (m/s). Leading axes are
            arms.
        reference : ReferencePoint
            Desired positions, velocities and accelerations, (..., r) or (r,).

        Returns
        -------
        tuple of ndarray and tuple
            Torque (..., r) in N m (N) and internal state.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a result is not finite; the message names the arm. `SafetyFilter` brakes that arm alone.

        Examples
        --------
        >>> torque, state = law.step(law.init(p, v), p, v, reference(0.0))
        >>> torque.shape
        (2,)
        """
        return self._step_one(state, p, v, reference)

    def step_tuned(
        self, gains: Array, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint
    ) -> tuple[Array, Memory]:
        """
        Compute the torques of arms with different tunable gains.

        Parameters
        ----------
        gains : ndarray
            Tunable gains (N, g) of N arms, g numbers in the order of `numbers`, matrices row by row. They are not
            checked.
        state : tuple
            Internal states of N arms.
        p, v : array_like
            Measured positions (N, r) in rad (m) and velocities (N, r) or (r,) in rad/s (m/s).
        reference : ReferencePoint
            Desired positions, velocities and accelerations, (N, r) or (r,).

        Returns
        -------
        tuple of ndarray and tuple
            Torques (N, r) in N m (N) and internal states.

        Raises
        ------
        InputError
            If a shape is wrong.
        NonFiniteError
            If a result is not finite.

        Examples
        --------
        >>> many = np.stack([p, p]), np.stack([v, v])
        >>> gains = np.stack([law.packed, 2.0 * law.packed])
        >>> torque, _ = law.step_tuned(gains, law.init(*many), *many, reference(0.0))
        >>> torque.shape
        (2, 2)
        """
        return self._step_many(state, p, v, reference, gains)

    def compile(self, many: bool = False) -> Self:
        """
        Compile the law now, not at the first step.

        Parameters
        ----------
        many : bool, default False
            True to prepare the code for many arms, which the first step of many arms compiles.

        Returns
        -------
        Controller
            The controller itself.

        Raises
        ------
        InputError
            If `law` does not return a torque and an internal state.
        TraceError
            If `law` cannot be traced into an expression graph.

        Examples
        --------
        >>> law.compile() is law
        True
        """
        _ = self._tick if many else self._step_one
        return self

    @cached_property
    def _step_one(self) -> Callable[..., tuple[Array, Memory]]:
        return self._native(self._step_any) if self._has_native else self._step_any

    def _step_any(self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Memory]:
        if numbers(p, f"{type(self).__name__}: p").ndim > 1:
            return self._step_many(state, p, v, reference)
        given = Given(type(self).__name__, self._given_sizes).arrays((p, v, *validate_point(self, reference)))
        columns = given[0], given[1], ReferencePoint(*given[2:])
        return self._step_usual(self._remembering(self._array_of(state, ())), *columns)

    @cached_property
    def _step_usual(self) -> Callable[..., tuple[Array, Memory]]:
        if self._has_native:
            return self._native(lambda state, *given: self._blame(*given))

        def step(state: Any, p: Array, v: Array, reference: ReferencePoint) -> tuple[Array, Memory]:
            try:
                torque, memory = self._tick.call(p, v, *reference, state._array, *self._bound)
            except NonFiniteError:
                self._blame(p, v, reference)
            return torque, self._remembering(memory)

        return step

    @property
    def _has_native(self) -> bool:
        return isinstance(self._tick, Kernel) and has_builtins()

    def _native(self, instead: Callable[..., Any]) -> Callable[..., Any]:
        kernel: Any = self._tick
        otherwise: Callable[..., Any] = kernel.with_fallback(instead, self._kind, ReferencePoint, *self._bound)
        return otherwise

    @property
    def _bound(self) -> tuple[Array, ...]:
        return (self.packed,) if self.packed.size else ()

    def _remembering(self, array: Array) -> Memory:
        memory: Memory = self._kind._of(array)
        return memory

    def _array_of(self, memory: tuple[Any, ...], arms: tuple[int, ...]) -> Array:
        """State as one array (..., n)."""
        if type(memory) is self._kind:
            return row_each(memory._array, arms, "state")
        if not isinstance(memory, tuple):
            raise InputError(f"{type(self).__name__}: state: expected that of init(p, v), got {shown(memory)}")
        if arms:
            columns = rows_of_arms(leaves(memory), self._memory_sizes, arms)
            shaped = [values.reshape(*arms, -1) if values.ndim > 1 else values for values in columns.values()]
            rows = [row_each(values, arms, name) for name, values in zip(columns, shaped, strict=True)]
        else:
            rows = Given(type(self).__name__, self._memory_sizes).arrays(leaves(memory))
        return np.concatenate(rows or [np.zeros((*arms, 0))], axis=-1)

    @property
    def kernel(self) -> Kernel | None:
        """Native code of the law; None above 100 joints."""
        return self._tick if isinstance(self._tick, Kernel) else None

    @property
    def python_step(self) -> OnFloats:
        """Law evaluated in Python on arrays, without native code."""
        sizes = self._given_sizes | self._memory_sizes
        return OnFloats(self._equation(), sizes, name=type(self).__name__, finite=self.finite)

    @cached_property
    def _tick(self) -> Kernel | OnFloats:
        """Law on arrays, compiled up to 100 joints."""
        return compiled_law(self.structure)

    def _step_many(
        self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint, gains: Array | None = None
    ) -> tuple[Array, Memory]:
        arms = np.shape(p)[:-1]
        columns = rows_of_arms((p, v, *validate_point(self, reference)), self._given_sizes, arms)
        columns[MEMORY] = self._array_of(state, arms).reshape(prod(arms), self._sizes[MEMORY])
        columns |= dict.fromkeys(self.gain_sizes, self.packed if gains is None else gains)
        torque, memory = np.empty((*arms, self.dof)), np.empty((*arms, self._sizes[MEMORY]))
        sound = True
        try:
            self._computed(columns, [made.reshape(prod(arms), made.shape[-1]) for made in (torque, memory)])
        except NonFiniteError:
            sound = False
        for what, made in (("torque", torque), ("state", memory)):
            if not np.isfinite(made).all():
                self._blame(p, v, reference, made, what)
        if not sound:
            self._blame(p, v, reference)
        return torque, self._remembering(frozen(memory))

    def _computed(self, columns: Mapping[str, Array], results: list[Array]) -> None:
        if isinstance(self._tick, Kernel):
            self._tick.map(*columns.values(), out=results)
            return
        rows = {name: Column(np.atleast_2d(values).T) for name, values in columns.items()}
        for result, made in zip(results, self._packed_equation()(**rows), strict=True):
            result[...] = stacked(made.of, result.shape[:1])
        if self.finite is True and not all(np.isfinite(given).all() for given in columns.values()):
            raise NonFiniteError(type(self).__name__)

    @property
    def gain_sizes(self) -> dict[str, int]:
        """Count g of tunable numbers, as {"gains": g}; empty without any."""
        return {GAINS: self.packed.size} if self.packed.size else {}

    @cached_property
    def _given_sizes(self) -> dict[str, int]:
        r, m = self.dof, self.reference_size
        return {"p": r, "v": r, "reference_p": m, "reference_v": m, "reference_a": m}

    @cached_property
    def _memory_sizes(self) -> dict[str, int]:
        return {name: len(value) for name, value in zip(paths(self._blank), leaves(self._blank), strict=True)}

    @cached_property
    def _blank(self) -> Memory:
        blank: Memory = validate_state(self, self.initial_state(self.neutral_configuration, np.zeros(self.dof)))
        return blank

    @cached_property
    def _kind(self) -> type[PackedState]:
        return packed_state(self._blank)

    def _packed_equation(self) -> Callable[..., tuple[Column, Column]]:
        equation, sizes = self._equation(), self._memory_sizes

        def packed(**columns: Column) -> tuple[Column, Column]:
            memory = iter(columns.pop(MEMORY))
            parts = {name: Column(islice(memory, size)) for name, size in sizes.items()}
            torque, *after = equation(**columns, **parts)
            return torque, Column(chain.from_iterable(after))

        return packed

    @property
    def _sizes(self) -> dict[str, int]:
        return self._given_sizes | {MEMORY: sum(self._memory_sizes.values())} | self.gain_sizes

    @property
    def _form(self) -> Form:
        """Calling convention of one arm's step with its gains."""
        reference = (Place(3, 0), Place(3, 1), Place(3, 2))
        gains = (Place(None),) * len(self.gain_sizes)
        return Form((Place(1), Place(2), *reference, Place(0, 0), *gains), {0: 1, 3: 3}, {1: 0})

    def _equation(self) -> Callable[..., tuple[Column, ...]]:
        def equation(
            p: Column, v: Column, reference_p: Column, reference_v: Column, reference_a: Column, **kept: Column
        ) -> tuple[Column, ...]:
            law = self.substituted(kept.pop(GAINS)) if GAINS in kept else self
            reference = ReferencePoint(reference_p, reference_v, reference_a)
            torque, after = validate_step(self, checked_step(law, p, v, reference, like(self._blank, kept.values())))
            return (torque, *leaves(after))

        return equation

    def _measured(self, values: ArrayLike, what: str, size: int | None = None) -> Array:
        return vectors(values, self.dof if size is None else size, f"{type(self).__name__}: {what}")

    def _blame(
        self, p: ArrayLike, v: ArrayLike, reference: ReferencePoint, made: ArrayLike = 0.0, what: str = "torque"
    ) -> NoReturn:
        self._measured(p, "p"), self._measured(v, "v")
        for part, values in zip(reference._fields, reference, strict=True):
            self._measured(values, f"reference.{part}", self.reference_size)
        arm = np.argwhere(~np.isfinite(np.atleast_1d(made)))[:1, :-1].ravel().tolist()
        whose = f" of arm {', '.join(map(str, arm))}" if arm else ""
        raise NonFiniteError(f"{type(self).__name__}: the {what}{whose} is not finite for finite arguments")


@lru_cache(maxsize=64)
def compiled_law(structure: Structure) -> Kernel | OnFloats:
    """Law of a structure on arrays, compiled once a process."""
    law: Any = structure.of
    equation, about = law._packed_equation(), {"name": type(law).__name__, "finite": law.finite, "form": law._form}
    return native_or_floats(equation, law._sizes, law.dof, **about)
