"""How long a tick takes: exported C by several compilers, native code here, and CasADi's C of the same graph."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from casadi_peer import casadi_driver, casadi_source
from export_builds import GNU, ZIG, Package, Toolchain, run
from export_ticks import Ticks, Trial

from adaptctl.arrays import Array
from adaptctl.compilation.native import Processor

BLOCK, BLOCKS = 500, 400
NATIVE = ("-march=native",)
"""gcc then fuses, unless it is told the language: told -std=c99, it does not, and clang does."""
TIMED = (
    Toolchain("gcc -O2 -march=native", ("gcc",), ("-O2", *NATIVE)),
    Toolchain("gcc -O2 -march=native, not fused", ("gcc",), ("-O2", *NATIVE, *GNU)),
    Toolchain("gcc -O2", ("gcc",), ("-O2", *GNU)),
    Toolchain("clang -O2 -march=native", ("clang",), ("-O2", *NATIVE)),
    Toolchain("zig cc -O2 -march=native", ZIG, ("-O2", *NATIVE)),
)

Call = Callable[[int], object]


def pointer(array: Array) -> Any:
    """An array's address, as C's functions take it."""
    import ctypes

    return array.ctypes.data_as(ctypes.c_void_p)


def timed(package: Package, trial: Trial, ticks: Ticks, host: Processor) -> dict[str, float]:
    """ns of processor time per tick: the 2nd percentile over blocks of ticks, taken in turns."""
    answers = np.zeros((BLOCK, trial.law.dof))
    runs: dict[str, Call] = {"native": _native(trial, ticks, host, answers)}
    for tool in TIMED:
        if not tool.missing:
            runs[tool.name] = _compiled(package, tool, ticks, answers)
    runs |= dict(_casadi(package, trial, ticks, answers))
    taken: dict[str, list[float]] = {label: [] for label in runs}
    for turn in range(BLOCKS):
        k = (turn * BLOCK) % (len(ticks.given) - BLOCK)
        for label, call in runs.items():
            begin = time.thread_time_ns()
            call(k)
            taken[label].append((time.thread_time_ns() - begin) / BLOCK)
    return {label: float(np.quantile(times, 0.02)) for label, times in taken.items()}


def _native(trial: Trial, ticks: Ticks, host: Processor, answers: Array) -> Call:
    stepper, rows = trial.stepper(host), ticks.given
    arms = stepper.ensemble(1)
    for key, value in trial.first(rows).items():
        arms.state[key] = value
    if trial.law.gain_sizes:
        arms.held["gains"] = trial.law.packed
    addresses = arms.state.address, arms.held.address

    def call(k: int, _kept: Any = arms) -> None:  # with nothing of Python around it
        given, made = rows[k : k + BLOCK].ctypes.data, answers.ctypes.data
        stepper.native(0, 1, BLOCK, rows.shape[1], 0, trial.law.dof, *addresses, given, 0, made)

    return call


def _compiled(package: Package, tool: Toolchain, ticks: Ticks, answers: Array) -> Call:
    code, rows = package.library(tool), ticks.given
    code.begin(pointer(rows[0, : package.joints].copy()))
    return lambda k: code.run(pointer(rows[k : k + BLOCK]), pointer(answers), BLOCK)


def _casadi(package: Package, trial: Trial, ticks: Ticks, answers: Array) -> Iterator[tuple[str, Call]]:
    """CasADi's C where CasADi is, first seen to give the same torques."""
    import ctypes

    law, folder = trial.law, package.folder
    source = casadi_source(law, folder)
    if source is None:
        return
    (folder / "driver.c").write_text(casadi_driver())
    sizes = np.array(list(law._memory_sizes.values()), dtype=np.int32)
    started = np.concatenate([np.ravel(x) for x in trial.first(ticks.given).values()])
    for label, more in {"-O2 -march=native": NATIVE, "-O2": GNU}.items():
        out = folder / f"casadi{len(more)}.so"
        run(["gcc", "-O2", *more, "-shared", "-fPIC", str(source), str(folder / "driver.c"), "-lm", "-o", str(out)])
        code, gains = ctypes.CDLL(str(out)), law.packed.copy()

        def call(k: int, code: Any = code, gains: Array = gains) -> None:
            given = pointer(ticks.given[k : k + BLOCK]), pointer(answers), BLOCK
            code.casadi_run(*given, law.dof, law.reference_size, len(sizes), pointer(sizes), pointer(gains))

        code.casadi_begin(pointer(started), len(started))
        call(0)
        assert np.abs(answers - ticks.torque[:BLOCK]).max() < 1e-9 * np.abs(ticks.torque).max()
        code.casadi_begin(pointer(started), len(started))
        yield f"CasADi, gcc {label}", call
