"""Random equations in three unknowns, kept well away from poles, for hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from hypothesis import strategies as st

from adaptctl.scalars import absolute, cos, maximum, minimum, sin, sqrt, where

Tree: TypeAlias = Any
"""The index of an unknown, a constant, or an operation's name and its operands."""

OPERATIONS: dict[str, tuple[int, Callable[..., Any], Callable[..., Any]]] = {
    # name: number of operands, meaning, and how errors grow: a bound on value and on error per unit round-off
    "+": (2, lambda a, b: a + b, lambda a, b: a + b),
    "-": (2, lambda a, b: a - b, lambda a, b: a + b),
    "*": (2, lambda a, b: a * b, lambda a, b: a * b),
    "/": (2, lambda a, b: a / (2.0 + sin(b)), lambda a, b: a * b),
    "neg": (1, lambda a: -a, lambda a: a),
    "sin": (1, sin, lambda a: a),
    "cos": (1, cos, lambda a: a),
    "sqrt": (1, lambda a: sqrt(1.0 + absolute(a)), lambda a: 1.0 + a),
    "min": (2, minimum, lambda a, b: a + b),
    "max": (2, maximum, lambda a, b: a + b),
}

_leaves = st.integers(0, 2) | st.sampled_from((0.0, 1.0, -1.0, 2.0, -0.5, 0.1))


def _grown(children: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    calls = [st.tuples(st.just(name), *[children] * n) for name, (n, _, _) in OPERATIONS.items()]
    # Only unknowns are compared: round-off may tip a comparison of anything else.
    choices = st.tuples(st.just("where"), st.integers(0, 2), st.integers(0, 2), children, children)
    return st.one_of(*calls, choices)


trees = st.recursive(_leaves, _grown, max_leaves=30)


def evaluated(tree: Tree, x: Sequence[Any]) -> Any:
    """The tree's value at the unknowns x."""
    if not isinstance(tree, tuple):
        return x[tree] if isinstance(tree, int) else tree
    name, *operands = tree
    if name == "where":
        i, j, yes, no = operands
        return where(x[i] < x[j], evaluated(yes, x), evaluated(no, x))
    return OPERATIONS[name][1](*(evaluated(operand, x) for operand in operands))


def size(tree: Tree, x: Sequence[float]) -> float:
    """What the tree's rounding errors are relative to: at least 1, and its value without cancellation."""
    if not isinstance(tree, tuple):
        return 1.0 + abs(x[tree] if isinstance(tree, int) else tree)
    name, *operands = tree
    if name == "where":
        return size(operands[2], x) + size(operands[3], x)
    return float(OPERATIONS[name][2](*(size(operand, x) for operand in operands)))
