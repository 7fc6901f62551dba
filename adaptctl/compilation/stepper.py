"""Compiled steps of many members."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import accumulate
from threading import Thread
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import whole_count
from adaptctl.compilation.lanes import Array, LaneArray, Lanes, Precision
from adaptctl.compilation.llvm import PROLOGUE_SUFFIX, module_of, program, worth_a_module
from adaptctl.compilation.native import LEVEL, NativeCode, Processor, load, load_shared, optimization
from adaptctl.compilation.routine import Invariants, Operations, Routine, trace
from adaptctl.errors import InputError

ENTRY = "run"

NativeLoop = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 6, *[ctypes.c_void_p] * 5)
"""ENTRY takes the first block and the one after the last, the number of steps, the strides of shared, driven and
outputs, then the addresses of state, held, shared, driven and outputs.

In an array one block follows the other, in a block the columns of its source, and every scalar has all its lanes
side by side; shared has one block for all. A stride is how many numbers lie from step to step, 0 for an array without
steps.
"""


class Source(StrEnum):
    """Source of a step's argument."""

    STATE = "state"
    """of each member, replaced by the first results"""
    HELD = "held"
    """of each member, the same in all steps"""
    SHARED = "shared"
    """of all members, new in each step"""
    DRIVEN = "driven"
    """of each member, new in each step"""


def loop(routine: Routine, symbol: str, lanes: Lanes, columns: Mapping[Source, Sequence[int]], same: int = 0) -> str:
    """LLVM IR of `run`, which takes many steps of many members."""
    results, states = routine.layout.sizes, len(columns[Source.STATE])
    count = {str(source): sum(lengths) for source, lengths in columns.items()}
    inputs = {f"%{source}.at": lengths for source, lengths in columns.items()}
    pointers = _pointers(inputs | {"%next": results[:states], "%out.at": results[states:]})
    held = _pointers({_HELD: inputs[_HELD]})
    unread = [name if name in held else "ptr null" for name in _pointers(inputs)]
    before = f"call void @{symbol}{PROLOGUE_SUFFIX}({', '.join([*unread, 'ptr %same'])})" if same else ""
    return lanes.filled(
        "loop",
        **count,
        outputs=sum(results[states:]),
        bytes=lanes.alignment * count["state"],
        same=max(same, 1),
        held_places=_places(_HELD, inputs.pop(_HELD), lanes),
        before=before,
        places="\n".join(
            _places(base, lengths, Lanes(1, lanes.precision) if base == _SHARED else lanes)
            for base, lengths in (inputs | {"%next": results[:states], "%out.at": results[states:]}).items()
        ),
        routine=symbol,
        pointers=", ".join([*pointers, *(["ptr %same"] if same else [])]),
    )


_HELD, _SHARED = f"%{Source.HELD}.at", f"%{Source.SHARED}.at"


def _pointers(parts: Mapping[str, Sequence[int]]) -> list[str]:
    return [f"ptr {base}.{k}" for base, lengths in parts.items() for k in range(len(lengths))]


def _places(base: str, lengths: Sequence[int], lanes: Lanes) -> str:
    starts = zip(accumulate(lengths), lengths, strict=True)
    return "\n".join(
        f"  {base}.{k} = getelementptr {lanes.value}, ptr {base}, i64 {end - length}"
        for k, (end, length) in enumerate(starts)
    )


Columns = Mapping[str, int]
"""Names and lengths."""


def compile_step(
    step: Callable[..., Any],
    *,
    state: Columns,
    constants: Columns = MappingProxyType({}),
    inputs: Columns = MappingProxyType({}),
    per_member_inputs: Columns = MappingProxyType({}),
    lanes: int | None = None,
    name: str = "",
    processor: Processor | None = None,
    precision: Precision = "double",
    quick: bool = False,
) -> Stepper:
    """
    Compile a step that advances many independent systems (members) at once by SIMD instructions.

    Parameters
    ----------
    step : callable
        Function of `Column` vectors by keyword. It returns a tuple: the new state in the order of `state`, then
        outputs.
    state : mapping of str to int
        Lengths of the columns of the state, which each member has and each step replaces.
    constants : mapping of str to int, optional
        Lengths of the columns that each member has and keeps during a run. None by default.
    inputs : mapping of str to int, optional
        Lengths of the columns that are new in each step and the same for all members. None by default.
    per_member_inputs : mapping of str to int, optional
        Lengths of the columns that are new in each step and differ between members. None by default.
    lanes : int, optional
        Members computed at once: 1, 2, 4 or 8, in single precision also 16; by default as suits the processor.
    name : str, optional
        Name in messages; the function's own by default.
    processor : Processor, optional
        Processor to compile for; this machine's by default.
    precision : {"double", "single"}, default "double"
        Precision of the numbers. Double by default; single has twice the lanes, but 7 digits.
    quick : bool, default False
        True for few steps of one lane: the code is compiled in a third of the time, and takes a third longer. Results
        may differ by round-off; equations of arms give the same bits. By default it is optimized.

    Returns
    -------
    Stepper
        Native code of the step.

    Raises
    ------
    InputError
        If names repeat, a length is wrong, the result does not begin with the new state, or lanes or precision are
        unknown.
    TraceError
        If the step cannot be traced.

    Examples
    --------
    >>> from adaptctl.compilation import compile_step
    >>> fall = compile_step(lambda x, rate: (x - 0.5 * rate * x,), state={"x": 1}, constants={"rate": 1}, name="decay")
    >>> members = fall.ensemble(3)
    >>> members.state["x"], members.held["rate"] = [[1.0], [2.0], [4.0]], 1.0
    >>> _ = members.run(steps=2)
    >>> members.state["x"].ravel().tolist()
    [0.25, 0.5, 1.0]
    """
    columns = {Source.STATE: state, Source.HELD: constants, Source.SHARED: inputs, Source.DRIVEN: per_member_inputs}
    arguments = {name: length for part in columns.values() for name, length in part.items()}
    if len(arguments) < sum(map(len, columns.values())):
        raise InputError("state, constants, inputs and per_member_inputs: expected distinct names")
    target = processor or Processor.host()
    several = Lanes(target.lanes_of(precision) if lanes is None else whole_count(lanes, "lanes", 1), precision)
    return Stepper(trace(step, arguments, name=name), columns, several, target, quick)


class Stepper:
    """
    Compiled step that advances many independent systems (members) at once, as `compile_step` returns it.

    Parameters
    ----------
    routine : Routine
        Traced step.
    columns : mapping
        Names and lengths of the step's arguments by `Source`: state, constants ("held"), inputs ("shared") and inputs
        of each member ("driven").
    lanes : Lanes
        Number of members computed at once, and precision of the numbers.
    processor : Processor
        Processor to compile for.
    quick : bool, default False
        True for code of one lane that is compiled quickly.

    Raises
    ------
    InputError
        If the step's result is not a tuple that begins with the new state.

    Notes
    -----
    `operations` counts the scalar operations of a step of one member; those on constants alone are done once in a run
    and not counted.

    Examples
    --------
    >>> from adaptctl.compilation import compile_step
    >>> stepper = compile_step(lambda x: (0.5 * x, x), state={"x": 2}, name="halve")
    >>> stepper.outputs
    ((2,),)
    """

    def __init__(
        self,
        routine: Routine,
        columns: Mapping[Source, Columns],
        lanes: Lanes,
        processor: Processor,
        quick: bool = False,
    ) -> None:
        self.name, self.lanes = routine.name, lanes.count
        self.precision, self.dtype = lanes.precision, lanes.dtype
        self.columns = MappingProxyType({source: MappingProxyType(dict(part)) for source, part in columns.items()})
        state = columns[Source.STATE]
        self.outputs = routine.layout.shapes[len(state) :]
        if routine.layout.container is None or routine.layout.shapes[: len(state)] != tuple(
            (n,) for n in state.values()
        ):
            expected = ", ".join(f"{name} ({length})" for name, length in state.items())
            raise InputError(f"{self.name}: expected a tuple as result, starting with the new state: {expected}")
        same = Invariants.of(routine, range(len(state), len(state) + len(columns[Source.HELD])))
        self.operations = Operations(routine.operations)
        self.operations.subtract(x.op for x in same.computed)
        first = len(state) + len(columns[Source.HELD])
        self._called, apart = _shared(routine, lanes, processor) if lanes.count == 1 else ([], {})
        shared = range(first, first + len(columns[Source.SHARED]))
        quick = quick and lanes.count == 1 and optimization() == LEVEL
        made = program(routine, lanes, same, shared, apart, quick)
        lengths = {source: tuple(part.values()) for source, part in columns.items()}
        text, pieces = made.entered_by(loop(routine, made.symbol, lanes, lengths, len(same.stored)))
        self.quick, self._code = made.quick, load(text, processor, pieces)
        self.native = NativeLoop(self._code.address(ENTRY))

    def ensemble(self, members: int) -> Ensemble:
        """
        Allocate states and constants of an ensemble of members, all zero.

        Parameters
        ----------
        members : int
            Number of members, at least 1.

        Returns
        -------
        Ensemble
            States and constants of the members.

        Raises
        ------
        InputError
            If the number is no integer of at least 0.

        Examples
        --------
        >>> from adaptctl.compilation import compile_step
        >>> step = compile_step(lambda x, u: (x + u, x), state={"x": 1}, inputs={"u": 1}, name="sum")
        >>> step.ensemble(3).state["x"].shape
        (3, 1)
        """
        return Ensemble(self, members)

    def run_single(self, steps: int, state: Array, held: Array) -> Array:
        """
        Advance one member by some steps, faster than an ensemble of one.

        Parameters
        ----------
        steps : int
            Steps to take without a return to Python.
        state : ndarray
            Initial state (S,), S numbers in the step's units: its columns one after another; contiguous float64, not
            changed.
        held : ndarray
            Constants (H,), H numbers in the step's units: their columns one after another; contiguous float64.

        Returns
        -------
        ndarray
            State (S,) after the steps.

        Warnings
        --------
        Nothing is checked: the step must have one lane, double precision and no inputs or outputs, and the arrays these
        lengths; otherwise memory is accessed out of bounds.

        Examples
        --------
        >>> from adaptctl.compilation import compile_step
        >>> stepper = compile_step(lambda x: (0.5 * x,), state={"x": 1}, lanes=1, name="halve")
        >>> stepper.run_single(2, np.array([4.0]), np.empty(0)).tolist()
        [1.0]
        """
        after = state.copy()
        self.native(0, 1, steps, 0, 0, 0, after.ctypes.data, held.ctypes.data, None, None, None)
        return after


def _shared(routine: Routine, lanes: Lanes, processor: Processor) -> tuple[list[NativeCode], dict[Routine, str]]:
    """Code that a routine shares with others, and its functions' names."""
    modules = {r: module_of(r, lanes, repr(processor)) for r in worth_a_module(routine)}
    codes = [load_shared(text, [symbol], processor) for text, symbol in modules.values()]
    return codes, {r: symbol for r, (_, symbol) in modules.items()}


class Signals(NamedTuple):
    """Buffers for the inputs of some steps of an ensemble."""

    shared: LaneArray
    driven: LaneArray


class Ensemble:
    """
    States of many independent systems (members) that a compiled step advances together.

    `Stepper.ensemble` makes it. `state` and `held` (constants) are arrays (members, n) by name, zero at first, which
    can be read and assigned between runs.

    Parameters
    ----------
    stepper : Stepper
        Compiled step.
    members : int
        Number of members, at least 1.

    Raises
    ------
    InputError
        If the number is wrong.

    Examples
    --------
    >>> from adaptctl.compilation import compile_step
    >>> stepper = compile_step(lambda x, u: (x + u, x), state={"x": 1}, inputs={"u": 1}, name="sum")
    >>> members = stepper.ensemble(3)
    >>> (recorded,) = members.run(steps=2, signals={"u": [[1.0], [2.0]]}, record=True)
    >>> recorded.shape, float(members.state["x"][0, 0])
    ((2, 3, 1), 3.0)
    """

    def __init__(self, stepper: Stepper, members: int) -> None:
        self.stepper, self.members = stepper, whole_count(members, "members", 1)
        self.state = self._array(stepper.columns[Source.STATE])
        self.held = self._array(stepper.columns[Source.HELD])
        self._outputs = {str(k): math.prod(shape) for k, shape in enumerate(stepper.outputs)}
        self._latest, self._recorded = self._array(self._outputs), self._array(self._outputs, 0)
        self._nothing = self.signals(0)

    def run(
        self,
        steps: int = 1,
        signals: Mapping[str, ArrayLike] = MappingProxyType({}),
        *,
        record: bool = False,
        threads: int = 1,
    ) -> tuple[Array, ...]:
        """
        Advance all members by some steps.

        Parameters
        ----------
        steps : int, default 1
            Steps to take. One by default, for loops that change inputs between steps.
        signals : mapping of str to array_like, optional
            Inputs by name in the step's units, which broadcast to (steps, n), or (steps, members, n) for inputs of each
            member. NaN is not refused.
        record : bool, default False
            If true, outputs of all steps are returned. By default those of the last alone, which need less memory.
        threads : int, default 1
            Number of threads that share the members. 1, as more than one is faster only for runs of milliseconds.

        Returns
        -------
        tuple of ndarray
            Outputs (members, ...), or (steps, members, ...) if recorded, in float64.

        Raises
        ------
        InputError
            If a number is wrong, or signals have other names or shapes or are not real.

        Examples
        --------
        >>> from adaptctl.compilation import compile_step
        >>> step = compile_step(lambda x, u: (x + u, x), state={"x": 1}, inputs={"u": 1}, name="sum")
        >>> members = step.ensemble(3)
        >>> (last,) = members.run(steps=2, signals={"u": [[1.0], [2.0]]})
        >>> last.ravel().tolist(), members.state["x"].ravel().tolist()
        ([1.0, 1.0, 1.0], [3.0, 3.0, 3.0])
        """
        if type(steps) is not int or steps < 0:
            steps = whole_count(steps, "steps")
        if type(threads) is not int or threads < 1:
            threads = whole_count(threads, "threads", 1)
        outputs = self._record(steps) if record else self._latest
        work = _Work(self, steps, self._signals(steps, signals), outputs, outputs.stride if record else 0)
        self._run(threads, work)
        axes = (steps, self.members) if record else (self.members,)
        parts = zip(outputs.columns, self.stepper.outputs, strict=True)
        return tuple(outputs[name].reshape(*axes, *shape) for name, shape in parts)

    def allocate_outputs(self, steps: int) -> LaneArray:
        """
        Allocate an output buffer of several steps for `record_into`.

        Parameters
        ----------
        steps : int
            Steps whose outputs the buffer holds.

        Returns
        -------
        LaneArray
            Uninitialised columns "0", "1", ... of shape (steps, members, n), one for each output of the step.

        Raises
        ------
        InputError
            If the number is no integer of at least 0.
        """
        return self._array(self._outputs, steps, made=np.empty)

    def signals(self, steps: int) -> Signals:
        """
        Allocate input buffers of several steps for `record_into`.

        Parameters
        ----------
        steps : int
            Steps for which the buffers hold inputs.

        Returns
        -------
        Signals
            Uninitialised arrays by input name, to be filled: `shared` (steps, 1, n) for inputs equal for all members,
            `driven` (steps, members, n) for the others.

        Raises
        ------
        InputError
            If the number is no integer of at least 0.

        Examples
        --------
        >>> from adaptctl.compilation import compile_step
        >>> step = compile_step(lambda x, u: (x + u, x), state={"x": 1}, inputs={"u": 1}, name="sum")
        >>> members = step.ensemble(3)
        >>> signals, outputs = members.signals(2), members.allocate_outputs(2)
        >>> signals.shared["u"] = [[[1.0]], [[2.0]]]
        >>> members.record_into(outputs, 0, 2, signals)
        >>> outputs["0"][:, 0].tolist()
        [[0.0], [1.0]]
        """
        columns = self.stepper.columns
        shared = LaneArray(columns[Source.SHARED], 1, 1, (steps,), self.stepper.dtype, np.empty)
        return Signals(shared, self._array(columns[Source.DRIVEN], steps, made=np.empty))

    def record_into(self, room: LaneArray, first: int, steps: int, signals: Mapping[str, ArrayLike] | Signals) -> None:
        """
        Advance all members by some steps and write their outputs into a buffer.

        Parameters
        ----------
        room : LaneArray
            Buffer that `allocate_outputs` made.
        first : int
            Index of the step in the buffer at which to begin.
        steps : int
            Steps to take, each of which fills one row of the buffer.
        signals : mapping or Signals
            Inputs by name, as in `run`, or `Signals`, read in place from index `first` on.

        Raises
        ------
        InputError
            If steps do not fit, or a buffer or signal is not this ensemble's.

        Examples
        --------
        >>> from adaptctl.compilation import compile_step
        >>> step = compile_step(lambda x, u: (x + u, x), state={"x": 1}, inputs={"u": 1}, name="sum")
        >>> members = step.ensemble(2)
        >>> outputs = members.allocate_outputs(3)
        >>> members.record_into(outputs, 0, 3, {"u": np.ones((3, 1))})
        >>> outputs["0"][:, 0].tolist()
        [[0.0], [1.0], [2.0]]
        """
        first, steps = whole_count(first, "record: first"), whole_count(steps, "record: steps")
        _require(room, self._recorded, first, steps, "room")
        if isinstance(signals, Signals):
            for given, own in zip(signals, self._nothing, strict=True):
                _require(given, own, first, steps, "signals")
            work = _Work(self, steps, signals, room, room.stride, first, first)
        else:
            work = _Work(self, steps, self._signals(steps, signals), room, room.stride, 0, first)
        self._run(1, work)

    def _record(self, steps: int) -> LaneArray:
        if len(self._recorded.blocks) != steps:
            self._recorded = self._array(self._outputs, steps)
        return self._recorded

    def _run(self, threads: int, work: _Work) -> None:
        blocks = len(self.state.blocks)
        count = min(threads, blocks)
        shares = [(blocks * k // count, blocks * (k + 1) // count) for k in range(count)]
        others = [Thread(target=work.take, args=share) for share in shares[1:]]
        try:
            for thread in others:
                thread.start()
            work.take(*shares[0])
        finally:
            _wait_for(others)

    def _signals(self, steps: int, signals: Mapping[str, ArrayLike]) -> Signals:
        columns = self.stepper.columns
        expected = [*columns[Source.SHARED], *columns[Source.DRIVEN]]
        if set(signals) != set(expected):
            raise InputError(f"signals: expected {', '.join(expected) or 'none'}, got {', '.join(signals) or 'none'}")
        if not expected:
            return self._nothing
        rows = LaneArray(columns[Source.SHARED], steps, dtype=self.stepper.dtype)
        driven = self._array(columns[Source.DRIVEN], steps)
        for name, values in signals.items():
            (rows if name in rows.columns else driven)[name] = values
        return Signals(rows, driven)

    def _array(self, columns: Columns, *steps: int, made: Callable[..., Any] = np.zeros) -> LaneArray:
        return LaneArray(columns, self.members, self.stepper.lanes, steps, self.stepper.dtype, made)


class _Work(NamedTuple):
    ensemble: Ensemble
    steps: int
    signals: Signals
    outputs: LaneArray
    stride: int
    """numbers between the outputs of a step and the next; 0 where each replaces the one before"""
    read: int = 0
    """index of the first step among the signals"""
    written: int = 0
    """index of the first step among the outputs"""

    def take(self, first: int, last: int) -> None:
        members = self.ensemble
        strides = *(part.stride for part in self.signals), self.stride
        signals = (part.address_of(self.read) for part in self.signals)
        arrays = members.state.address, members.held.address, *signals, self.outputs.address_of(self.written)
        members.stepper.native(first, last, self.steps, *strides, *arrays)


def _require(given: LaneArray, own: LaneArray, first: int, steps: int, name: str) -> None:
    if not isinstance(given, LaneArray) or _form(given) != _form(own):
        raise InputError(f"record: {name}: expected an array made by this ensemble")
    if first + steps > len(given.blocks):
        raise InputError(
            f"record: {name}: expected steps from 0 to {len(given.blocks)}, got {first} to {first + steps}"
        )


def _form(room: LaneArray) -> tuple[Any, ...]:
    return room.columns, room.members, room.blocks.shape[1:], room.blocks.dtype


def _wait_for(threads: Sequence[Thread]) -> None:
    interrupt: KeyboardInterrupt | None = None
    for thread in threads:
        while thread.is_alive():
            try:
                thread.join()
            except KeyboardInterrupt as error:
                interrupt = error
    if interrupt is not None:
        raise interrupt
