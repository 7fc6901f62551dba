"""Built-in functions of Python that read and create NumPy arrays."""

from __future__ import annotations

import ctypes
import functools
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.native import NativeCode, define
from adaptctl.compilation.routine import Routine

Finite: TypeAlias = bool | Literal["results"]
"""Check for NaN and infinity: nowhere, everywhere, or in results."""

_ENTRY = "call"
_FASTCALL = 0x80  # METH_FASTCALL: an array of arguments and their number
_NEW = 93  # PyArray_New in NumPy's table of functions
_PYTHON = ("PyObject_Vectorcall", "PyTuple_New", "PyType_GenericAlloc", "PyFloat_FromDouble", "Py_IncRef", "Py_DecRef")


class Place(NamedTuple):
    """Source of one column of a built-in function."""

    argument: int | None
    item: int | None = None


class Form(NamedTuple):
    """Calling convention of a built-in function."""

    places: tuple[Place, ...]
    tuples: Mapping[int, int] = MappingProxyType({})
    wrapped: Mapping[int, int] = MappingProxyType({})

    @classmethod
    def plain(cls, count: int) -> Form:
        """Calling convention of `count` arrays, one per column."""
        return cls(tuple(Place(k) for k in range(count)))

    @property
    def arguments(self) -> list[int]:
        """Indices, ascending, of those arguments of the function from which columns are taken."""
        return sorted({place.argument for place in self.places if place.argument is not None})

    @property
    def types(self) -> dict[int, int]:
        """Index of each tuple argument's type among the function's objects."""
        return {argument: 1 + k for k, argument in enumerate(self.tuples)}

    def bound(self, column: int) -> int:
        """Index of a column's bound array among the function's objects."""
        return 1 + len(self.tuples) + sum(place.argument is None for place in self.places[:column])

    @property
    def spares(self) -> int:
        """Index of the first spare result array among the function's objects."""
        return self.bound(len(self.places))


class _Array(ctypes.Structure):
    """First fields of NumPy's array object (numpy/ndarraytypes.h)."""

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
        ("weak_references", ctypes.c_void_p),
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
    """True for CPython with the expected layout of tuples and arrays."""
    if sys.implementation.name != "cpython" or object.__basicsize__ != _Array.data.offset:
        return False
    if sys.byteorder != "little" or np.ndarray.__weakrefoffset__ != _Array.weak_references.offset:
        return False
    items = (object(),)
    if ctypes.c_void_p.from_address(id(items) + tuple.__basicsize__).value != id(items[0]) or tuple.__basicsize__ != 24:
        return False
    probe = np.zeros((5, 3))[:, 1]
    array, ndarray, float64 = _Array.from_address(id(probe)), id(np.ndarray), id(np.dtype(np.float64))
    found = array.type, array.data, array.ndim, array.shape[0], array.dtype, array.flags
    if found != (ndarray, probe.ctypes.data, 1, 5, float64, probe.flags.num):
        return False
    capsule = np._core._multiarray_umath._ARRAY_API  # type: ignore[attr-defined]  # in no stub
    table = _api("PyCapsule_GetPointer", ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(capsule, None)
    new = ctypes.c_void_p.from_address(table + _NEW * ctypes.sizeof(ctypes.c_void_p))
    python = {name: ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p) for name in _PYTHON}
    define({"numpy.ndarray": ndarray, "numpy.float64": float64, "numpy.new": new.value or 0})
    define({name: function.value or 0 for name, function in python.items()})
    return True


def builtin(
    code: NativeCode, name: str, instead: Callable[..., Any], *bound: Any, results: int = 0
) -> Callable[..., Any]:
    """Built-in function that runs native code, or `instead` on unusual arguments."""
    definition = _Definition(name.encode(), code.address(_ENTRY), _FASTCALL, None)
    kept = (instead, *bound, *[None] * (2 * results), code, definition)
    new = _api("PyCFunction_NewEx", ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return new(ctypes.addressof(definition), kept, None)


def _api(name: str, *types: Any) -> Callable[..., Any]:
    return ctypes.PYFUNCTYPE(*types)((name, ctypes.pythonapi))


def builtin_source(routine: Routine, symbol: str, *, finite: Finite, form: Form) -> str:
    """LLVM IR of a built-in function of a routine."""
    shapes, inputs = dict(enumerate(routine.layout.shapes)), dict(enumerate(routine.inputs))
    arrays, numbers = ([k for k, shape in shapes.items() if bool(shape) is wanted] for wanted in (True, False))
    sizes = {f"%in{k}": n for k, n in inputs.items()} | {f"%out{k}": math.prod(shape) for k, shape in shapes.items()}
    fitting = [*(f"and i1 %is{i}, true" for i in form.tuples), *(f"icmp ne ptr %in{k}, null" for k in inputs)]
    fresh = [*(f"%result{k}" for k in arrays), *(f"%wrap{k}" for k in form.wrapped)]
    checked = {pointer: n for pointer, n in sizes.items() if finite is True or (finite and pointer.startswith("%out"))}
    sound = [f"call i1 @finite(ptr {pointer}, i64 {n})" for pointer, n in checked.items()]
    allocated = [_MADE.format(k, form.spares + 2 * j, len(shapes[k])) for j, k in enumerate(arrays)]
    wrapped = [_WRAP.format(k, form.types[argument]) for k, argument in form.wrapped.items()]
    pieces = {
        "shapes": [_SHAPE.format(k, len(shapes[k]), ", ".join(f"i64 {n}" for n in shapes[k])) for k in arrays],
        "numbers": [f"%out{k} = alloca double" for k in numbers],
        "look": [*_found(form, inputs), _branch(fitting, "usual", "unusual")],
        "allocate": [*allocated, *wrapped, _branch([f"icmp ne ptr {x}, null" for x in fresh], "compute", "failed")],
        "data": [_DATA.format(k) for k in arrays],
        "check": [_branch(sound, "finite", "infinite")],
        "released": [f"call void @Py_DecRef(ptr {x})" for x in fresh],
        "packed": _packed(form, numbers, len(shapes), in_tuple=routine.layout.container is not None),
    }
    texts = {name: "\n  ".join(lines) for name, lines in pieces.items()}
    pointers = ", ".join(f"ptr {pointer}" for pointer in sizes)
    text = Lanes().filled("builtin", expected=len(form.arguments), routine=symbol, pointers=pointers, **texts)
    return "\n".join([text, *map(Lanes().filled, ("finite", "free_list"))])


def _found(form: Form, inputs: Mapping[int, int]) -> list[str]:
    lines = [_ARGUMENT.format(i) for i in form.arguments]
    lines += [_TUPLE.format(i, form.types[i], size) for i, size in form.tuples.items()]
    for k, n in inputs.items():
        argument, item = form.places[k]
        given = f"%argument{argument}"
        if argument is None or item is not None:
            source, at = ("%kept", form.bound(k)) if argument is None else (f"%tuple{argument}", item)
            lines.append(_ITEM.format(f"%column{k}", source, at))
            given = f"%column{k}"
        lines.append(f"%in{k} = call ptr @usual(ptr {given}, i64 {n})")
    return lines


def _packed(form: Form, numbers: Sequence[int], count: int, *, in_tuple: bool) -> list[str]:
    boxed = [_BOXED.format(k) for k in numbers]
    if not in_tuple:
        return [*boxed, "ret ptr %result0"]
    parts = [f"%wrap{k}" if k in form.wrapped else f"%result{k}" for k in range(count)]
    return [
        f"%results = call ptr @PyTuple_New(i64 {count})",
        _branch(["icmp ne ptr %results, null"], "pack", "failed"),
        "pack:",
        *boxed,
        *(_SET.format(f"%wrapped{k}", f"%wrap{k}", 0, f"%result{k}") for k in form.wrapped),
        *(_SET.format(f"%set{k}", "%results", k, part) for k, part in enumerate(parts)),
        _branch([f"icmp ne ptr %result{k}, null" for k in numbers], "packed", "lost"),
        "lost:",
        "call void @Py_DecRef(ptr %results)",
        "ret ptr null",
        "packed:",
        "ret ptr %results",
    ]


def _branch(conditions: Iterable[str], then: str, otherwise: str) -> str:
    lines, all_so_far = [], "true"
    for k, condition in enumerate(conditions):
        lines += [f"%{then}.{k} = {condition}", f"%{then}.to.{k} = and i1 {all_so_far}, %{then}.{k}"]
        all_so_far = f"%{then}.to.{k}"
    return "\n  ".join([*lines, f"br i1 {all_so_far}, label %{then}, label %{otherwise}"])


_SHAPE = "@shape{0} = private constant [{1} x i64] [{2}]"

_ARGUMENT = """%argument{0}.at = getelementptr ptr, ptr %arguments, i64 {0}
  %argument{0} = load ptr, ptr %argument{0}.at"""

_ITEM = """{0}.at = getelementptr %tuple, ptr {1}, i32 0, i32 3, i64 {2}
  {0} = load ptr, ptr {0}.at"""

_SET = """{0} = getelementptr %tuple, ptr {1}, i32 0, i32 3, i64 {2}
  store ptr {3}, ptr {0}"""

_TUPLE = """%type{0}.at = getelementptr %tuple, ptr %kept, i32 0, i32 3, i64 {1}
  %type{0} = load ptr, ptr %type{0}.at
  %is{0} = call i1 @is(ptr %argument{0}, ptr %type{0}, i64 {2})
  %tuple{0} = select i1 %is{0}, ptr %argument{0}, ptr %kept ; another is not read, and what is kept is as long"""

_WRAP = """%wrap{0}.type.at = getelementptr %tuple, ptr %kept, i32 0, i32 3, i64 {1}
  %wrap{0}.type = load ptr, ptr %wrap{0}.type.at
  %wrap{0} = call ptr @PyType_GenericAlloc(ptr %wrap{0}.type, i64 1)"""

_MADE = """%result{0} = call ptr @made(ptr %kept, i64 {1}, i32 {2}, ptr @shape{0})"""

_DATA = """%data{0} = getelementptr %array, ptr %result{0}, i32 0, i32 2
  %out{0} = load ptr, ptr %data{0}"""

_BOXED = """%number{0} = load double, ptr %out{0}
  %result{0} = call ptr @PyFloat_FromDouble(double %number{0})"""
