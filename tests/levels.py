"""The levels that native code can be limited to, and which of them this processor has."""

from __future__ import annotations

import llvmlite.binding as llvm

LEVELS = {"sse2": 2, "avx2": 4, "avx512": 8}
"""Doubles side by side."""

_NEWEST = {"sse2": "sse2", "avx2": "avx2", "avx512": "avx512vl"}


def usable() -> list[str]:
    """By the newest instructions of each."""
    has = llvm.get_host_cpu_features()
    return [level for level in LEVELS if has.get(_NEWEST[level])]
