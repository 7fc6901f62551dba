"""A routine as one of Python's own functions, which reads and makes NumPy's arrays without any detour.

It speaks the binary interfaces of CPython and NumPy, as every compiled extension does. An argument is usual when it
is a `numpy.ndarray` and nothing else, float64, aligned, contiguous, and of the expected length. When one is not,
another function is called in its place.
"""

from __future__ import annotations

import ctypes
import functools
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.native import NativeCode, define
from adaptctl.compilation.routine import Routine

_ENTRY = "call"
_FASTCALL = 0x80  # METH_FASTCALL: an array of arguments and their number
_DOUBLE = 12  # NPY_DOUBLE
_USUAL = 0x101  # NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED
_NEW = 93  # PyArray_New in NumPy's table of functions
_PYTHON = ("PyObject_Vectorcall", "PyTuple_New", "PyTuple_SetItem", "PyFloat_FromDouble", "Py_DecRef")


class _Array(ctypes.Structure):
    """How an array begins (numpy/ndarraytypes.h)."""

    _fields_ = (
        ("references", ctypes.c_ssize_t),
        ("type", ctypes.c_void_p),
        ("data", ctypes.c_void_p),
        ("ndim", ctypes.c_int),
        ("shape", ctypes.POINTER(ctypes.c_ssize_t)),
        ("strides", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
        ("flags", ctypes.c_int),
    )


class _Definition(ctypes.Structure):
    """PyMethodDef (cpython/Include/methodobject.h)."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


@functools.cache
def has_builtins() -> bool:
    """Whether this Python keeps arrays as is expected here. If so, native code is told where it finds what it needs."""
    if sys.implementation.name != "cpython" or object.__basicsize__ != _Array.data.offset:
        return False
    probe = np.zeros((5, 3))[:, 1]
    array, ndarray, float64 = _Array.from_address(id(probe)), id(np.ndarray), id(np.dtype(np.float64))
    found = array.type, array.data, array.ndim, array.shape[0], array.dtype, array.flags
    if found != (ndarray, probe.ctypes.data, 1, 5, float64, probe.flags.num):
        return False
    capsule = np._core._multiarray_umath._ARRAY_API  # type: ignore[attr-defined]
    table = _api("PyCapsule_GetPointer", ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(capsule, None)
    new = ctypes.c_void_p.from_address(table + _NEW * ctypes.sizeof(ctypes.c_void_p))
    python = {name: ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p) for name in _PYTHON}
    define({"numpy.ndarray": ndarray, "numpy.float64": float64, "numpy.new": new.value or 0})
    define({name: function.value or 0 for name, function in python.items()})
    return True


def builtin(code: NativeCode, name: str, instead: Callable[..., Any]) -> Callable[..., Any]:
    """Python's function for code that `builtin_source` is part of; `instead` is called for unusual arguments."""
    definition = _Definition(name.encode(), code.address(_ENTRY), _FASTCALL, None)
    owner = _Owner(instead, code, definition)
    new = _api("PyCFunction_NewEx", ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return new(ctypes.addressof(definition), owner, None)


class _Owner:
    """What a built-in function keeps alive: its code, its definition, and the function called instead."""

    __slots__ = ("__call__", "kept")

    def __init__(self, instead: Callable[..., Any], *kept: Any) -> None:
        self.__call__, self.kept = instead, kept


def _api(name: str, *types: Any) -> Callable[..., Any]:
    return ctypes.PYFUNCTYPE(*types)((name, ctypes.pythonapi))


def builtin_source(routine: Routine, symbol: str, *, finite: bool) -> str:
    """LLVM IR of the function; if `finite`, NaN and infinity are unusual too, given or computed."""
    shapes, inputs = dict(enumerate(routine.layout.shapes)), dict(enumerate(routine.inputs))
    arrays, numbers = ([k for k, shape in shapes.items() if bool(shape) is wanted] for wanted in (True, False))
    sizes = {f"%in{k}": n for k, n in inputs.items()} | {f"%out{k}": math.prod(shape) for k, shape in shapes.items()}
    return "\n".join([
        _INTERFACES,
        *(_SHAPE.format(k=k, rank=len(shapes[k]), sizes=", ".join(f"i64 {n}" for n in shapes[k])) for k in arrays),
        f"define ptr @{_ENTRY}(ptr %instead, ptr %arguments, i64 %count) nounwind {{",
        *(f"%out{k} = alloca double" for k in numbers),
        f"%counted = icmp eq i64 %count, {len(inputs)}",
        "br i1 %counted, label %look, label %unusual",
        "look:",
        *(_LOOK.format(k=k, n=n) for k, n in inputs.items()),
        *_unless_null([f"%in{k}" for k in inputs], "usual", "unusual"),
        "unusual:",
        "%other = call ptr @PyObject_Vectorcall(ptr %instead, ptr %arguments, i64 %count, ptr null)",
        "ret ptr %other",
        "usual:",
        *(_NEW_ARRAY.format(k=k, rank=len(shapes[k])) for k in arrays),
        *_unless_null([f"%result{k}" for k in arrays], "compute", "failed"),
        "failed:",
        *(f"call void @Py_DecRef(ptr %result{k})" for k in arrays),
        "ret ptr null",
        "compute:",
        *(_DATA.format(k=k) for k in arrays),
        f"call void @{symbol}({', '.join(f'ptr {pointer}' for pointer in sizes)})",
        *(_if_finite(sizes, "fine", "infinite") if finite else ["br label %fine"]),
        "infinite:",
        *(f"call void @Py_DecRef(ptr %result{k})" for k in arrays),
        "br label %unusual",
        "fine:",
        *_packed(numbers, len(shapes), routine.layout.container is not None),
        "}",
    ])  # fmt: skip


def _packed(numbers: Sequence[int], count: int, in_tuple: bool) -> list[str]:
    """What is returned: the only result, or a tuple of all."""
    lines = [_NEW_NUMBER.format(k=k) for k in numbers]
    if not in_tuple:
        return [*lines, "ret ptr %result0"]
    return [
        f"%results = call ptr @PyTuple_New(i64 {count})",
        *_unless_null(["%results"], "pack", "failed"),
        "pack:",
        *lines,
        *(f"%set{k} = call i32 @PyTuple_SetItem(ptr %results, i64 {k}, ptr %result{k})" for k in range(count)),
        *_unless_null([f"%result{k}" for k in numbers], "done", "lost"),
        "lost:",
        "call void @Py_DecRef(ptr %results)",
        "ret ptr null",
        "done:",
        "ret ptr %results",
    ]


def _if_finite(sizes: Mapping[str, int], then: str, otherwise: str) -> list[str]:
    """A branch to `then` if all numbers after the pointers are finite: zero times such a number is zero, else NaN,
    and a NaN stays one when the bits of others are added to it."""
    lines, all_so_far, gathered = [], "true", {width: Lanes(width).integer(0) for width in (8, 4, 2, 1)}
    for pointer, size in sizes.items():
        for start, width in _pieces(size):
            x, lanes = f"{pointer}.{start}", Lanes(width)
            lines += [
                f"{x}.at = getelementptr double, ptr {pointer}, i64 {start}",
                f"{x} = load {lanes.value}, ptr {x}.at, align 8",
                f"{x}.nothing = fmul {lanes.value} {x}, {lanes.constant(0.0)}",
                f"{x}.bits = bitcast {lanes.value} {x}.nothing to {lanes.whole}",
                f"{x}.or = or {lanes.whole} {gathered[width]}, {x}.bits",
            ]
            gathered[width] = f"{x}.or"
    for width, bits in gathered.items():
        lanes = Lanes(width)
        lines += [
            f"%gathered{width} = bitcast {lanes.whole} {bits} to {lanes.value}",
            f"%finite{width} = fcmp ord {lanes.value} %gathered{width}, {lanes.constant(0.0)}",
            f"%lanes{width} = bitcast {lanes.condition} %finite{width} to i{width}",
            f"%every{width} = icmp eq i{width} %lanes{width}, -1",
            f"%all{width} = and i1 {all_so_far}, %every{width}",
        ]
        all_so_far = f"%all{width}"
    return [*lines, f"br i1 {all_so_far}, label %{then}, label %{otherwise}"]


def _pieces(size: int) -> Iterator[tuple[int, int]]:
    """Where pieces of 8, 4, 2 or 1 begin that make up so many numbers, and their widths."""
    start = 0
    while start < size:
        width = next(width for width in (8, 4, 2, 1) if start + width <= size)
        yield start, width
        start += width


def _unless_null(pointers: Iterable[str], then: str, otherwise: str) -> list[str]:
    """A branch to `then` if none of the pointers is null."""
    lines, all_so_far = [], "true"
    for x in pointers:
        lines += [f"{x}.there = icmp ne ptr {x}, null", f"{x}.all = and i1 {all_so_far}, {x}.there"]
        all_so_far = f"{x}.all"
    return [*lines, f"br i1 {all_so_far}, label %{then}, label %{otherwise}"]


_INTERFACES = f"""@numpy.ndarray = external global i8
@numpy.float64 = external global i8
declare ptr @numpy.new(ptr, i32, ptr, i32, ptr, ptr, i32, i32, ptr)
declare ptr @PyObject_Vectorcall(ptr, ptr, i64, ptr)
declare ptr @PyTuple_New(i64)
declare i32 @PyTuple_SetItem(ptr, i64, ptr)
declare ptr @PyFloat_FromDouble(double)
declare void @Py_DecRef(ptr)
define internal ptr @usual(ptr %object, i64 %length) alwaysinline nounwind {{
%type.at = getelementptr i8, ptr %object, i64 {_Array.type.offset}
%type = load ptr, ptr %type.at
%is.array = icmp eq ptr %type, @numpy.ndarray
br i1 %is.array, label %array, label %other
array:
%dtype.at = getelementptr i8, ptr %object, i64 {_Array.dtype.offset}
%dtype = load ptr, ptr %dtype.at
%is.float64 = icmp eq ptr %dtype, @numpy.float64
%flags.at = getelementptr i8, ptr %object, i64 {_Array.flags.offset}
%flags = load i32, ptr %flags.at
%both = and i32 %flags, {_USUAL}
%is.plain = icmp eq i32 %both, {_USUAL}
%ndim.at = getelementptr i8, ptr %object, i64 {_Array.ndim.offset}
%ndim = load i32, ptr %ndim.at
%is.vector = icmp eq i32 %ndim, 1
%is.either = and i1 %is.float64, %is.plain
%is.all = and i1 %is.either, %is.vector
br i1 %is.all, label %vector, label %other
vector:
%shape.at = getelementptr i8, ptr %object, i64 {_Array.shape.offset}
%shape = load ptr, ptr %shape.at
%size = load i64, ptr %shape
%is.long = icmp eq i64 %size, %length
br i1 %is.long, label %fitting, label %other
fitting:
%data.at = getelementptr i8, ptr %object, i64 {_Array.data.offset}
%data = load ptr, ptr %data.at
ret ptr %data
other:
ret ptr null
}}"""

_SHAPE = "@shape{k} = private constant [{rank} x i64] [{sizes}]"

_LOOK = """%at{k} = getelementptr ptr, ptr %arguments, i64 {k}
%argument{k} = load ptr, ptr %at{k}
%in{k} = call ptr @usual(ptr %argument{k}, i64 {n})"""

_NEW_ARRAY = f"""%result{{k}} = call ptr @numpy.new(
  ptr @numpy.ndarray, i32 {{rank}}, ptr @shape{{k}}, i32 {_DOUBLE}, ptr null, ptr null, i32 0, i32 0, ptr null)"""

_DATA = f"""%data{{k}} = getelementptr i8, ptr %result{{k}}, i64 {_Array.data.offset}
%out{{k}} = load ptr, ptr %data{{k}}"""

_NEW_NUMBER = """%number{k} = load double, ptr %out{k}
%result{k} = call ptr @PyFloat_FromDouble(double %number{k})"""
