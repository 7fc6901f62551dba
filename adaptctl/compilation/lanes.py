"""LLVM types and attributes for numbers side by side in SIMD lanes, in double or single precision."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Literal, TypeAlias, get_args

import numpy as np

from adaptctl.errors import InputError

Precision: TypeAlias = Literal["double", "single"]
"""IEEE 754's binary64, of 53 bits, or binary32, of 24."""


@dataclass(frozen=True)
class Lanes:
    """The LLVM types for `count` numbers worked on by one instruction (SIMD lanes): vectors, or plain numbers when it
    is 1."""

    count: int = 1
    precision: Precision = "double"

    def __post_init__(self) -> None:
        require_precision(self.precision)
        if self.count not in (1, 2, 4, 8, 16)[: 5 if self.precision == "single" else 4]:
            raise InputError(f"lanes: expected 1, 2, 4 or 8, or 16 in single precision, got {self.count}")

    @property
    def size(self) -> int:
        """Size of a number, bytes."""
        return 8 if self.precision == "double" else 4

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """The numbers' type in arrays."""
        return np.dtype(f"f{self.size}")

    @property
    def scalar(self) -> str:
        """The LLVM type of one number."""
        return "double" if self.precision == "double" else "float"

    @property
    def value(self) -> str:
        """The LLVM type of the lanes' numbers."""
        return self._of(self.scalar)

    @property
    def integer(self) -> str:
        """The LLVM type of whole numbers of as many bits."""
        return self._of(self._whole)

    @property
    def condition(self) -> str:
        """The LLVM type of the lanes' comparison."""
        return self._of("i1")

    @property
    def suffix(self) -> str:
        """The suffix by which intrinsics name the lanes."""
        bits = f"f{8 * self.size}"
        return bits if self.count == 1 else f"v{self.count}{bits}"

    @property
    def alignment(self) -> int:
        """Alignment of the lanes in memory, bytes."""
        return self.size * self.count

    @property
    def attributes(self) -> str:
        """LLVM attributes of every function on lanes: the stack is aligned so that no spilled vector straddles a cache
        line."""
        return "nounwind" if self.count == 1 else f'nounwind "stackrealign" alignstack({self.alignment})'

    def constant(self, x: float) -> str:
        """The LLVM constant of a number in every lane, as the digits of its bits."""
        digits = f"0x{struct.pack('>d', self.rounded(x)).hex()}"  # of a double in either precision
        return digits if self.count == 1 else "<" + ", ".join([f"{self.scalar} {digits}"] * self.count) + ">"

    def rounded(self, x: float) -> float:
        """The number of this precision that stands for x: what is finite and not 0 stays so."""
        return x if self.precision == "double" else single(x)

    def whole(self, k: int) -> str:
        """The LLVM constant of a whole number in every lane."""
        return str(k) if self.count == 1 else "<" + ", ".join([f"{self._whole} {k}"] * self.count) + ">"

    def filled(self, name: str, **values: object) -> str:
        """The text of `name`.ll, with these types and other values in place of its $names."""
        types = ("scalar", "value", "integer", "condition", "suffix", "count", "alignment", "attributes")
        template = Template(Path(__file__).with_name(f"{name}.ll").read_text(encoding="utf-8"))
        return template.substitute({of: getattr(self, of) for of in types}, **values)

    @property
    def _whole(self) -> str:
        return f"i{8 * self.size}"

    def _of(self, kind: str) -> str:
        return kind if self.count == 1 else f"<{self.count} x {kind}>"


def require_precision(precision: object) -> None:
    """Raise `InputError` for what is no `Precision`."""
    if precision not in get_args(Precision):
        raise InputError(f"precision: expected one of {', '.join(get_args(Precision))}, got {precision!r}")


def single(x: float) -> float:
    """The number of single precision that stands for x: what is finite and not 0 stays so."""
    if not math.isfinite(x) or x == 0.0:
        return x
    limits = np.finfo(np.float32)
    within = min(max(abs(x), float(limits.tiny)), float(limits.max))
    return math.copysign(float(np.float32(within)), x)
