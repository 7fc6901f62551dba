"""LLVM IR that runs a routine for many steps on many blocks of lanes: one native call for a whole simulation."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from enum import StrEnum
from itertools import accumulate

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import BEFORE
from adaptctl.compilation.routine import Routine

ENTRY = "run"

NativeLoop = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 6, *[ctypes.c_void_p] * 5)
"""ENTRY takes the first block and the last but one, the number of steps, the strides of shared,
driven and outputs, then the addresses of state, held, shared, driven and outputs.

In an array one block follows the other, in a block the columns of its source, and every scalar has all its lanes
side by side; shared has one block for all. A stride is the number of doubles from step to step, 0 for an array without
steps.
"""


class Source(StrEnum):
    """The source of a step's argument."""

    STATE = "state"
    """one a lane, replaced in each step by the first results"""
    HELD = "held"
    """one a lane, the same in all steps"""
    SHARED = "shared"
    """one for all lanes, another in each step"""
    DRIVEN = "driven"
    """one a lane, another in each step"""


def loop(routine: Routine, symbol: str, lanes: Lanes, columns: Mapping[Source, Sequence[int]], same: int = 0) -> str:
    """LLVM IR of the function ENTRY, the loop over steps of a routine whose arguments come source by source, with these
    lengths. `same` is the number of scalars that another function computes before the steps of each block."""
    results, states = routine.layout.sizes, len(columns[Source.STATE])
    count = {str(source): sum(lengths) for source, lengths in columns.items()}
    inputs = {f"%{source}.at": lengths for source, lengths in columns.items()}
    pointers = _pointers(inputs | {"%next": results[:states], "%out.at": results[states:]})
    held = _pointers({_HELD: inputs[_HELD]})
    unread = [name if name in held else "ptr null" for name in _pointers(inputs)]
    before = f"call void @{symbol}{BEFORE}({', '.join([*unread, 'ptr %same'])})" if same else ""
    return lanes.filled(
        "loop",
        **count,
        outputs=sum(results[states:]),
        bytes=lanes.alignment * count["state"],
        same=max(same, 1),
        held_places=_places(_HELD, inputs.pop(_HELD), lanes),
        before=before,
        places="\n".join(
            _places(base, lengths, lanes)
            for base, lengths in (inputs | {"%next": results[:states], "%out.at": results[states:]}).items()
        ),
        routine=symbol,
        pointers=", ".join([*pointers, *(["ptr %same"] if same else [])]),
    )


_HELD = f"%{Source.HELD}.at"


def _pointers(parts: Mapping[str, Sequence[int]]) -> list[str]:
    """Arguments that point to each column after the pointers given."""
    return [f"ptr {base}.{k}" for base, lengths in parts.items() for k in range(len(lengths))]


def _places(base: str, lengths: Sequence[int], lanes: Lanes) -> str:
    """The instructions that make the pointers to each column after one."""
    starts = zip(accumulate(lengths), lengths, strict=True)
    return "\n".join(
        f"  {base}.{k} = getelementptr {lanes.value}, ptr {base}, i64 {end - length}"
        for k, (end, length) in enumerate(starts)
    )
