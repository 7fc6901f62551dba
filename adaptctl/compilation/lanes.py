"""LLVM types and attributes for numbers side by side in SIMD lanes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from string import Template

from adaptctl.errors import InputError


@dataclass(frozen=True)
class Lanes:
    """The LLVM types for `count` doubles worked on by one instruction (SIMD lanes): vectors, or plain numbers when it
    is 1."""

    count: int = 1

    def __post_init__(self) -> None:
        if self.count not in (1, 2, 4, 8):
            raise InputError(f"lanes: expected 1, 2, 4 or 8, got {self.count}")

    @property
    def value(self) -> str:
        """The LLVM type of the lanes' numbers."""
        return self._of("double")

    @property
    def integer(self) -> str:
        """The LLVM type of whole numbers of as many bits."""
        return self._of("i64")

    @property
    def condition(self) -> str:
        """The LLVM type of the lanes' comparison."""
        return self._of("i1")

    @property
    def suffix(self) -> str:
        """The suffix by which intrinsics name the lanes."""
        return "f64" if self.count == 1 else f"v{self.count}f64"

    @property
    def alignment(self) -> int:
        """Alignment of the lanes in memory, bytes."""
        return 8 * self.count

    @property
    def attributes(self) -> str:
        """LLVM attributes of every function on lanes: the stack is aligned so that no spilled vector straddles a cache
        line."""
        return "nounwind" if self.count == 1 else f'nounwind "stackrealign" alignstack({self.alignment})'

    def constant(self, x: float) -> str:
        """The LLVM constant of a number in every lane, as the digits of its bits."""
        digits = f"0x{struct.pack('>d', x).hex()}"
        return digits if self.count == 1 else "<" + ", ".join([f"double {digits}"] * self.count) + ">"

    def whole(self, k: int) -> str:
        """The LLVM constant of a whole number in every lane."""
        return str(k) if self.count == 1 else "<" + ", ".join([f"i64 {k}"] * self.count) + ">"

    def filled(self, name: str, **values: object) -> str:
        """The text of `name`.ll, with these types and other values in place of its $names."""
        types = ("value", "integer", "condition", "suffix", "count", "alignment", "attributes")
        template = Template(Path(__file__).with_name(f"{name}.ll").read_text(encoding="utf-8"))
        return template.substitute({of: getattr(self, of) for of in types}, **values)

    def _of(self, kind: str) -> str:
        return kind if self.count == 1 else f"<{self.count} x {kind}>"
