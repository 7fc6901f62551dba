"""The processor that code is made for."""

from __future__ import annotations

import functools
import os
from typing import NamedTuple

import llvmlite.binding as llvm

from adaptctl.compilation.lanes import Precision
from adaptctl.errors import InputError

_WIDEST = {"avx512f": 8, "avx": 4, "sse2": 2, "neon": 2}
"""Number of doubles in a register, by the instructions that use it; the first that the processor has counts."""

_AVX2 = ("sse2", "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_AVX512 = (*_AVX2, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
_LEVELS = {"sse2": ("x86-64", ("sse2",)), "avx2": ("x86-64-v3", _AVX2), "avx512": ("x86-64-v4", _AVX512)}
"""The levels of the x86-64 ABI that vectors differ by: LLVM's name for each, and what a processor must have."""


class Processor(NamedTuple):
    """Processor that native code is made for: `name`, LLVM's name of it, such as "x86-64-v3", and `features`, its
    instruction sets as LLVM writes them, such as "+avx2,-avx512f". Nothing is checked."""

    name: str
    features: str

    @classmethod
    def host(cls) -> Processor:
        """The processor of this machine, a `Processor`, with all its instruction sets, or with those of one level alone
        where the environment variable ADAPTCTL_PROCESSOR is "sse2", "avx2" or "avx512". They are all where the variable
        is "native", empty or not set. Raises `InputError` for another value, and for a level that the processor
        lacks."""
        level = os.environ.get("ADAPTCTL_PROCESSOR", "")
        return _whole() if level in ("", "native") else _whole().limited(level)

    def limited(self, level: str) -> Processor:
        """This processor with the instruction sets of a `level` alone, "sse2", "avx2" or "avx512". Raises `InputError`
        for an unknown level, and for one that the processor lacks."""
        if level not in _LEVELS:
            known = ", ".join(("native", *_LEVELS))
            raise InputError(f"ADAPTCTL_PROCESSOR: expected one of {known}, got {level!r}")
        name, needed = _LEVELS[level]
        missing = [feature for feature in needed if f"+{feature}" not in self.features.split(",")]
        if missing:
            lacks = f"this processor, {self.name}, lacks {', '.join(missing)}"
            raise InputError(f"ADAPTCTL_PROCESSOR: {level!r} cannot be used: {lacks}; use 'native', or leave it out")
        return Processor(name, ",".join(f"+{feature}" for feature in needed))

    @property
    def lanes(self) -> int:
        """Number of doubles that one SIMD instruction works on: 8 with AVX-512, 4 with AVX, 2 with SSE2 or Neon, and 1
        where none of these is known."""
        has = self.features.split(",")
        return next((lanes for feature, lanes in _WIDEST.items() if f"+{feature}" in has), 1)

    def lanes_of(self, precision: Precision) -> int:
        """Number of floating-point numbers of a `precision` that one SIMD instruction works on: the property `lanes` in
        "double", twice as many in "single", but 1 where no SIMD instructions are known. The precision is not
        checked."""
        return self.lanes if precision == "double" or self.lanes == 1 else 2 * self.lanes

    def machine(self) -> llvm.TargetMachine:
        """A new LLVM target machine, llvmlite's object that compiles, for this processor, with code to be run in this
        process. Raises `RuntimeError` where LLVM's native target has not been initialised."""
        target = llvm.Target.from_default_triple()
        return target.create_target_machine(cpu=self.name, features=self.features, opt=2, jit=True)


@functools.cache
def _whole() -> Processor:
    return Processor(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())
