"""LLVM IR that runs a routine on rows of arrays, in SIMD lanes."""

from __future__ import annotations

import ctypes
import hashlib
import math
from collections.abc import Callable, Mapping
from functools import cache

from adaptctl.compilation.lanes import CACHE_LINE, Lanes
from adaptctl.compilation.llvm import program
from adaptctl.compilation.native import NativeCode, Processor, load, load_shared
from adaptctl.compilation.routine import Routine

ENTRY = "batch"

MIN_STREAMED_BYTES = 4 * 2**20
"""Size in bytes of a result array from which it is written by non-temporal stores, if aligned to cache lines."""

NativeBatch = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
"""ENTRY takes the number of samples and three tables: addresses of the arguments' rows, the doubles from row to row of
each, and addresses of the results' rows."""


def compiled_batch(
    routine: Routine, processor: Processor, checked: Mapping[str, bool]
) -> tuple[tuple[NativeCode, ...], Callable[..., bool]]:
    """Code that evaluates a routine at many samples, and its entry."""
    lanes = Lanes(processor.lanes)
    (text, symbol, pieces, _), (rows, tag) = program(routine, lanes), _rows_apart(lanes, repr(processor))
    shared = load_shared(rows, [f"{name}{tag}" for name in _ROWS], processor)
    code = load(f"{text}\n{batch(routine, symbol, lanes, checked, tag)}", processor, pieces)
    return (code, shared), NativeBatch(code.address(ENTRY))


_ROWS = {
    "gather": "declare void @gather{}(ptr, ptr, i64, i64, i64, i64)",
    "scatter": "declare void @scatter{}(ptr, ptr, i64, i64, i64, i64, i1)",
    "finite": "declare i1 @finite{}(ptr, i64)",
}
"""Functions that all routines share in a module of their own."""


@cache
def _rows_apart(lanes: Lanes, target: str) -> tuple[str, str]:
    """LLVM IR of the shared functions, and what ends their names, which tells their content and the `target`."""
    gathered = f"%gathered{lanes.count - 1}" if lanes.count > 1 else "%x0"
    pieces = {name: "\n  ".join(lines) for name, lines in (_rows(lanes) | _square(lanes)).items()}
    text = f"{lanes.filled('rows', gathered=gathered, **pieces)}\n{lanes.filled('finite')}"
    tag = f".{hashlib.sha256((target + text).encode()).hexdigest()[:32]}"
    return _tagged(text.replace("define internal i1 @finite", "define i1 @finite"), tag), tag


def _tagged(text: str, tag: str) -> str:
    for name in _ROWS:
        text = text.replace(f"@{name}(", f"@{name}{tag}(")
    return text


def batch(routine: Routine, symbol: str, lanes: Lanes, checked: Mapping[str, bool], tag: str) -> str:
    """LLVM IR of `batch`, which evaluates a routine at many samples with the shared functions of a `tag`."""
    inputs = {f"in{k}": n for k, n in enumerate(routine.inputs)}
    outputs = {f"out{k}": math.prod(shape) for k, shape in enumerate(routine.layout.shapes)}
    both = inputs | outputs
    memory = [f"%{name} = alloca [{n} x {lanes.value}], align {lanes.alignment}" for name, n in both.items()]
    for k, name in enumerate(inputs):
        memory += [_entry(f"{name}.rows", "ptr", "inputs", k), _entry(f"{name}.stride", "i64", "strides", k)]
    for k, (name, n) in enumerate(outputs.items()):
        memory.append(_entry(f"{name}.rows", "ptr", "outputs", k))
        memory.append(f"%{name}.streams = call i1 @streams(ptr %{name}.rows, i64 {n}, i64 %samples)")
    ends = "i64 %first, i64 %last"
    pieces = {
        "memory": memory,
        "gather": [
            f"call void @gather(ptr %{name}, ptr %{name}.rows, i64 %{name}.stride, i64 {n}, {ends})"
            for name, n in inputs.items()
        ],
        "scatter": [
            f"call void @scatter(ptr %{name}.rows, ptr %{name}, i64 {n}, i64 {n}, {ends}, i1 %{name}.streams)"
            for name, n in outputs.items()
        ],
        "check": _check(
            {k: n for k, n in inputs.items() if checked["inputs"]} | (outputs if checked["outputs"] else {}), lanes
        ),
    }
    texts = {name: "\n  ".join(lines) for name, lines in pieces.items()}
    pointers = ", ".join(f"ptr %{name}" for name in both)
    sizes = {"many": MIN_STREAMED_BYTES // 8, "beyond": CACHE_LINE - 1}
    text = lanes.filled("batch", routine=symbol, pointers=pointers, **sizes, **texts)
    return "\n".join([_tagged(text, tag), *(declared.format(tag) for declared in _ROWS.values())])


def _entry(name: str, kind: str, table: str, k: int) -> str:
    return f"%{name}.at = getelementptr {kind}, ptr %{table}, i64 {k}\n  %{name} = load {kind}, ptr %{name}.at"


def _check(sizes: Mapping[str, int], lanes: Lanes) -> list[str]:
    lines, sound = [], "%sound"
    for name, n in sizes.items():
        lines.append(f"%{name}.finite = call i1 @finite(ptr %{name}, i64 {n * lanes.count})")
        lines.append(f"%{name}.sound = and i1 {sound}, %{name}.finite")
        sound = f"%{name}.sound"
    return [*lines, f"%still.sound = and i1 {sound}, true"]


def _square(lanes: Lanes) -> dict[str, list[str]]:
    n, kind, lines = lanes.count, lanes.value, []
    for k in range(n):
        lines += [
            f"%column{k} = add i64 %square.k, {k}",
            f"%column{k}.at = getelementptr {kind}, ptr %from, i64 %column{k}",
            f"%turned.1.{k} = load {kind}, ptr %column{k}.at, align 8",
        ]
    half = 1
    while half < n:
        for k in (k for k in range(n) if not k & half):
            pair = f"{kind} %turned.{half}.{k}, {kind} %turned.{half}.{k | half}"
            near = [j if not j & half else n + (j ^ half) for j in range(n)]
            far = [j | half if not j & half else n + j for j in range(n)]
            for place, taken in ((k, near), (k | half, far)):
                mask = f"<{n} x i32> <{', '.join(f'i32 {j}' for j in taken)}>"
                lines.append(f"%turned.{2 * half}.{place} = shufflevector {pair}, {mask}")
        half *= 2
    lines += [f"%row{lane}.at = getelementptr double, ptr %row{lane}, i64 %square.k" for lane in range(n)]
    kept = [f"store {kind} %turned.{n}.{lane}, ptr %row{lane}.at, align 8" for lane in range(n)]
    streamed = [line.replace("align 8", f"align {lanes.alignment}, !nontemporal !0") for line in kept]
    return {"turned": lines, "kept": kept, "streamed": streamed}


def _rows(lanes: Lanes) -> dict[str, list[str]]:
    rows, loads, stores = [], [], []
    for lane in range(lanes.count):
        rows += [
            f"%sample{lane} = call i64 @sample(i64 %first, i64 {lane}, i64 %last)",
            f"%skip{lane} = mul i64 %sample{lane}, %stride",
            f"%row{lane} = getelementptr double, ptr %rows, i64 %skip{lane}",
        ]
        at = f"%at{lane} = getelementptr double, ptr %row{lane}, i64 %k"
        loads += [at, f"%x{lane} = load double, ptr %at{lane}, align 8"]
        before = f"%gathered{lane - 1}" if lane else "zeroinitializer"
        if lanes.count > 1:
            loads.append(f"%gathered{lane} = insertelement {lanes.value} {before}, double %x{lane}, i32 {lane}")
            stores.append(f"%x{lane} = extractelement {lanes.value} %all, i32 {lane}")
        stores += [at, f"store double {f'%x{lane}' if lanes.count > 1 else '%all'}, ptr %at{lane}, align 8"]
    return {"rows": rows, "loads": loads, "stores": stores}
