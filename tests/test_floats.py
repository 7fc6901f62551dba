"""Functions of columns in Python, for mechanisms too long to compile: called, answering and refusing as kernels do."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from adaptctl.compilation import Kernel, compile_function
from adaptctl.compilation.kernel import OnFloats, native_or_floats
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, sin, sqrt

SIZES = {"x": 3, "y": 1}


def equation(x: Column, y: Column) -> tuple[Column, ...]:
    return sin(y[0]) * x, Column([sqrt(x @ x), y[0]]), Column(())


def test_floats_and_native_code_give_the_same() -> None:
    x, y = [1.0, -2.0, 0.5], np.array([0.7])
    native, plain = compile_function(equation, SIZES)(x, y), OnFloats(equation, SIZES).call(x, y)
    assert [part.shape for part in plain] == [part.shape for part in native] == [(3,), (2,), (0,)]
    for one, other in zip(plain, native, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)


def test_the_docs_know_the_largest_that_is_compiled() -> None:
    text = (Path(__file__).parent.parent / "docs" / "concepts.md").read_text(encoding="utf-8")
    assert f"Mechanisms of more than {MAX_COMPILED_LINKS} links run the same equations in Python" in text


def test_what_is_short_enough_is_compiled() -> None:
    assert isinstance(native_or_floats(equation, SIZES, MAX_COMPILED_LINKS), Kernel)
    assert isinstance(native_or_floats(equation, SIZES, MAX_COMPILED_LINKS + 1), OnFloats)


@pytest.mark.parametrize("finite", [True, "results"])
@pytest.mark.parametrize(
    "arguments",
    [
        ([1.0, 2.0], [0.0]),
        ([1.0, 2.0, 3.0], 0.0),
        ([1.0, 2.0, 3.0],),
        (["a", "b", "c"], [0.0]),
        ([1.0, np.nan, 3.0], [0.0]),
        ([1e200, 1e200, 1e200], [0.0]),
    ],
)
def test_refusals_are_the_kernels(arguments: tuple[object, ...], finite: bool) -> None:
    with pytest.raises((InputError, NonFiniteError)) as native:
        compile_function(equation, SIZES, name="law", finite=finite)(*arguments)
    with pytest.raises(native.type, match=re.escape(str(native.value))):
        OnFloats(equation, SIZES, name="law", finite=finite)(*arguments)
