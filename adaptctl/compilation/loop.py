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
"""ENTRY takes the first block and the one after the last, the number of steps, the strides of shared, driven and
outputs, then the addresses of state, held, shared, driven and outputs.

In an array one block follows the other, in a block the columns of its source, and every scalar has all its lanes
side by side; shared has one block for all. A stride is how many numbers lie from step to step, 0 for an array without
steps.
"""


class Source(StrEnum):
    """Source of a step's argument, for a step that is taken by many members (copies of its state). "state" is of each
    member and is replaced by each step; "held" is of each member and the same in all steps; "shared" is the same for
    all members and new in each step; "driven" is of each member and new in each step."""

    STATE = "state"
    """one a lane, replaced in each step by the first results"""
    HELD = "held"
    """one a lane, the same in all steps"""
    SHARED = "shared"
    """one for all lanes, another in each step"""
    DRIVEN = "driven"
    """one a lane, another in each step"""


def loop(routine: Routine, symbol: str, lanes: Lanes, columns: Mapping[Source, Sequence[int]], same: int = 0) -> str:
    """LLVM IR (text) of the function `run`, one native call of which takes many steps of a `routine` (traced function)
    for many members (copies of its state). It works on a block of members, as many as `lanes`, at a time. `run` takes
    the index of the first block and of the one after the last, the number of steps, the strides from step to step,
    counted in numbers, of the arrays of shared and driven arguments and of outputs (0 for an array without steps), and
    the addresses of state, held, shared, driven and outputs.

    `symbol` is the name of the routine's own function; `columns` has the lengths of its arguments by `Source` (state,
    held, shared, driven), in that order; its first results are the new state, the others outputs. `same` is the number
    of scalars that are computed before the steps of each block, by a function whose name is `symbol` followed by
    ".before"; 0, the default, where there is none. Not checked: `columns` must have all four sources, with no lengths
    where there are no arguments.
    """
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
            _places(base, lengths, Lanes(1, lanes.precision) if base == _SHARED else lanes)
            for base, lengths in (inputs | {"%next": results[:states], "%out.at": results[states:]}).items()
        ),
        routine=symbol,
        pointers=", ".join([*pointers, *(["ptr %same"] if same else [])]),
    )


_HELD, _SHARED = f"%{Source.HELD}.at", f"%{Source.SHARED}.at"


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
