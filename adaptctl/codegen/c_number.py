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
    """Kind of number in C code: `kind` is "double" or "float"; `names` maps magnitudes of constants to what they stand
    for, such as a robot's parameter, to be written beside them in comments. Nothing is checked."""

    kind: Kind
    names: Mapping[float, str]

    @property
    def precision(self) -> Precision:
        """Precision of the numbers, as a `Precision`: "double" (binary64) for C's double, "single" (binary32) for its
        float."""
        return "double" if self.kind == "double" else "single"

    @property
    def size(self) -> int:
        """Size of one number in bytes: 8 for double, 4 for float."""
        return 8 if self.kind == "double" else 4

    @property
    def suffix(self) -> str:
        """Ending of C's constants and of the names of math.h's functions: "f" for float, empty for double."""
        return "" if self.kind == "double" else "f"

    def rounded(self, x: float) -> float:
        """The float that stands for `x` in this kind of number: `x` itself for double; for float the nearest
        single-precision number, the magnitude being first clipped to between about 1.2e-38 and 3.4e38. Zero, NaN and
        infinities stay as they are. Nothing is raised."""
        return x if self.kind == "double" else single(x)

    def constant(self, x: float) -> str:
        """The C text of the number `x`, without a comment, a constant of the C type, double or float, that this object
        stands for: decimal for whole numbers below 1e6 in size, HUGE_VAL or HUGE_VALF for infinity, else hexadecimal;
        negative ones in parentheses. Compilers read back exactly what the method `rounded` gives: x itself for double,
        the nearest single-precision number for float. Raises `ValueError` for NaN."""
        if math.isinf(x):
            huge = f"HUGE_VAL{self.suffix.upper()}"  # INFINITY is a float
            return f"(-{huge})" if x < 0.0 else huge
        rounded = self.rounded(x)
        short = rounded == int(rounded) and abs(rounded) < 1e6
        text = f"{repr(rounded) if short else rounded.hex()}{self.suffix}"
        return f"({text})" if text.startswith("-") else text

    def text(self, x: float) -> str:
        """The C text of the number `x`, a constant of the C type, double or float, that this object stands for: decimal
        for whole numbers below 1e6 in size, HUGE_VAL or HUGE_VALF for infinity, else hexadecimal; negative ones in
        parentheses. Compilers read back exactly what the method `rounded` gives: x itself for double, the nearest
        single-precision number for float. Where this object's `names`, a mapping from magnitudes to names, has |x|, a
        comment with that name follows, such as a robot's parameter. Raises `ValueError` for NaN."""
        name = self.names.get(abs(x))
        return f"{self.constant(x)} /* {name} */" if name else self.constant(x)
