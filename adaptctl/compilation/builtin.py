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
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.native import NativeCode, define
from adaptctl.compilation.routine import Routine

Finite: TypeAlias = bool | Literal["results"]
"""Whether NaN and infinity are refused: nowhere, everywhere, or in what is computed."""

_ENTRY = "call"
_FASTCALL = 0x80  # METH_FASTCALL: an array of arguments and their number
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


def builtin_source(routine: Routine, symbol: str, *, finite: Finite) -> str:
    """LLVM IR of the function; if `finite`, NaN and infinity are unusual too, computed or even given."""
    shapes, inputs = dict(enumerate(routine.layout.shapes)), dict(enumerate(routine.inputs))
    arrays, numbers = ([k for k, shape in shapes.items() if bool(shape) is wanted] for wanted in (True, False))
    sizes = {f"%in{k}": n for k, n in inputs.items()} | {f"%out{k}": math.prod(shape) for k, shape in shapes.items()}
    fitting = [f"icmp ne ptr %in{k}, null" for k in inputs]
    made = [f"icmp ne ptr %result{k}, null" for k in arrays]
    checked = {pointer: n for pointer, n in sizes.items() if finite is True or (finite and pointer.startswith("%out"))}
    sound = [f"call i1 @finite(ptr {pointer}, i64 {n})" for pointer, n in checked.items()]
    pieces = {
        "shapes": [_SHAPE.format(k, len(shapes[k]), ", ".join(f"i64 {n}" for n in shapes[k])) for k in arrays],
        "numbers": [f"%out{k} = alloca double" for k in numbers],
        "look": [*(_LOOK.format(k, n) for k, n in inputs.items()), _branch(fitting, "usual", "unusual")],
        "allocate": [*(_ALLOCATE.format(k, len(shapes[k])) for k in arrays), _branch(made, "compute", "failed")],
        "data": [_DATA.format(k) for k in arrays],
        "check": [_branch(sound, "finite", "infinite")],
        "released": [f"call void @Py_DecRef(ptr %result{k})" for k in arrays],
        "packed": _packed(numbers, len(shapes), in_tuple=routine.layout.container is not None),
    }
    texts = {name: "\n  ".join(lines) for name, lines in pieces.items()}
    pointers = ", ".join(f"ptr {pointer}" for pointer in sizes)
    text = Lanes().filled("builtin", expected=len(inputs), routine=symbol, pointers=pointers, **texts)
    return f"{text}\n{Lanes().filled('finite')}"


def _packed(numbers: Sequence[int], count: int, *, in_tuple: bool) -> list[str]:
    """What is returned: the only result, or a tuple of all."""
    boxed = [_BOXED.format(k) for k in numbers]
    if not in_tuple:
        return [*boxed, "ret ptr %result0"]
    return [
        f"%results = call ptr @PyTuple_New(i64 {count})",
        _branch(["icmp ne ptr %results, null"], "pack", "failed"),
        "pack:",
        *boxed,
        *(f"%set{k} = call i32 @PyTuple_SetItem(ptr %results, i64 {k}, ptr %result{k})" for k in range(count)),
        _branch([f"icmp ne ptr %result{k}, null" for k in numbers], "packed", "lost"),
        "lost:",
        "call void @Py_DecRef(ptr %results)",
        "ret ptr null",
        "packed:",
        "ret ptr %results",
    ]


def _branch(conditions: Iterable[str], then: str, otherwise: str) -> str:
    """A branch to `then` if all conditions hold."""
    lines, all_so_far = [], "true"
    for k, condition in enumerate(conditions):
        lines += [f"%{then}.{k} = {condition}", f"%{then}.to.{k} = and i1 {all_so_far}, %{then}.{k}"]
        all_so_far = f"%{then}.to.{k}"
    return "\n  ".join([*lines, f"br i1 {all_so_far}, label %{then}, label %{otherwise}"])


_SHAPE = "@shape{0} = private constant [{1} x i64] [{2}]"

_LOOK = """%argument{0}.at = getelementptr ptr, ptr %arguments, i64 {0}
  %argument{0} = load ptr, ptr %argument{0}.at
  %in{0} = call ptr @usual(ptr %argument{0}, i64 {1})"""

_ALLOCATE = """%result{0} = call ptr @numpy.new(ptr @numpy.ndarray, i32 {1}, ptr @shape{0}, i32 12, ; NPY_DOUBLE
    ptr null, ptr null, i32 0, i32 0, ptr null)"""

_DATA = """%data{0} = getelementptr %array, ptr %result{0}, i32 0, i32 2
  %out{0} = load ptr, ptr %data{0}"""

_BOXED = """%number{0} = load double, ptr %out{0}
  %result{0} = call ptr @PyFloat_FromDouble(double %number{0})"""
