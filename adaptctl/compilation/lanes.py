"""LLVM types and attributes for numbers side by side in SIMD lanes, in double or single precision."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Literal, TypeAlias, get_args

import numpy as np

from adaptctl.caching import cached_property
from adaptctl.errors import InputError

Precision: TypeAlias = Literal["double", "single"]
"""IEEE 754's binary64, of 53 bits, or binary32, of 24."""


@dataclass(frozen=True)
class Lanes:
    """Types and attributes, as LLVM text, for numbers that one instruction works on at once (SIMD lanes): `count` of
    them, 1 (plain numbers, the default), 2, 4 or 8, or 16 in single precision; `precision` is "double", the default
    (binary64), or "single" (binary32). Raises `InputError` for another count or precision."""

    count: int = 1
    precision: Precision = "double"

    def __post_init__(self) -> None:
        require_precision(self.precision)
        if self.count not in (1, 2, 4, 8, 16)[: 5 if self.precision == "single" else 4]:
            raise InputError(f"lanes: expected 1, 2, 4 or 8, or 16 in single precision, got {self.count}")

    @property
    def size(self) -> int:
        """Size of one number in bytes: 8 in double precision, 4 in single."""
        return 8 if self.precision == "double" else 4

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """NumPy type of the numbers: float64 in double precision, float32 in single."""
        return np.dtype(f"f{self.size}")

    @cached_property
    def scalar(self) -> str:
        """The LLVM type of one number: "double", or "float" in single precision."""
        return "double" if self.precision == "double" else "float"

    @cached_property
    def value(self) -> str:
        """The LLVM type of the numbers in all SIMD lanes, such as "<4 x double>", or of one number where there is one
        lane."""
        return self._of(self.scalar)

    @cached_property
    def integer(self) -> str:
        """The LLVM type of whole numbers as long as the floating-point ones, in all SIMD lanes, such as "<4 x i64>"."""
        return self._of(self._whole)

    @cached_property
    def condition(self) -> str:
        """The LLVM type of the truth values of a comparison in all SIMD lanes, such as "<4 x i1>"."""
        return self._of("i1")

    @cached_property
    def suffix(self) -> str:
        """Ending of the names of LLVM's intrinsic functions for numbers in these SIMD lanes, such as "v4f64", or "f64"
        for one."""
        bits = f"f{8 * self.size}"
        return bits if self.count == 1 else f"v{self.count}{bits}"

    @property
    def alignment(self) -> int:
        """Alignment in memory, bytes, of the numbers in all SIMD lanes: their size together."""
        return self.size * self.count

    @cached_property
    def attributes(self) -> str:
        """LLVM attributes, as text, for every function on SIMD lanes: it raises no exceptions, and its stack is aligned
        so that a vector put there lies in one cache line."""
        return "nounwind" if self.count == 1 else f'nounwind "stackrealign" alignstack({self.alignment})'

    def constant(self, x: float) -> str:
        """The LLVM text of the constant `x`, a float, in every SIMD lane, rounded to the precision and written as the
        digits of its bits, NaN and infinity too. Nothing is raised."""
        digits = f"0x{struct.pack('>d', self.rounded(x)).hex()}"  # of a double in either precision
        return digits if self.count == 1 else "<" + ", ".join([f"{self.scalar} {digits}"] * self.count) + ">"

    def rounded(self, x: float) -> float:
        """The float that stands for `x` in the precision of these lanes: `x` itself in double; in single the nearest of
        its normal numbers, whose size is 1.2e-38 to 3.4e38, so that no finite number becomes infinite or 0; NaN,
        infinities and 0 are as they were. Nothing is raised."""
        return x if self.precision == "double" else single(x)

    def whole(self, k: int) -> str:
        """The LLVM text of the whole number `k` in every SIMD lane, as an integer as long as the floating-point
        numbers. Its range is not checked."""
        return str(k) if self.count == 1 else "<" + ", ".join([f"{self._whole} {k}"] * self.count) + ">"

    def filled(self, name: str, **values: object) -> str:
        """The text of the LLVM template `name`.ll beside this module, with the lanes' types, sizes and attributes
        (`scalar`, `value`, `integer`, `condition`, `suffix`, `count`, `alignment`, `attributes`) and further `values`
        by name in place of its $names. Raises `FileNotFoundError` for an unknown template, `KeyError` for a $name
        without a value."""
        types = ("scalar", "value", "integer", "condition", "suffix", "count", "alignment", "attributes")
        template = Template(Path(__file__).with_name(f"{name}.ll").read_text(encoding="utf-8"))
        return template.substitute({of: getattr(self, of) for of in types}, **values)

    @property
    def _whole(self) -> str:
        return f"i{8 * self.size}"

    def _of(self, kind: str) -> str:
        return kind if self.count == 1 else f"<{self.count} x {kind}>"


def require_precision(precision: object) -> None:
    """Raise `InputError` unless `precision` is a `Precision`: "double" or "single"."""
    if precision not in get_args(Precision):
        raise InputError(f"precision: expected one of {', '.join(get_args(Precision))}, got {precision!r}")


def single(x: float) -> float:
    """The float that stands for `x` in single precision (binary32): the nearest of its normal numbers, whose size is
    1.2e-38 to 3.4e38, so that no finite number becomes infinite or 0. NaN, infinities and 0 are as they were. Nothing
    is raised."""
    if not math.isfinite(x) or x == 0.0:
        return x
    limits = np.finfo(np.float32)
    within = min(max(abs(x), float(limits.tiny)), float(limits.max))
    return math.copysign(float(np.float32(within)), x)
