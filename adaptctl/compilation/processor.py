"""The processor that code is made for."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import llvmlite.binding as llvm

_WIDEST = {"avx512f": 8, "avx": 4, "sse2": 2, "neon": 2}
"""How many doubles a register holds, by the instructions that use it; the first that the processor has counts."""


@dataclass(frozen=True)
class Processor:
    """LLVM's name for a processor, and what it can do beyond that: "+avx2,-avx512f,..."."""

    name: str
    features: str

    @classmethod
    @functools.cache
    def host(cls) -> Processor:
        """The one this runs on."""
        return cls(llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())

    @property
    def lanes(self) -> int:
        """How many doubles one instruction works on: 8, 4 or 2, and 1 where nothing is known."""
        has = self.features.split(",")
        return next((lanes for feature, lanes in _WIDEST.items() if f"+{feature}" in has), 1)

    def machine(self, effort: int) -> llvm.TargetMachine:
        """What makes code for it, to be run in this process, with this effort: 0 is least, 2 usual."""
        target = llvm.Target.from_default_triple()
        return target.create_target_machine(cpu=self.name, features=self.features, opt=effort, jit=True)
