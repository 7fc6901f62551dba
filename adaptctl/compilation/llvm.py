"""Native code for a traced routine: straight-line LLVM IR over scalars, compiled in memory by llvmlite.

Every routine is a function of two pointers, to its inputs and to its outputs. `contract` lets multiplications and
additions fuse; no other liberty is given, since general fast-math breaks the range reduction of sin and cos.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import llvmlite.binding as llvm

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.routine import Routine

VALUE, CONDITION, SUFFIX = "double", "i1", "f64"
"""The types of a number and of a condition, and how intrinsics name the former."""

ENTRY = "evaluate"

_ARITHMETIC = {Op.ADD: "fadd", Op.SUBTRACT: "fsub", Op.MULTIPLY: "fmul", Op.DIVIDE: "fdiv"}
_INTRINSICS = {Op.SIN: "sin", Op.COS: "cos", Op.SQRT: "sqrt", Op.ABSOLUTE: "fabs"}
_ORDERS = {Op.LESS: "olt", Op.LESS_EQUAL: "ole", Op.MINIMUM: "olt", Op.MAXIMUM: "ogt"}


@dataclass(frozen=True)
class NativeCode:
    """A function `void (int64 samples, double* inputs, double* outputs)` at `address`, alive while `engine` is."""

    engine: Any
    address: int


def compile_routine(routine: Routine) -> NativeCode:
    """Machine code for this processor that evaluates the routine on each of a number of samples."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=2, jit=True
    )
    module = llvm.parse_assembly(program(routine))
    module.verify()
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=2))
    passes.getModulePassManager().run(module, passes)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return NativeCode(engine, engine.get_function_address(ENTRY))


def program(routine: Routine) -> str:
    """The LLVM IR of a routine, of all it calls, and of the loop over samples."""
    symbols = _symbols(routine)
    declarations = [f"declare {VALUE} @llvm.{name}.{SUFFIX}({VALUE})" for name in _INTRINSICS.values()]
    functions = [_function(r, symbols) for r in symbols]
    return "\n".join([*declarations, *functions, _loop(routine, symbols[routine])])


def _symbols(routine: Routine) -> dict[Routine, str]:
    """Names for the routine and all it calls, at any depth."""
    found: dict[Routine, str] = {}
    pending = [routine]
    while pending:
        r = pending.pop()
        if r not in found:
            found[r] = f"{re.sub('[^A-Za-z0-9_]', '_', r.name)}.{len(found)}"
            pending += r.calls
    return found


def _function(routine: Routine, symbols: Mapping[Routine, str]) -> str:
    return "\n".join([
        f"define internal void @{symbols[routine]}(ptr noalias readonly %in, ptr noalias %out) noinline {{",
        *(line for expression in routine.body for line in _instructions(expression, symbols)),
        *_stores("%out", routine.outputs),
        "ret void\n}",
    ])  # fmt: skip


def _loop(routine: Routine, symbol: str) -> str:
    return f"""define void @{ENTRY}(i64 %samples, ptr noalias readonly %in, ptr noalias %out) {{
start:
  %any = icmp sgt i64 %samples, 0
  br i1 %any, label %sample, label %end
sample:
  %k = phi i64 [0, %start], [%next, %sample]
  %j = mul i64 %k, {routine.inputs}
  %l = mul i64 %k, {len(routine.outputs)}
  %input = getelementptr {VALUE}, ptr %in, i64 %j
  %output = getelementptr {VALUE}, ptr %out, i64 %l
  call void @{symbol}(ptr %input, ptr %output)
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %samples
  br i1 %more, label %sample, label %end
end:
  ret void
}}"""


def _instructions(expression: Expression, symbols: Mapping[Routine, str]) -> list[str]:
    x, op, detail = _operand(expression), expression.op, expression.detail
    operands = [_operand(y) for y in expression.operands]
    match op:
        case Op.INPUT:
            return _load(x, "%in", detail)
        case Op.RESULT:
            return _load(x, f"{operands[0]}.out", detail)
        case Op.CALL:
            return _call(x, detail, symbols[detail], expression.operands)
        case Op.NEGATE:
            return [f"{x} = fneg {VALUE} {operands[0]}"]
        case Op.LESS | Op.LESS_EQUAL:
            return [f"{x} = fcmp {_ORDERS[op]} {VALUE} {operands[0]}, {operands[1]}"]
        case Op.SELECT:
            condition, yes, no = operands
            return [f"{x} = select {CONDITION} {condition}, {VALUE} {yes}, {VALUE} {no}"]
        case Op.MINIMUM | Op.MAXIMUM:
            return _extremum(x, _ORDERS[op], *operands)
        case Op.ADD | Op.SUBTRACT | Op.MULTIPLY | Op.DIVIDE:
            return [f"{x} = {_ARITHMETIC[op]} contract {VALUE} {operands[0]}, {operands[1]}"]
        case Op.SIN | Op.COS | Op.SQRT | Op.ABSOLUTE:
            return [f"{x} = call {VALUE} @llvm.{_INTRINSICS[op]}.{SUFFIX}({VALUE} {operands[0]})"]


def _operand(x: Expression | float) -> str:
    """A register, or a constant as the digits of its bits."""
    return f"%x{x.index}" if isinstance(x, Expression) else f"0x{struct.pack('>d', x).hex()}"


def _load(x: str, pointer: str, k: int) -> list[str]:
    return [
        f"{x}.at = getelementptr {VALUE}, ptr {pointer}, i64 {k}",
        f"{x} = load {VALUE}, ptr {x}.at",
    ]


def _stores(pointer: str, values: Iterable[Expression | float]) -> list[str]:
    lines = []
    for k, value in enumerate(values):
        lines += [
            f"{pointer}.{k} = getelementptr {VALUE}, ptr {pointer}, i64 {k}",
            f"store {VALUE} {_operand(value)}, ptr {pointer}.{k}",
        ]
    return lines


def _call(x: str, routine: Routine, symbol: str, operands: Iterable[Expression | float]) -> list[str]:
    return [
        f"{x}.in = alloca [{routine.inputs} x {VALUE}]",
        f"{x}.out = alloca [{len(routine.outputs)} x {VALUE}]",
        *_stores(f"{x}.in", operands),
        f"call void @{symbol}(ptr {x}.in, ptr {x}.out)",
    ]


def _extremum(x: str, order: str, a: str, b: str) -> list[str]:
    """The first operand where it is NaN or comes first, else the second, as NumPy has it.

    (The intrinsics llvm.minimum and llvm.maximum cannot be compiled for every processor by every LLVM.)
    """
    return [
        f"{x}.first = fcmp {order} {VALUE} {a}, {b}",
        f"{x}.picked = select {CONDITION} {x}.first, {VALUE} {a}, {VALUE} {b}",
        f"{x}.nan = fcmp uno {VALUE} {a}, {a}",
        f"{x} = select {CONDITION} {x}.nan, {VALUE} {a}, {VALUE} {x}.picked",
    ]
