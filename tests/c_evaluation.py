"""C functions of straight lines and counted loops, parsed and run on Python's floats: what a compiler makes of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import pycparser
from pycparser import c_ast

LIBRARY: dict[str, Callable[[float], float]] = {
    "sqrt": math.sqrt, "fabs": abs, "rint": lambda x: float(round(x)) if math.isfinite(x) else x,
}  # fmt: skip
OPERATORS = {"+", "-", "*", "/", "%", "<", "<="}


def functions_of(text: str, prefix: str) -> dict[str, Callable[..., None]]:
    """The functions of a text by name; pointers are lists, or objects whose attributes are lists.

    `PREFIX_sincos` is Python's sine and cosine, whatever the text says of it.
    """
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).replace(f"{prefix.upper()}_RESTRICT", "")
    names = f"typedef double {prefix}_real; typedef struct m {prefix}_memory; typedef struct g {prefix}_gains;"
    bare = _without_sine(bare, prefix)
    tree = pycparser.CParser().parse(f"{names} typedef struct r {prefix}_reference; {bare}")
    made: dict[str, Any] = {"Part": Part, f"{prefix}_sincos": _sincos, "NULL": None} | LIBRARY
    for item in tree.ext:
        if isinstance(item, c_ast.FuncDef):
            exec(compile(_python(item), item.decl.name, "exec"), made)
    return made


def _without_sine(text: str, prefix: str) -> str:
    """The text without the function that needs the bits of numbers."""
    head = f"static void {prefix}_sincos"
    if head not in text:
        return text
    start = text.index(head)
    return text[:start] + text[text.index("\n}\n", start) + 3 :]


def _sincos(x: float, s: list[float], c: list[float]) -> None:
    s[0], c[0] = math.sin(x), math.cos(x)


def _python(function: c_ast.FuncDef) -> str:
    parameters = function.decl.type.args.params if function.decl.type.args else []
    head = f"def {function.decl.name}({', '.join(p.name for p in parameters)}):"
    return "\n".join([head, *_lines(function.body, "    ")])


def _lines(block: c_ast.Compound, margin: str) -> list[str]:
    lines = []
    for item in block.block_items or []:
        if isinstance(item, c_ast.For):
            (counter,) = item.init.decls
            lines.append(f"{margin}for {counter.name} in range({_whole(counter.init)}, {_whole(item.cond.right)}):")
            lines += _lines(item.stmt, f"{margin}    ")
        else:
            lines.append(f"{margin}{_statement(item)}")
    return [*lines, f"{margin}pass"]


def _whole(node: Any) -> str:
    """Arithmetic of whole numbers, which are never negative where they are divided."""
    return _text(node).replace("/", "//")


class Part:
    """Numbers from a place of a list on."""

    def __init__(self, of: Any, first: int) -> None:
        self.of, self.first = of, first

    def __getitem__(self, k: int) -> Any:
        return self.of[self.first + k]

    def __setitem__(self, k: int, value: Any) -> None:
        self.of[self.first + k] = value


def _statement(node: Any) -> str:
    if isinstance(node, c_ast.Decl):
        return f"{node.name} = {_initial(node)}"
    if isinstance(node, c_ast.Assignment):
        assert node.op == "="
        return f"{_text(node.lvalue)} = {_text(node.rvalue)}"
    if isinstance(node, c_ast.Return):
        return f"return {_text(node.expr)}"
    if isinstance(node, c_ast.Cast):
        return _copy(node.expr) if isinstance(node.expr, c_ast.FuncCall) else "pass"
    if isinstance(node, c_ast.If):
        assert node.iffalse is None
        return f"if {_text(node.cond)}: {'; '.join(map(_statement, node.iftrue.block_items))}"
    assert isinstance(node, c_ast.FuncCall), node
    call = _text(node)
    turned = re.findall(r"@(\w+)", call)
    if not turned:
        return call
    boxes = "; ".join(f"{name}_box = [0.0]" for name in turned)
    return "; ".join([boxes, re.sub(r"@(\w+)", r"\1_box", call), *(f"{name} = {name}_box[0]" for name in turned)])


def _copy(node: Any) -> str:
    """Numbers side by side, from one list to another."""
    assert node.name.name == "memcpy", node
    to, of, size = node.args.exprs
    count = int(size.left.value.rstrip("u"))
    places = []
    for place in (to.expr, of.expr):
        first = int(place.subscript.value)
        places.append(f"{_text(place.name)}[{first}:{first + count}]")
    return " = ".join(places)


def _initial(node: c_ast.Decl) -> str:
    if isinstance(node.init, c_ast.InitList):
        given = f"[{', '.join(map(_text, node.init.exprs))}]"
        return f"{given} + [0.0] * ({node.type.dim.value} - {len(node.init.exprs)})"
    if isinstance(node.type, c_ast.ArrayDecl):
        return f"[float('nan')] * {node.type.dim.value}"
    return _text(node.init) if node.init is not None else "None"


def _text(node: Any) -> str:
    match node:
        case c_ast.ID():
            return str(node.name)
        case c_ast.Constant():
            value = node.value.rstrip("fF") if "x" not in node.value else node.value.rstrip("f")
            return repr(float.fromhex(value)) if "x" in value else value
        case c_ast.BinaryOp() if node.op in (*OPERATORS, "!=", ">"):
            return f"({_text(node.left)} {node.op} {_text(node.right)})"
        case c_ast.BinaryOp() if node.op == "||":
            return f"({_text(node.left)} or {_text(node.right)})"
        case c_ast.UnaryOp() if node.op == "-":
            return f"(-{_text(node.expr)})"
        case c_ast.UnaryOp() if node.op == "&" and isinstance(node.expr, c_ast.ArrayRef):
            return f"Part({_text(node.expr.name)}, {_whole(node.expr.subscript)})"
        case c_ast.UnaryOp() if node.op == "&":
            return f"@{_text(node.expr)}"
        case c_ast.TernaryOp():
            return f"({_text(node.iftrue)} if {_text(node.cond)} else {_text(node.iffalse)})"
        case c_ast.ArrayRef():
            return f"{_text(node.name)}[{_whole(node.subscript)}]"
        case c_ast.StructRef() if node.type == "->":
            return f"{_text(node.name)}.{node.field.name}"
        case c_ast.FuncCall():
            return f"{_text(node.name)}({', '.join(map(_text, node.args.exprs))})"
    raise AssertionError(f"not expected in C: {node}")
