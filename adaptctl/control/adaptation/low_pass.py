"""Low-pass filters of columns, as loops where these are long."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from adaptctl.compilation.loops import Interpreter, vector
from adaptctl.compilation.matrix_operation import MatrixOperation
from adaptctl.scalars import Column


def washed_out(x: Column, rate: Column, before: Column, weights: tuple[Any, Any, Any, Any]) -> tuple[Column, Column]:
    """
    Columns x times the cutoff, less the same plus its rate through a filter of a linear input, and the filter's state.

    `weights` are the cutoff, what is kept of the state, and the input's values at the end and at the start.
    """
    out, after = _washed_out(len(x))(x, rate, before, Column(weights))
    return out, after


def low_pass(x: Column, before: Column, keep: Any) -> Column:
    """State of a filter of a held input, of which a share is kept."""
    return _low_pass(len(x))(x, before, Column((keep, 1.0 - keep)))[0]


@cache
def _washed_out(size: int) -> MatrixOperation:
    def washed_out(m: Interpreter, x: Any, rate: Any, before: Any, weights: Any, out: Any, after: Any) -> None:
        cutoff, keep, end, start = (weights[c] for c in range(4))
        for j in m.columns(0, size):
            scaled = cutoff * x[j]
            now = scaled + rate[j]
            filtered = before[j] + end * now
            out[j] = scaled - filtered
            after[j] = keep * filtered + start * now

    return MatrixOperation(washed_out, [*[vector(size)] * 3, vector(4)], [vector(size)] * 2, math.isqrt(2 * size))


@cache
def _low_pass(size: int) -> MatrixOperation:
    def low_pass(m: Interpreter, x: Any, before: Any, weights: Any, out: Any) -> None:
        for j in m.columns(0, size):
            out[j] = weights[0] * before[j] + weights[1] * x[j]

    return MatrixOperation(low_pass, [*[vector(size)] * 2, vector(2)], [vector(size)], math.isqrt(2 * size))
