"""The processor that code is made for: all that this one has, or less on request."""

from __future__ import annotations

import numpy as np
import pytest
from levels import LEVELS, usable

from adaptctl.compilation import compile_step
from adaptctl.compilation.native import Processor
from adaptctl.errors import InputError
from adaptctl.scalars import Column, sin

pytestmark = pytest.mark.usefixtures("any_processor")


def sines() -> np.ndarray:
    def step(x: Column) -> tuple[Column]:
        return (Column(sin(3.0 * a + b) * b for a, b in zip(x, (*x.of[1:], x[0]), strict=True)),)

    ensemble = compile_step(step, state={"x": 3}).ensemble(17)
    ensemble.state["x"] = np.linspace(-1.0, 1.0, 51).reshape(17, 3)
    ensemble.run(5)
    return ensemble.state["x"]


@pytest.mark.parametrize("level", LEVELS)
def test_a_level_is_used_or_refused(level: str, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = sines()
    monkeypatch.setenv("ADAPTCTL_PROCESSOR", level)
    if level in usable():
        assert Processor.host().lanes == LEVELS[level]
        np.testing.assert_allclose(sines(), expected, rtol=0, atol=1e-13)
    else:
        with pytest.raises(InputError, match=f"ADAPTCTL_PROCESSOR: '{level}' cannot be used: this processor, .* lacks"):
            sines()


def test_what_a_level_takes_away() -> None:
    """Of a processor that has all: a level names every instruction set that it keeps, and no other."""
    everything = "+sse2,+avx,+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl"
    whole = Processor("znver4", everything)
    assert whole.limited("sse2") == Processor("x86-64", "+sse2")
    assert whole.limited("avx512") == Processor("x86-64-v4", everything)
    assert whole.limited("avx2").name == "x86-64-v3"
    assert "+fma" in whole.limited("avx2").features
    assert "avx512" not in whole.limited("avx2").features
    assert [whole.limited(level).lanes for level in LEVELS] == list(LEVELS.values())


def test_a_level_that_the_processor_lacks_is_refused() -> None:
    with pytest.raises(InputError, match="this processor, nehalem, lacks avx, avx2, bmi"):
        Processor("nehalem", "+sse2,+sse4.2,-avx,-avx2").limited("avx2")
    with pytest.raises(InputError, match="this processor, apple-m1, lacks sse2; use 'native', or unset it"):
        Processor("apple-m1", "+neon").limited("sse2")


@pytest.mark.parametrize("level", ["native", ""])
def test_native_is_all_that_the_processor_has(level: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Processor.host()
    monkeypatch.setenv("ADAPTCTL_PROCESSOR", level)
    assert Processor.host() == whole


def test_an_unknown_level_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_PROCESSOR", "sse9")
    with pytest.raises(InputError, match="expected one of native, sse2, avx2, avx512, got 'sse9'"):
        Processor.host()
