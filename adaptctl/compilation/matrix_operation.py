"""Operations on matrices, as loops where they are large."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from adaptctl.caching import cached_property
from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.loops import Entries, Interpreter, SampleArray, Sampled, Shape, Unrolled
from adaptctl.compilation.node import Node, lift
from adaptctl.compilation.recorded_loops import LoopRoutine, Memory, RecordedArray, Recorder
from adaptctl.compilation.routine import Routine, numbered, trace
from adaptctl.scalars import Column

MAX_STRAIGHT_SIZE = 12
"""Rows of a matrix up to which an operation is straight-line code, which is faster (0.2 against 0.6 us at 4, 1.3
against 1.1 at 15)."""


class MatrixOperation:
    """
    Operation on matrices, written once as loops (see `Interpreter`), for every kind of scalar.

    Called with a column for each argument it returns a tuple of columns. In a trace it is a call of native loops, or
    straight-line code where the matrices are small.
    """

    def __init__(
        self, body: Callable[..., None], inputs: Sequence[Shape], outputs: Sequence[Shape], size: int, name: str = ""
    ) -> None:
        self.name, self._body, self._small = name or body.__name__.strip("_"), body, size <= MAX_STRAIGHT_SIZE
        self._shapes = tuple(inputs), tuple(outputs)

    def __call__(self, *arguments: Column) -> tuple[Column, ...]:
        """Results for a column for each argument."""
        scalars = [x for argument in arguments for x in argument]
        kinds = {type(x) for x in scalars}
        traced = next((x for x in scalars if isinstance(x, Node)), None)
        if traced is not None and not self._small:
            return self._called(traced, scalars)
        if self._small or not all(issubclass(kind, float | np.ndarray) for kind in kinds):
            return self._unrolled(arguments)
        return self._sampled(arguments)

    @cached_property
    def routine(self) -> LoopRoutine:
        """Recorded loops."""
        recorder = Recorder()
        given = [
            RecordedArray(recorder, Memory(kind, k, shape))
            for kind, shapes in zip(("in", "out"), self._shapes, strict=True)
            for k, shape in enumerate(shapes)
        ]
        self._body(recorder, *given)
        return LoopRoutine(self.name, self._shapes, recorder.steps, recorder.scratches, recorder.locals, self._straight)

    def _straight(self) -> Routine:
        """Straight-line code of this operation."""
        sizes = {f"in{k}": shape.size for k, shape in enumerate(self._shapes[0])}
        return trace(lambda **given: self._unrolled(tuple(given.values())), sizes, name=self.name)

    def _called(self, traced: Node, scalars: Sequence[Any]) -> tuple[Column, ...]:
        graph = traced.graph
        call = graph.make(Expression, Op.CALL, *map(lift, scalars), detail=self.routine)
        results = (graph.make(Node, Op.RESULT, call, detail=at) for at in numbered(self.routine.layout.sizes))
        columns: tuple[Column, ...] = self.routine.layout.restored(list(results))
        return columns

    def _unrolled(self, arguments: Sequence[Column]) -> tuple[Column, ...]:
        machine: Interpreter = Unrolled()
        given = [Entries(list(x), shape) for x, shape in zip(arguments, self._shapes[0], strict=True)]
        made = [Entries([0.0] * shape.size, shape) for shape in self._shapes[1]]
        self._body(machine, *given, *made)
        return tuple(Column(array.of) for array in made)

    def _sampled(self, arguments: Sequence[Column]) -> tuple[Column, ...]:
        axes = np.broadcast_shapes(*(np.shape(x) for argument in arguments for x in argument))
        given = [
            SampleArray(np.stack([np.broadcast_to(x, axes) for x in argument], axis=-1), shape)
            for argument, shape in zip(arguments, self._shapes[0], strict=True)
        ]
        made = [SampleArray(np.zeros((*axes, shape.size)), shape) for shape in self._shapes[1]]
        self._body(Sampled(axes), *given, *made)
        return tuple(_column(array.of) for array in made)


def _column(samples: Any) -> Column:
    return Column(samples.tolist() if samples.ndim == 1 else np.moveaxis(samples, -1, 0))
