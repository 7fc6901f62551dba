"""Routines that several compiled steps call are traced and compiled once."""

from __future__ import annotations

import gc
from collections.abc import Callable
from threading import Thread
from typing import Any

import numpy as np
import pytest
from nightly import nightly

from adaptctl.compilation import compile_step, llvm, native, outlined
from adaptctl.compilation import routine as routines
from adaptctl.scalars import Column, cos, sin

pytestmark = pytest.mark.usefixtures("optimized")

LENGTH = 300


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Modules that LLVM compiles."""
    found: list[str] = []
    known = native._compiled

    def compile_text(text: str, machine: Any) -> bytes:
        found.append(text)
        return known(text, machine)

    monkeypatch.setenv("ADAPTCTL_CACHE", "off")
    monkeypatch.setattr(native, "_compiled", compile_text)
    return found


def long_function(scale: float) -> Callable[[Column], Column]:
    """Map of many operations."""

    def mapped(x: Column) -> Column:
        a, b = x
        for k in range(LENGTH):
            a, b = cos(a) * scale + k * b, sin(b) - scale * a
        return Column((a, b))

    return mapped


def two_steps(function: Callable[[Column], Column]) -> tuple[Any, Any]:
    """Steps that call a function, each in its own way."""
    once = compile_step(lambda x: (function(x),), state={"x": 2}, lanes=1, name="once")
    twice = compile_step(lambda x: (function(function(x)) * 0.5,), state={"x": 2}, lanes=1, name="twice")
    return once, twice


@nightly
def test_a_long_routine_is_compiled_once_and_gives_the_same_bits(compiled: list[str]) -> None:
    start = np.array([0.3, -0.2])
    apart = [step.run_single(5, start, np.empty(0)) for step in two_steps(outlined(long_function(0.1)))]
    assert len(compiled) == 3
    assert sum(text.count("define void @shared.") for text in compiled) == 1
    found = two_steps(long_function(0.1))
    assert len(compiled) == 5
    for step, there in zip(found, apart, strict=True):
        assert step.run_single(5, start, np.empty(0)).tobytes() == there.tobytes()


@nightly
def test_shared_code_lives_as_long_as_what_calls_it(compiled: list[str]) -> None:
    function, start = outlined(long_function(0.2)), np.array([0.1, 0.2])
    first, second = two_steps(function)
    before = second.run_single(3, start, np.empty(0))
    del first
    gc.collect()
    assert second.run_single(3, start, np.empty(0)).tobytes() == before.tobytes()
    alive = len(native._modules)
    del second
    gc.collect()
    assert len(native._modules) == alive - 1
    again = two_steps(function)[1]
    assert again.run_single(3, start, np.empty(0)).tobytes() == before.tobytes()
    assert len(compiled) == 6


def test_routines_that_call_shared_ones_are_shared_after_them(
    compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(llvm, "MIN_APART", 5)
    inner = outlined(lambda x: Column((cos(x[0]) + x[1], 0.3 * x[0])))
    outer, start = outlined(lambda x: Column((sin(inner(x)[0]), x[0] * inner(x)[1]))), np.array([0.3, -0.2])
    once, twice = two_steps(outer)
    defined = [text.count("define void @shared.") for text in compiled]
    assert defined == [1, 1, 0, 0]
    assert twice.run_single(1, start, np.empty(0)).tolist() == (0.5 * once.run_single(2, start, np.empty(0))).tolist()


@nightly
def test_short_routines_and_lanes_stay_in_their_module(compiled: list[str]) -> None:
    short = outlined(lambda x: Column((sin(x[0]) + x[1], x[0])))
    two_steps(short)
    compile_step(lambda x: (outlined(long_function(0.1))(x),), state={"x": 2}, lanes=2, name="wide")
    assert len(compiled) == 3
    assert not any("@shared." in text for text in compiled)


def test_names_of_shared_code_tell_what_it_is() -> None:
    def symbol(scale: float, target: str) -> str:
        function = outlined(long_function(scale))
        traced = routines.trace(lambda x: function(x), {"x": 2}, name="caller")
        (shared,) = llvm.worth_a_module(traced)
        return llvm.module_of(shared, llvm.Lanes(1), target)[1]

    assert symbol(0.1, "a") == symbol(0.1, "a")
    assert len({symbol(0.1, "a"), symbol(0.2, "a"), symbol(0.1, "b")}) == 3


def test_an_outlined_function_keeps_a_few_of_its_traces(monkeypatch: pytest.MonkeyPatch) -> None:
    traced: list[float] = []

    @outlined
    def scaled(x: Column, factor: float) -> Column:
        traced.append(factor)
        return factor * x

    for factor in (2.0, 2.0, *map(float, range(3, 3 + routines.MAX_KEPT_ROUTINES)), 2.0):
        step = routines.trace(lambda x, by=factor: scaled(x, by), {"x": 1}, name="step")
        assert step.operations[routines.Op.MULTIPLY] == 1
    assert traced == [2.0, *map(float, range(3, 3 + routines.MAX_KEPT_ROUTINES)), 2.0]


@nightly
def test_threads_share_code_too() -> None:
    function, start = outlined(long_function(0.3)), np.array([0.3, -0.1])
    found: list[bytes] = []

    def use() -> None:
        for _ in range(3):
            found.append(two_steps(function)[1].run_single(4, start, np.empty(0)).tobytes())

    threads = [Thread(target=use) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 12
    assert len(set(found)) == 1


@pytest.mark.parametrize(
    "body",
    [
        "%p = alloca double\n store double %x, ptr %p\n %y = load double, ptr %p\n %z = fadd double %y, %y",
        "%z = call double @twice(double %x)",
    ],
    ids=["stack", "call"],
)
def test_what_a_function_leaves_on_the_stack_or_calls_costs_nothing(body: str) -> None:
    """Machine code is that of the sum itself."""
    twice = "define private double @twice(double %x) alwaysinline {\n %z = fadd double %x, %x\n ret double %z\n}\n"
    with native._compiler():
        machine = native.Processor.host().machine()
        codes = [
            native._emitted(f"{twice}define double @f(double %x) {{\n {lines}\n ret double %z\n}}\n", machine)
            for lines in (body, "%z = fadd double %x, %x")
        ]
    assert codes[0] == codes[1]
