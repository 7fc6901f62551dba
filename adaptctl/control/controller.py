"""The interface of controllers: a law over scalars, its memory, and steps on arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import lru_cache
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
    validate_step,
)
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, Structure, Tunable


class ReferencePoint(NamedTuple):
    """Reference point of a motion: desired positions `p` in rad (m if prismatic), velocities `v` in rad/s (m/s) and
    accelerations `a` in rad/s^2 (m/s^2), arrays (..., r) for r joints; or, in m, m/s and m/s^2, (..., d) for d
    task-space coordinates. In a control law's equation each is a `Column` of r (or m) scalars. Nothing is checked."""

    p: Any
    v: Any
    a: Any


class Reference(Protocol):
    """Protocol of a reference trajectory: a callable from times `t`, one or an array (...), in s, to a
    `ReferencePoint`. Its positions, velocities and accelerations are (..., r) for r joints, in rad, rad/s and rad/s^2
    (m, m/s and m/s^2 if prismatic), or (..., d) for d task-space coordinates, in m, m/s and m/s^2. An implementation
    should give finite numbers at any time; nothing is checked."""

    def __call__(self, t: ArrayLike, /) -> ReferencePoint:
        """The reference point at times `t` (...) in s: positions, velocities and accelerations, (..., r) each for r
        joints in rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic), or (..., d) for d task-space coordinates in their
        units."""
        ...


GAINS, MEMORY = "gains", "memory"
"""Names of the columns of a law's gains, and of its memory in one array."""


class Controller(Tunable, ABC, Generic[Memory]):
    """Base class of control laws for a mechanism of r joints, called once every control period, for one arm or for many
    arms at once.

    A subclass is a frozen dataclass of configuration. It writes the property `dof`, the number r, and the methods
    `start(p, v)`, which returns the internal state before the first control period, and `law(p, v, reference, memory)`,
    which returns the torque for a period and the internal state after it. This state, a named tuple of arrays, is all
    that changes over time; `step` takes and returns it. `law` computes on scalars of any kind (floats, arrays, dual
    numbers, symbols), so that it can be compiled to native code and differentiated; above 100 joints it runs in Python.

    Attributes that the class names in `tunable` hold its gains; these are arguments of the native code. Controllers
    that differ in them alone share one code, and the method `tuned` makes such a copy. Without names in `tunable` all
    numbers are compiled in. The class attribute `finite` says where `step` raises `NonFiniteError` for NaN and
    infinity: in its results if "results", the default; in its arguments too if True; nowhere if False. Nothing is
    checked at construction, unless by a subclass.
    """

    finite: ClassVar[Finite] = "results"
    """Where a step refuses NaN and infinity: "results", True (its arguments too) or False (nowhere)."""

    @property
    @abstractmethod
    def dof(self) -> int:
        """Number r of joints that the control law moves."""

    @property
    def neutral_configuration(self) -> Array:
        """Home positions (r,) of the r joints, rad (m if prismatic): a configuration at which the control law can be
        evaluated, and at which it is compiled; zeros unless a subclass gives others, as for kinematic loops that zeros
        do not close."""
        return np.zeros(self.dof)

    @property
    def reference_size(self) -> int:
        """Length of each part (positions, velocities, accelerations) of the control law's reference points: the number
        r of joints, unless a subclass gives the number d of task-space coordinates."""
        return self.dof

    @abstractmethod
    def initial_state(self, p: Array, v: Array) -> Memory:
        """The control law's internal state before its first control period, for arms at positions p in rad (m if
        prismatic) and velocities v in rad/s (m/s), both (..., r) for r joints with leading axes for arms. An
        implementation returns a named tuple of arrays, or of such tuples: each array (..., n), n its own length, or
        (n,) where all arms begin alike. The method `init`, which calls it, checks shapes and values."""

    @abstractmethod
    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Memory) -> tuple[Column, Memory]:
        """The torque (r,) of the r joints, N m (N if prismatic), for one control period, and the control law's internal
        state after it. Measured positions p (r,) are in rad (m if prismatic), velocities v (r,) in rad/s (m/s).
        `reference` has the desired positions in rad (m), velocities in rad/s (m/s) and accelerations in rad/s^2
        (m/s^2), (r,) each, or, in a task space of d coordinates, (d,) in their units. `memory` is the internal state of
        the last period, at first that of the method `start`. Vectors are Columns of scalars of any kind. An
        implementation checks nothing: the method `step` does, and raises `InputError` where `law` returns anything but
        a `Column` of r scalars and an internal state of the same sizes."""

    def init(self, p: ArrayLike, v: ArrayLike, gains: Mapping[str, Array] | None = None) -> Memory:
        """The controller's internal state before the first control period, from measured positions p in rad (m if
        prismatic) and velocities v in rad/s (m/s), both (..., r) for r joints.

        Leading axes are arms, and each has its own state: a named tuple of arrays (..., n), n the length of each.
        `gains` are tunable numbers, by their names in the property `numbers`, each with the leading axes of p before
        its own shape, for arms that have their own; None for the controller's. Their values are not checked. Raises
        `InputError` on a wrong shape, `NotFoundError` for a name that is not in `numbers`, `NonFiniteError` where p, v
        or the state are not finite; laws for closed kinematic loops raise `SingularityError` near a singularity of
        these.
        """
        positions, velocities = self._measured(p, "p"), self._measured(v, "v")
        with np.errstate(over="ignore", invalid="ignore"):
            started = (self.having(gains) if gains else self).initial_state(positions, velocities)
        if not all(np.isfinite(part).all() for part in leaves(started)):
            raise NonFiniteError(f"{type(self).__name__}: the first state is not finite, though all it was given is")
        return self._remembering(self._array_of(started, positions.shape[:-1]))

    def reset(self, state: Memory, arms: ArrayLike, p: ArrayLike, v: ArrayLike) -> Memory:
        """The `state` of many arms, in which those where the mask `arms` (...) of bools is True are set back to before
        their first control period, as when an episode begins anew.

        These arms are at positions p in rad (m if prismatic) and velocities v in rad/s (m/s), (..., r) for r joints;
        other rows of p and v are not used. The state given is not changed; where no arm is chosen it is itself
        returned. Raises `InputError` for a mask that is not of bools and where p and v are not (..., r) with the mask's
        axes, `NonFiniteError` for p or v not finite where the mask is True.
        """
        chosen, p, v = np.asarray(arms), np.asarray(p), np.asarray(v)
        if chosen.dtype != np.bool_ or not (*chosen.shape, self.dof) == p.shape == v.shape:
            raise InputError(
                f"restart: expected p and v (..., {self.dof}) and a mask of bools (...), got p {p.shape}, v {v.shape} "
                f"and a mask of {chosen.dtype} {chosen.shape}"
            )
        if not chosen.any():
            return state
        memory = np.array(self._array_of(state, chosen.shape))
        memory[chosen] = self._array_of(self.init(p[chosen], v[chosen]), (int(chosen.sum()),))
        return self._remembering(memory)

    @replaced_by("_step_one")
    def step(self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Memory]:
        """The torque (..., r) of the r joints, N m (N if prismatic), for one control period, and the internal state
        after it. Measured positions p are in rad (m if prismatic), velocities v in rad/s (m/s); `reference` has the
        desired positions, velocities and accelerations, rad/s^2 (m/s^2); `state` is the last internal state, at first
        that of the method `init`.

        Leading axes of p (..., r) are arms, computed together in SIMD lanes; v and the reference's parts may be (r,),
        the same for all. Raises `InputError` on a wrong shape and `NonFiniteError` when the torque or the next state of
        any arm is not finite, as by NaN in p, v or the reference; the message names the arm. `state` is never changed,
        so the step can be repeated without that arm, or with the controller wrapped in `SafetyFilter`, which brakes
        that arm alone.
        """
        return self._step_one(state, p, v, reference)

    def step_tuned(
        self, gains: Array, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint
    ) -> tuple[Array, Memory]:
        """The torques (N, r) of r joints, N m (N if prismatic), for one control period of N arms, each with tunable
        gains of its own, and the internal states of all arms after it.

        A row of `gains` (N, g) has an arm's g tunable numbers in the order of the property `numbers`, matrices row by
        row; they are not checked. `state` are the last internal states, at first those of the method `init`. Measured
        positions p (N, r) are in rad (m), velocities v in rad/s (m/s); `reference` has positions, velocities and
        accelerations, rad/s^2 (m/s^2). v and its parts have a row for each arm, or one, (r,), for all. Raises
        `InputError` on a wrong shape, `NonFiniteError` for results that are not finite.
        """
        return self._step_many(state, p, v, reference, gains)

    def compile(self, many: bool = False) -> Self:
        """The controller itself, its control law compiled to native code now, not at the first call of `step`. By
        default this is for one arm; with `many` True the law for many arms is only prepared here, and compiled at the
        first `step` of many arms. Raises `InputError` where `law` does not return a torque and an internal state,
        `TraceError` where it cannot be traced into an expression graph; with `many`, that first `step` raises them."""
        _ = self._tick if many else self._step_one
        return self

    @cached_property
    def _step_one(self) -> Callable[..., tuple[Array, Memory]]:
        """One tick of one arm in native code, which calls `_step_any` with unusual arguments."""
        return self._native(self._step_any) if self._has_native else self._step_any

    def _step_any(self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Memory]:
        """A tick on whatever is like arrays, of one arm or many."""
        if numbers(p, f"{type(self).__name__}: p").ndim > 1:
            return self._step_many(state, p, v, reference)
        given = Given(type(self).__name__, self._given_sizes).arrays((p, v, *reference))
        columns = given[0], given[1], ReferencePoint(*given[2:])
        return self._step_usual(self._remembering(self._array_of(state, ())), *columns)

    @cached_property
    def _step_usual(self) -> Callable[..., tuple[Array, Memory]]:
        """A tick of one arm on usual arrays."""
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
        """A tick of one arm in native code; what is called in place of it where arrays or outcome are not usual."""
        kernel: Any = self._tick
        otherwise: Callable[..., Any] = kernel.with_fallback(instead, self._kind, ReferencePoint, *self._bound)
        return otherwise

    @property
    def _bound(self) -> tuple[Array, ...]:
        """The gains, where there are any."""
        return (self.packed,) if self.packed.size else ()

    def _remembering(self, array: Array) -> Memory:
        """The memory whose columns are in this array (..., n)."""
        memory: Memory = self._kind._of(array)
        return memory

    def _array_of(self, memory: tuple[Any, ...], arms: tuple[int, ...]) -> Array:
        """Columns of a memory as one array (..., n), for arms (...)."""
        if type(memory) is self._kind:
            return row_each(memory._array, arms, "state")
        if arms:
            columns = rows_of_arms(leaves(memory), self._memory_sizes, arms)
            shaped = [values.reshape(*arms, -1) if values.ndim > 1 else values for values in columns.values()]
            rows = [row_each(values, arms, name) for name, values in zip(columns, shaped, strict=True)]
        else:
            rows = Given(type(self).__name__, self._memory_sizes).arrays(leaves(memory))
        return np.concatenate(rows or [np.zeros((*arms, 0))], axis=-1)

    @property
    def kernel(self) -> Kernel | None:
        """Native code of the control law, a `Kernel`, which can also count its operations; None above 100 joints, where
        the law runs in Python.

        For r joints it takes measured positions p (r,) in rad (m if prismatic), velocities v (r,) in rad/s (m/s), the
        reference's positions, rad (m), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), (r,) each or, in a
        task space of d coordinates, (d,), the internal state as one array, its own arrays one after the other, and,
        where there are any, the g tunable numbers (g,) as in the property `packed`; it returns the torque (r,), N m
        (N), and the internal state after the control period as one array. Raises `InputError` where `law` returns
        anything else, `TraceError` where it cannot be traced.
        """
        return self._tick if isinstance(self._tick, Kernel) else None

    @property
    def python_step(self) -> OnFloats:
        """The control law as a Python function on arrays, run without native code and with the controller's own gains.

        For r joints it takes measured positions p (r,) in rad (m if prismatic), velocities v (r,) in rad/s (m/s), the
        reference's positions, rad (m), velocities, rad/s (m/s), and accelerations, rad/s^2 (m/s^2), (r,) each or, in a
        task space of d coordinates, (d,), and each array (n,) of the internal state, n its length, in the order of its
        fields, all by position; it returns a tuple: the torque (r,), N m (N), then each array of the internal state
        after the control period, in the same order. The function raises `InputError` on a wrong shape and
        `NonFiniteError` where the attribute `finite` asks for finite numbers.
        """
        sizes = self._given_sizes | self._memory_sizes
        return OnFloats(self._equation(), sizes, name=type(self).__name__, finite=self.finite)

    @cached_property
    def _tick(self) -> Kernel | OnFloats:
        """The law on arrays, compiled where that is possible in reasonable time."""
        return _compiled(self.structure)

    def _step_many(
        self, state: Memory, p: ArrayLike, v: ArrayLike, reference: ReferencePoint, gains: Array | None = None
    ) -> tuple[Array, Memory]:
        """A tick of arms (...) that each have their own memory."""
        arms = np.shape(p)[:-1]
        columns = rows_of_arms((p, v, *reference), self._given_sizes, arms)
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
        """Put the torques of arms (N, r) and their memories after a tick into the results."""
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
        """Number g of the controller's tunable gains, as a dict {"gains": g} whose key is the argument of the native
        code that holds them; the empty dict where there are none."""
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
        """A memory, to learn its layout from."""
        return self.initial_state(self.neutral_configuration, np.zeros(self.dof))

    @cached_property
    def _kind(self) -> type[PackedState]:
        """The type of memories in one array."""
        return packed_state(self._blank)

    def _packed_equation(self) -> Callable[..., tuple[Column, Column]]:
        """The law as an equation whose memory is one column."""
        equation, sizes = self._equation(), self._memory_sizes

        def packed(**columns: Column) -> tuple[Column, Column]:
            memory = iter(columns.pop(MEMORY))
            parts = {name: Column(islice(memory, size)) for name, size in sizes.items()}
            torque, *after = equation(**columns, **parts)
            return torque, Column(chain.from_iterable(after))

        return packed

    @property
    def _sizes(self) -> dict[str, int]:
        """Lengths of the columns that a tick is given."""
        return self._given_sizes | {MEMORY: sum(self._memory_sizes.values())} | self.gain_sizes

    @property
    def _form(self) -> Form:
        """Calling convention of one arm's tick: state, p, v, reference; the gains are bound to it."""
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
        raise NonFiniteError(f"{type(self).__name__}: the {what}{whose} is not finite, though all it was given is")


@lru_cache(maxsize=64)
def _compiled(structure: Structure) -> Kernel | OnFloats:
    """The law of controllers of one structure on arrays; that of the latest is kept."""
    law: Any = structure.of
    equation, about = law._packed_equation(), {"name": type(law).__name__, "finite": law.finite, "form": law._form}
    return native_or_floats(equation, law._sizes, law.dof, **about)
