"""Mutants: small changes of code, each of one operator, comparison, number or sign, or a check left out."""

from __future__ import annotations

import ast
import copy
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}

CHANGED = (ast.BinOp, ast.BoolOp, ast.AugAssign, ast.Compare, ast.UnaryOp, ast.Constant, ast.Expr)
"""Kinds of nodes that may have another form: to copy all others would take longer than all else"""


@dataclass(frozen=True)
class Mutant:
    """One change: its file, the number of the changed node in it, the function and the change.

    `again` tells changes of a function apart that read the same.
    """

    path: str
    node: int
    line: int
    function: str
    change: str
    again: int

    @property
    def key(self) -> str:
        """A name that stays when other functions of the file are edited."""
        return f"{self.path}::{self.function} {self.change}" + (f" (again {self.again})" if self.again else "")

    def lot(self, seed: int) -> str:
        """Its lot in a draw: other mutants that come or go change nothing in the order of the rest."""
        return hashlib.sha256(f"{seed} {self.key}".encode()).hexdigest()


def sites(path: str) -> Iterator[Mutant]:
    """Every mutant of a file."""
    tree = ast.parse((ROOT / path).read_text())
    met: Counter[tuple[str, str]] = Counter()
    for number, (node, function) in enumerate(visited(tree)):
        if not isinstance(node, CHANGED):
            continue
        before = ast.unparse(node)
        if mutate(node := copy.deepcopy(node)):
            after = "pass" if isinstance(node, ast.Expr) else ast.unparse(node)
            change = f"{before} -> {after}"
            yield Mutant(path, number, node.lineno, function, change, met[function, change])
            met[function, change] += 1


def visited(node: ast.AST, function: str = "<module>") -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Every expression and statement that may change, and the qualified name of the function it is in."""
    if isinstance(node, ast.expr | ast.stmt):
        yield node, function
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "msg", "bases"):
            continue
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
            continue
        if isinstance(node, ast.keyword) and node.arg == "strict":  # a check of what the code itself has made
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        inner = function
        if (isinstance(node, ast.FunctionDef) and name == "body") or (
            isinstance(node, ast.ClassDef) and name == "body"
        ):
            inner = node.name if function == "<module>" else f"{function}.{node.name}"
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from visited(child, inner)


def mutate(node: ast.AST) -> bool:
    """Change a node; False for one that has no other form."""
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign):
        return exchange(node, "op")
    if isinstance(node, ast.Compare):
        node.ops[0] = OPERATORS[type(node.ops[0])]()
        return True
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
        return True
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        node.value = not node.value if isinstance(node.value, bool) else changed(node.value)
        return True
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def changed(number: float) -> float:
    """Another number: one more of a whole one, twice or half of another."""
    return number + 1 if isinstance(number, int) or number == 0 else number * 2


def exchange(node: ast.BinOp | ast.BoolOp | ast.AugAssign, name: str) -> bool:
    """Put the opposite operator in place of a node's own; False where it has none."""
    other = OPERATORS.get(type(getattr(node, name)))
    if other is not None:
        setattr(node, name, other())
    return other is not None


def mutated(mutant: Mutant) -> ast.Module:
    """The module with the change."""
    tree = ast.parse((ROOT / mutant.path).read_text())
    node = next(node for number, (node, _) in enumerate(visited(tree)) if number == mutant.node)
    mutate(node)
    if isinstance(node, ast.Expr):
        node.value = ast.Constant(None)
    return ast.fix_missing_locations(tree)
