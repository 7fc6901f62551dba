"""One period of a memory with quarantine: both matrices, and the parameter step, in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, reduce
from operator import add
from typing import Any, NamedTuple

from adaptctl.compilation.loops import Interpreter, Shape, Triangle, matrix, vector
from adaptctl.compilation.matrix_operation import MatrixOperation
from adaptctl.control.adaptation.elimination import ROWS_AT_ONCE, Elimination, groups
from adaptctl.control.adaptation.symmetric import copied, joined
from adaptctl.scalars import Column, Scalar

MAX_SUM_IN_ORDER = 5
"""terms of a sum that are added one after the other"""


class Flow(NamedTuple):
    """Parts of the memory A and of quarantine N in a period: A is kept, N stays or leaves for A, A is recalled."""

    keep: Scalar
    leave: Scalar
    stay: Scalar
    recall: Scalar


class RecalledStep(NamedTuple):
    """Triangles of A and N after the period, the step (k,), and what the memory leaves unsure (r + b,) of the rows."""

    information: Column
    pending: Column
    step: Column
    unsure: Column


def recalled_step(
    information: Column, pending: Column, rows: Sequence[Column], shares: Column, flow: Flow, x: Column, right: Column,
    beside: Sequence[Column] = (),
) -> RecalledStep:  # fmt: skip
    """
    RecalledStep of A = keep A + leave N and N = stay N + W' diag(shares) W, of the rows of W.

    The step solves (A + 1) step = right + (recall keep A + leave N) x, of the A and N before; unsure are the forms
    w' (A + 1)^-1 w, of the rows and of b others beside them, which are not stored.
    """
    period = _period(len(x), len(rows), len(beside))
    return RecalledStep(*period(information, pending, joined([*rows, *beside]), shares, Column(flow), x, right))


@cache
def _period(k: int, r: int, beside: int) -> MatrixOperation:
    lines = r + beside

    def recalled_step(
        m: Interpreter, A: Any, N: Any, rows: Any, shares: Any, flow: Any, given: Any, right: Any,
        A_out: Any, N_out: Any, step: Any, unsure: Any,
    ) -> None:  # fmt: skip
        keep, leave, stay, recall = (flow[c] for c in range(4))
        w, recalled, system = copied(m, rows, lines, k), m.scratch(k, k), Elimination(m, k, 1 + lines)
        for i in m.range(k):
            gains = [shares[q] * w[q, i] for q in range(r)]
            for j in m.columns(i, k):
                kept, new = keep * A[i, j], leave * N[i, j]
                A_out[i, j] = kept + new
                system.upper[i, j] = kept + new
                recalled[i, j] = recall * kept + new
                N_out[i, j] = _sum([stay * N[i, j], *(gain * w[q, j] for q, gain in enumerate(gains))])
            for q in m.range(lines):
                system.upper[i, q + k + 1] = w[q, i]
            system.complete(i, 1.0)
        _force(m, recalled, copied(m, given, 1, k), right, system)
        system.run()
        solved, forms = system.solution(), m.scratch(k + 1 + lines)
        for j in m.columns(0, k):
            step[j] = solved[j]
        for i in m.range(k):
            for j in m.columns(k + 1, k + 1 + lines):
                forms[j] = forms[j] + (system.upper[i, j] * system.upper[i, j]) * system.inverse[i]
        for q in m.range(lines):
            unsure[q] = forms[q + k + 1]

    given: list[Shape] = [Triangle(k), Triangle(k), matrix(lines, k), vector(r), vector(4), vector(k), vector(k)]
    return MatrixOperation(recalled_step, given, [Triangle(k), Triangle(k), vector(k), vector(lines)], k)


def _sum(terms: Sequence[Any]) -> Any:
    """Sum of terms, in two halves where there are many, so that neither waits for the other."""
    if len(terms) > MAX_SUM_IN_ORDER:
        half = (len(terms) + 1) // 2
        return _sum(terms[:half]) + _sum(terms[half:])
    return reduce(add, terms)


def _force(m: Interpreter, R: Any, x: Any, right: Any, system: Elimination) -> None:
    """First right side R x + right, R symmetric with zeros below its diagonal: what rows add to later ones is kept."""
    k = system.k
    before = m.scratch(k)
    for rows in groups(m, k, ROWS_AT_ONCE):
        totals = [m.sum() for _ in rows]
        for j in m.columns(rows[0], k):
            right_of = x[0, j]
            for i, total in zip(rows, totals, strict=True):
                total.add(j, R[i, j] * right_of)
        own = [x[0, i] for i in rows]
        for c, i in enumerate(rows):
            product = before[i] + totals[c].value
            for above, entry in zip(rows[:c], own, strict=False):
                product = product + R[above, i] * entry
            system.upper[i, k] = right[i] + product
        for j in m.columns(rows[-1] + 1, k):
            product = before[j]
            for i, entry in zip(rows, own, strict=True):
                product = product + R[i, j] * entry
            before[j] = product
