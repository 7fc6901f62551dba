"""Numbers in C: how the two kinds are written, what they are called with, and how far their sines reach."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from adaptctl.compilation.lanes import Precision, single

Kind: TypeAlias = Literal["double", "float"]


@dataclass(frozen=True)
class CNumber:
    """A kind of number in C, and `names`: the meanings of constants by magnitude, written beside them."""

    kind: Kind
    names: Mapping[float, str]

    @property
    def precision(self) -> Precision:
        """The numbers' precision."""
        return "double" if self.kind == "double" else "single"

    @property
    def size(self) -> int:
        """Size of a number in bytes."""
        return 8 if self.kind == "double" else 4

    @property
    def suffix(self) -> str:
        """Suffix of constants and of math.h's functions."""
        return "" if self.kind == "double" else "f"

    def rounded(self, x: float) -> float:
        """The number of this kind that stands for x: what is finite and not 0 stays so."""
        return x if self.kind == "double" else single(x)

    def constant(self, x: float) -> str:
        """The C text of a number, without the name of what it stands for: hexadecimal unless it is short, since not
        every compiler reads decimal digits alike."""
        if math.isinf(x):
            huge = f"HUGE_VAL{self.suffix.upper()}"  # INFINITY is a float
            return f"(-{huge})" if x < 0.0 else huge
        rounded = self.rounded(x)
        short = rounded == int(rounded) and abs(rounded) < 1e6
        text = f"{repr(rounded) if short else rounded.hex()}{self.suffix}"
        return f"({text})" if text.startswith("-") else text

    def text(self, x: float) -> str:
        """The C text of a number within the law, with what it stands for in a comment."""
        name = self.names.get(abs(x))
        return f"{self.constant(x)} /* {name} */" if name else self.constant(x)
