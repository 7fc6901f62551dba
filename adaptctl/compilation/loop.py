"""LLVM IR that runs a routine for many steps on many blocks of lanes: one native call for a whole simulation."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from enum import StrEnum
from itertools import accumulate

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.routine import Routine

ENTRY = "run"

NativeLoop = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 6, *[ctypes.c_void_p] * 5)
"""ENTRY takes the first block and the last but one, the number of steps, the strides of shared,
driven and outputs, then the addresses of state, held, shared, driven and outputs.

In an array one block follows the other, in a block the columns of its source, and every scalar has all its lanes
side by side. A stride is the number of doubles from step to step, 0 for an array without steps.
"""


class Source(StrEnum):
    """Where an argument of a step comes from."""

    STATE = "state"
    """one a lane, replaced in each step by the first results"""
    HELD = "held"
    """one a lane, the same in all steps"""
    SHARED = "shared"
    """one for all lanes, another in each step"""
    DRIVEN = "driven"
    """one a lane, another in each step"""


def loop(routine: Routine, symbol: str, lanes: Lanes, columns: Mapping[Source, Sequence[int]]) -> str:
    """The function ENTRY, for a routine whose arguments come source by source, with these lengths.

    A block goes through all its steps before the next begins, so that its state stays in the nearest memory: there
    and in a spare place by turns, since a step reads one while it writes the other.
    """
    value, results, states = lanes.value, routine.layout.sizes, len(columns[Source.STATE])
    count = {source: sum(lengths) for source, lengths in columns.items()}
    parts = {f"%{source}.at": lengths for source, lengths in columns.items()}
    pointers, places = _places(parts | {"%next": results[:states], "%out.at": results[states:]}, lanes)
    return f"""declare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)
define void @{ENTRY}(i64 %first, i64 %end, i64 %count, i64 %shared.stride, i64 %driven.stride, i64 %out.stride,
  ptr %state, ptr %held, ptr %shared, ptr %driven, ptr %out) {lanes.attributes} {{
start:
  %spare = alloca [{count[Source.STATE]} x {value}], align {lanes.alignment}
  %shared.at = alloca [{count[Source.SHARED]} x {value}], align {lanes.alignment}
  br label %blocks
blocks:
  %block = phi i64 [%first, %start], [%following, %moved]
  %block.left = icmp slt i64 %block, %end
  br i1 %block.left, label %entered, label %return
entered:
  %own = getelementptr [{count[Source.STATE]} x {value}], ptr %state, i64 %block
  %held.at = getelementptr [{count[Source.HELD]} x {value}], ptr %held, i64 %block
  %driven.first = getelementptr [{count[Source.DRIVEN]} x {value}], ptr %driven, i64 %block
  %out.first = getelementptr [{sum(results[states:])} x {value}], ptr %out, i64 %block
  br label %stepped
stepped:
  %step = phi i64 [0, %entered], [%later, %stepping]
  %state.at = phi ptr [%own, %entered], [%next, %stepping]
  %next = phi ptr [%spare, %entered], [%state.at, %stepping]
  %step.left = icmp slt i64 %step, %count
  br i1 %step.left, label %stepping, label %moved
stepping:
  %shared.skip = mul i64 %step, %shared.stride
  %driven.skip = mul i64 %step, %driven.stride
  %out.skip = mul i64 %step, %out.stride
  %row = getelementptr double, ptr %shared, i64 %shared.skip
  %driven.at = getelementptr double, ptr %driven.first, i64 %driven.skip
  %out.at = getelementptr double, ptr %out.first, i64 %out.skip
{_broadcast(count[Source.SHARED], lanes)}
{places}
  call void @{symbol}({pointers})
  %later = add i64 %step, 1
  br label %stepped
moved:
  call void @llvm.memmove.p0.p0.i64(ptr %own, ptr %state.at, i64 {8 * lanes.count * count[Source.STATE]}, i1 false)
  %following = add i64 %block, 1
  br label %blocks
return:
  ret void
}}"""


def _places(parts: Mapping[str, Sequence[int]], lanes: Lanes) -> tuple[str, str]:
    """Arguments that point to each column after the pointers given, and the instructions that make them."""
    starts = {f"{base}.{k}": (base, start) for base, n in parts.items() for k, start in enumerate(_starts(n))}
    lines = [f"  {name} = getelementptr {lanes.value}, ptr {base}, i64 {k}" for name, (base, k) in starts.items()]
    return ", ".join(f"ptr {name}" for name in starts), "\n".join(lines)


def _starts(lengths: Sequence[int]) -> list[int]:
    return list(accumulate(lengths, initial=0))[:-1]


def _broadcast(count: int, lanes: Lanes) -> str:
    """Instructions that put each number of %row into all lanes."""
    lines = []
    for k in range(count):
        lines += [
            f"  %row.{k} = getelementptr double, ptr %row, i64 {k}",
            f"  %number.{k} = load double, ptr %row.{k}",
            *lanes.broadcast(f"%lanes.{k}", f"%number.{k}"),
            f"  %lanes.{k}.at = getelementptr {lanes.value}, ptr %shared.at, i64 {k}",
            f"  store {lanes.value} %lanes.{k}, ptr %lanes.{k}.at",
        ]
    return "\n".join(lines)
