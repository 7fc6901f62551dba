"""Optimization levels of native code: both give the same, bit for bit where no operations are fused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from every_law import LAWS, REDUCED, law_named
from nightly import mostly_at_night

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.compilation.native import LEVEL, QUICK, optimization
from adaptctl.compilation.object_cache import _HEAD
from adaptctl.control.controller import MEMORY, Controller, compiled_law
from adaptctl.errors import InputError

ARMS, TICKS = 9, 3


def ticks(law: Controller[Any]) -> list[Array]:
    """Torques and states of some ticks of code made now: of arms in lanes, then of one alone."""
    kernel: Any = compiled_law.__wrapped__(law.structure)
    rng, start, still = np.random.default_rng(0), np.asarray(law.neutral_configuration), np.zeros(law.dof)
    memory = np.tile(law._array_of(law.init(start, still), ()), (ARMS, 1))
    results: list[Array] = []
    for _ in range(TICKS):
        given = {name: rng.uniform(-0.1, 0.1, (ARMS, size)) for name, size in law._given_sizes.items()}
        given["p"] += start
        given |= {MEMORY: memory} | dict.fromkeys(law.gain_sizes, law.packed)
        torque, memory = np.empty((ARMS, law.dof)), np.empty_like(memory)
        kernel.map(*given.values(), out=[torque, memory])
        results += [torque, memory, *kernel(*(np.atleast_2d(values)[0] for values in given.values()))]
    return results


@pytest.mark.parametrize("name", mostly_at_night((*LAWS, *REDUCED), "touch", "tool", "loop"))
def test_a_law_has_the_bits_of_sse2_where_nothing_is_fused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {}
    for level, processor in ((LEVEL, "sse2"), (QUICK, "sse2"), (QUICK, "native")):
        monkeypatch.setenv("ADAPTCTL_OPTIMIZATION", str(level))
        monkeypatch.setenv("ADAPTCTL_PROCESSOR", processor)
        made[level, processor] = ticks(law_named(name))
    expected, *others = made.values()
    for results in others:
        for result, value in zip(results, expected, strict=True):
            np.testing.assert_array_equal(result, value)


@pytest.mark.parametrize(("chosen", "level"), [("0", QUICK), ("1", LEVEL), ("", LEVEL), (None, LEVEL)])
def test_a_level_is_chosen(chosen: str | None, level: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ADAPTCTL_OPTIMIZATION", raising=False)
    if chosen is not None:
        monkeypatch.setenv("ADAPTCTL_OPTIMIZATION", chosen)
    assert optimization() == level


@pytest.mark.parametrize("chosen", ["2", "fast", "01"])
def test_an_unknown_level_is_refused(chosen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_OPTIMIZATION", chosen)
    with pytest.raises(InputError, match=f"ADAPTCTL_OPTIMIZATION: expected 0 or 1, got '{chosen}'"):
        compile_function(lambda x: x @ x, {"x": 2})([1.0, 2.0])


def test_each_level_has_code_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_CACHE", str(tmp_path))
    seen = []
    for level in (QUICK, LEVEL, QUICK):
        monkeypatch.setenv("ADAPTCTL_OPTIMIZATION", str(level))
        compile_function(lambda x: x @ x, {"x": 9})(np.ones(9))
        seen.append({path.read_bytes()[_HEAD:] for path in tmp_path.iterdir()})
    assert seen[0] < seen[1] == seen[2]
