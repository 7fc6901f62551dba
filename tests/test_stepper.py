"""Steps taken natively, by many members in lanes: the same numbers as one call after the other."""

from __future__ import annotations

import math
import platform
import re
import signal
import threading
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import pytest
from expression_trees import Tree, evaluated, size, trees
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from signals import signalled

from adaptctl.compilation import Ensemble, Stepper, compile_function, compile_step, outlined, trace
from adaptctl.compilation.lanes import LaneArray, Lanes
from adaptctl.compilation.llvm import program
from adaptctl.compilation.native import Processor
from adaptctl.errors import InputError, TraceError
from adaptctl.scalars import Column, clip, cos, minimum, sin, sqrt, where

pytestmark = pytest.mark.usefixtures("optimized")

Array = NDArray[np.float64]

X86 = platform.machine() in ("x86_64", "AMD64")
BASELINE = Processor("x86-64", "+sse2,-avx,-avx2,-avx512f") if X86 else Processor("generic", "+neon")  # no AVX


def swing(q: Column, v: Column, stiffness: Column, target: Column, push: Column) -> tuple[Column, Column, Any, Column]:
    """Two coupled pendulums, by semi-implicit Euler; the energy and the torque are outputs."""
    torque = Column(clip(k * (x - a) + u, -5.0, 5.0) for k, x, a, u in zip(stiffness, target, q, push, strict=True))
    after = v + 0.01 * Column(t - sin(a) - 0.1 * w for t, a, w in zip(torque, q, v, strict=True))
    energy = 0.5 * (v @ v) + 2.0 - cos(q[0]) - cos(q[1])
    return q + 0.01 * after, after, energy, torque


COLUMNS = {
    "state": {"q": 2, "v": 2},
    "constants": {"stiffness": 2},
    "inputs": {"target": 2},
    "per_member_inputs": {"push": 2},
}
STEPS = 7


@pytest.fixture(scope="module", params=[1, 2, 4, 8])
def stepper(request: pytest.FixtureRequest) -> Stepper:
    return compile_step(swing, **COLUMNS, lanes=request.param)


class Problem:
    """Numbers for `swing`, and the steps taken one by one for one member after the other."""

    def __init__(self, members: int, steps: int = STEPS) -> None:
        rng = np.random.default_rng(members)
        self.q, self.v, self.stiffness = rng.normal(size=(3, members, 2))
        self.target, self.push = rng.normal(size=(steps, 2)), rng.normal(size=(steps, members, 2))
        self.signals = {"target": self.target, "push": self.push}

    def ensemble(self, stepper: Stepper) -> Ensemble:
        ensemble = stepper.ensemble(len(self.q))
        ensemble.state["q"], ensemble.state["v"], ensemble.held["stiffness"] = self.q, self.v, self.stiffness
        return ensemble

    def one_by_one(self) -> tuple[Array, Array, Array, Array]:
        """q, v (members, 2) at the end; energies (steps, members) and torques (steps, members, 2)."""
        columns = [part for source in COLUMNS.values() for part in source]
        kernel = compile_function(swing, dict.fromkeys(columns, 2))
        q, v = self.q.copy(), self.v.copy()
        energy, torque = np.empty(self.push.shape[:2]), np.empty(self.push.shape)
        for t, target in enumerate(self.target):
            for m, stiffness in enumerate(self.stiffness):
                q[m], v[m], energy[t, m], torque[t, m] = kernel(q[m], v[m], stiffness, target, self.push[t, m])
        return q, v, energy, torque


@pytest.mark.parametrize("members", [1, 3, 8, 21])
def test_steps_are_calls_one_by_one(stepper: Stepper, members: int) -> None:
    problem = Problem(members)
    ensemble = problem.ensemble(stepper)
    energy, torque = ensemble.run(STEPS, problem.signals, record=True)
    found = ensemble.state["q"], ensemble.state["v"], energy, torque
    for ours, expected in zip(found, problem.one_by_one(), strict=True):
        assert ours.shape == expected.shape
        np.testing.assert_allclose(ours, expected, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("steps", [0, 1, 2, 5])
def test_a_run_goes_on_where_the_last_one_ended(stepper: Stepper, steps: int) -> None:
    problem = Problem(11)
    together, apart = problem.ensemble(stepper), problem.ensemble(stepper)
    whole = together.run(STEPS, problem.signals, record=True)
    first = apart.run(steps, {name: values[:steps] for name, values in problem.signals.items()}, record=True)
    rest = apart.run(STEPS - steps, {name: values[steps:] for name, values in problem.signals.items()}, record=True)
    for k, values in enumerate(whole):
        np.testing.assert_array_equal(values, np.concatenate([first[k], rest[k]]))
    np.testing.assert_array_equal(together.state["q"], apart.state["q"])


def test_without_recording_the_last_outputs_are_returned(stepper: Stepper) -> None:
    problem = Problem(5)
    recorded = problem.ensemble(stepper).run(STEPS, problem.signals, record=True)
    last = problem.ensemble(stepper).run(STEPS, problem.signals)
    for all_steps, latest in zip(recorded, last, strict=True):
        np.testing.assert_array_equal(all_steps[-1], latest)


def test_an_interrupt_waits_for_all_threads() -> None:
    """What they write to is looked at afterwards."""

    def count(n: Column) -> tuple[Column]:
        return (Column((n[0] + 1.0,)),)

    arms, steps = compile_step(count, state={"n": 1}).ensemble(1024), 2_000_000
    before, running = signal.signal(signal.SIGALRM, signal.default_int_handler), threading.active_count()
    try:
        with signalled("_Work.take", signal.SIGALRM, after=0.05), pytest.raises(KeyboardInterrupt):
            arms.run(steps, threads=2)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert threading.active_count() == running
    np.testing.assert_array_equal(arms.state["n"], steps)


@pytest.mark.parametrize("threads", [2, 3, 50])
def test_threads_give_the_same_bits(stepper: Stepper, threads: int) -> None:
    problem = Problem(37)
    alone, together = problem.ensemble(stepper), problem.ensemble(stepper)
    for one, other in zip(
        alone.run(STEPS, problem.signals), together.run(STEPS, problem.signals, threads=threads), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(alone.state.blocks, together.state.blocks)


def test_results_are_fresh(stepper: Stepper) -> None:
    problem = Problem(4)
    ensemble = problem.ensemble(stepper)
    energy, torque = ensemble.run(STEPS, problem.signals)
    before = energy.copy(), torque.copy(), ensemble.state["q"]
    kept = before[2].copy()
    ensemble.run(STEPS, problem.signals)
    np.testing.assert_array_equal(energy, before[0])
    np.testing.assert_array_equal(torque, before[1])
    np.testing.assert_array_equal(before[2], kept)


def test_a_nan_stays_with_its_member(stepper: Stepper) -> None:
    problem = Problem(9)
    sound = problem.ensemble(stepper)
    energy, _ = sound.run(STEPS, problem.signals)
    broken = problem.ensemble(stepper)
    broken.state.put("q", [4], [math.nan, 0.0])
    found, _ = broken.run(STEPS, problem.signals)
    assert np.isnan(found[4])
    others = np.arange(9) != 4
    np.testing.assert_array_equal(found[others], energy[others])


# Equations in lanes

triples = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(trees, st.lists(triples, min_size=1, max_size=9), st.sampled_from((2, 4, 8)))
@example(("sin", ("sin", ("neg", 0))), [(0.5, 0.0, 0.0)], 2)  # the sine of a sine
@settings(max_examples=25, deadline=None)
def test_random_equations_agree_in_lanes(tree: Tree, x: list[tuple[float, float, float]], lanes: int) -> None:
    stepper = compile_step(lambda x: (evaluated(tree, x),), state={}, constants={"x": 3}, lanes=lanes)
    ensemble = stepper.ensemble(len(x))
    ensemble.held["x"] = x
    (found,) = ensemble.run()
    kernel = compile_function(lambda x: evaluated(tree, x), {"x": 3})
    for value, one in zip(found, x, strict=True):
        tolerance = 1e-12 * size(tree, one)
        assert value == pytest.approx(float(evaluated(tree, one)), rel=0.0, abs=tolerance)
        assert value == pytest.approx(kernel(one), rel=0.0, abs=tolerance)


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_extrema_and_choices_in_lanes_are_numpys(lanes: int) -> None:
    special = [0.0, -0.0, 1.0, -2.5, math.inf, -math.inf, math.nan]
    x, y = (grid.ravel() for grid in np.meshgrid(special, special))

    def step(x: Column, y: Column) -> tuple[Any, ...]:
        a, b = x[0], y[0]
        return minimum(a, b), where(a < b, 1.0, 2.0), where(a <= b, a, b), sqrt(a), abs(a), -a, a / b

    ensemble = compile_step(step, state={}, constants={"x": 1, "y": 1}, lanes=lanes).ensemble(x.size)
    ensemble.held["x"], ensemble.held["y"] = x[:, None], y[:, None]
    with np.errstate(all="ignore"):
        quotient = x / y
        expected = [
            np.minimum(x, y),
            np.where(x < y, 1.0, 2.0),
            np.where(x <= y, x, y),
            np.sqrt(x),
            abs(x),
            -x,
            quotient,
        ]
    for found, values in zip(ensemble.run(), expected, strict=True):
        np.testing.assert_array_equal(found, values)


def test_calls_share_what_is_in_memory_already() -> None:
    """Whole arguments and whole results are handed on where they lie, others are gathered."""
    inner = outlined(lambda a, b: (Column(x * y for x, y in zip(a, b, strict=True)), a @ b))

    def step(x: Column, y: Column) -> tuple[Column, Column, Any]:
        first, dot = inner(x, y)
        second, _ = inner(first, Column((y[1], y[0], 3.0)))
        third, other = inner(Column((x[1], x[2], x[0])), first + second)
        return first, Column((*second.of[1:], dot)), other + third[0]

    x, y = np.random.default_rng(0).normal(size=(2, 10, 3))
    for lanes in (1, 4, 8):
        ensemble = compile_step(step, state={"x": 3, "y": 3}, lanes=lanes).ensemble(10)
        ensemble.state["x"], ensemble.state["y"] = x, y
        (output,) = ensemble.run()
        expected = step(Column(x.T), Column(y.T))
        np.testing.assert_allclose(output, expected[2], rtol=1e-14)
        np.testing.assert_allclose(ensemble.state["x"], np.array(expected[0].of).T, rtol=1e-14)
        np.testing.assert_allclose(ensemble.state["y"], np.array(expected[1].of).T, rtol=1e-14)


# Processors


def test_lanes_are_what_the_processor_has() -> None:
    assert Processor("skylake-avx512", "+sse2,+avx,+avx2,+avx512f").lanes == 8
    assert Processor("haswell", "+sse2,+avx,+avx2,-avx512f").lanes == 4
    assert Processor("sandybridge", "+sse2,+avx,-avx2,-avx512f").lanes == 4
    assert Processor("nehalem", "+sse2,+sse4.2,-avx,-avx2,-avx512f").lanes == 2
    assert Processor("apple-m1", "+neon").lanes == 2
    assert Processor("generic", "").lanes == 1
    assert compile_step(swing, **COLUMNS).lanes == Processor.host().lanes


@pytest.mark.parametrize("processor", [BASELINE, Processor("generic", "")], ids=["two lanes", "one"])
def test_a_processor_without_avx_gets_what_it_can_run(processor: Processor) -> None:
    stepper = compile_step(swing, **COLUMNS, processor=processor)
    assert stepper.lanes == processor.lanes
    problem = Problem(3)
    energy, _ = problem.ensemble(stepper).run(STEPS, problem.signals, record=True)
    np.testing.assert_allclose(energy, problem.one_by_one()[2], rtol=1e-13)


@pytest.mark.parametrize("lanes", [1, 2, 4, 8])
def test_code_for_a_processor_without_avx_uses_none(lanes: int) -> None:
    text = program(trace(swing, dict.fromkeys(("q", "v", "stiffness", "target", "push"), 2)), Lanes(lanes)).text
    module = llvm.parse_assembly(text.replace("define internal", "define"), llvm.create_context())
    assembly = BASELINE.machine().emit_assembly(module)
    assert "%xmm" in assembly or not X86
    assert not {"%ymm", "%zmm", "vfmadd"} & set(re.findall(r"%[yz]mm|vfmadd", assembly))


# Memory


@pytest.mark.parametrize("members", [1, 7, 8, 9])
def test_columns_are_read_as_they_were_assigned(stepper: Stepper, members: int) -> None:
    ensemble, rows = stepper.ensemble(members), np.random.default_rng(0).normal(size=(members, 2))
    ensemble.state["v"] = rows
    np.testing.assert_array_equal(ensemble.state["v"], rows)
    np.testing.assert_array_equal(ensemble.state["q"], np.zeros((members, 2)))
    ensemble.state["q"] = [1.0, 2.0]
    np.testing.assert_array_equal(ensemble.state["q"], np.tile([1.0, 2.0], (members, 1)))
    chosen = np.unique([0, members // 2, members - 1])
    ensemble.state.put("v", chosen, -rows[chosen])
    rows[chosen] *= -1.0
    np.testing.assert_array_equal(ensemble.state["v"], rows)


def test_memory_is_blocks_of_lanes_and_spare_lanes_repeat_the_last_member() -> None:
    ensemble = compile_step(swing, **COLUMNS, lanes=4).ensemble(6)
    ensemble.state["v"] = np.arange(12.0).reshape(6, 2)
    blocks = ensemble.state.blocks
    assert blocks.shape == (2, 4, 4)
    assert ensemble.state.address % 64 == 0
    np.testing.assert_array_equal(blocks[0, 2:], [[0.0, 2.0, 4.0, 6.0], [1.0, 3.0, 5.0, 7.0]])
    np.testing.assert_array_equal(blocks[1, 2:], [[8.0, 10.0, 10.0, 10.0], [9.0, 11.0, 11.0, 11.0]])
    ensemble.state.put("v", [5], [[-1.0, -2.0]])
    np.testing.assert_array_equal(blocks[1, 2:], [[8.0, -1.0, -1.0, -1.0], [9.0, -2.0, -2.0, -2.0]])


def test_a_stepper_describes_itself() -> None:
    stepper = compile_step(swing, **COLUMNS, name="pendulums")
    assert stepper.name == "pendulums"
    assert stepper.outputs == ((), (2,))
    assert [dict(part) for part in stepper.columns.values()] == list(COLUMNS.values())
    assert stepper.operations["sin"] == 2


# Bad input


def nothing(q: Column) -> tuple[Column]:
    return (q,)


BAD_STEPS: dict[str, tuple[Callable[..., Any], str]] = {
    "no tuple": (
        lambda q, v: q,
        r"<lambda>: expected a tuple as result, starting with the new state: q \(2\), v \(1\)",
    ),
    "too few": (lambda q, v: (q,), "starting with the new state"),
    "wrong length": (lambda q, v: (q, q), "starting with the new state"),
    "scalar": (lambda q, v: (q, v[0]), "starting with the new state"),
}


@pytest.mark.parametrize("case", BAD_STEPS)
def test_a_step_must_return_its_state_first(case: str) -> None:
    step, message = BAD_STEPS[case]
    with pytest.raises(InputError, match=message):
        compile_step(step, state={"q": 2, "v": 1})


def test_a_step_must_not_branch_on_its_state() -> None:
    with pytest.raises(TraceError, match=r"use where.*test_stepper"):
        compile_step(lambda q: (q if q[0] > 0.0 else -q,), state={"q": 1})


def test_names_and_lanes_are_checked() -> None:
    with pytest.raises(InputError, match="distinct names"):
        compile_step(nothing, state={"q": 1}, constants={"q": 1})
    with pytest.raises(InputError, match=r"lanes: expected 1, 2, 4 or 8, .*got 3"):
        compile_step(nothing, state={"q": 1}, lanes=3)


BAD_RUNS: dict[str, tuple[tuple[Any, ...], str]] = {
    "steps": ((-1, {}), "steps: expected a whole number of at least 0, got -1"),
    "missing": ((1, {"target": np.zeros((1, 2))}), "signals: expected target, push, got target"),
    "unknown": ((1, {"goal": 1.0}), "signals: expected target, push, got goal"),
    "shape": (
        (3, {"target": np.zeros((2, 2)), "push": np.zeros((3, 3, 2))}),
        r"'target': expected real numbers that broadcast to shape \(3, 2\)",
    ),
    "members": (
        (3, {"target": np.zeros((3, 2)), "push": np.zeros((3, 4, 2))}),
        r"'push': expected real numbers that broadcast to shape \(3, 3, 2\)",
    ),
    "kind": ((1, {"target": 1j, "push": 0.0}), "'target': expected real numbers"),
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_wrong_runs_are_refused(stepper: Stepper, case: str) -> None:
    arguments, message = BAD_RUNS[case]
    with pytest.raises(InputError, match=message):
        stepper.ensemble(3).run(*arguments)


def test_memory_that_is_no_room_of_the_ensemble_is_refused(stepper: Stepper) -> None:
    three, signals = stepper.ensemble(3), {"target": np.zeros((2, 2)), "push": np.zeros((2, 3, 2))}
    three.record_into(three.allocate_outputs(2), 0, 2, signals)
    for room in (
        *(stepper.ensemble(n).allocate_outputs(2) for n in (2, 40)),
        LaneArray({"0": 1}, 3, three.allocate_outputs(2).lanes, (2,)),
    ):
        with pytest.raises(InputError, match="record: room: expected an array made by this ensemble"):
            three.record_into(room, 0, 2, signals)
    with pytest.raises(InputError, match="expected steps from 0 to 2, got 1 to 3"):
        three.record_into(three.allocate_outputs(2), 1, 2, signals)


def test_wrong_columns_are_refused(stepper: Stepper) -> None:
    state = stepper.ensemble(3).state
    with pytest.raises(InputError, match="unknown column 'p'; columns: q, v"):
        state["p"] = 1.0
    with pytest.raises(InputError, match="unknown column 'p'"):
        _ = state["p"]
    with pytest.raises(InputError, match=r"'q': expected real numbers that broadcast to shape \(3, 2\)"):
        state["q"] = np.zeros((3, 3))
    for members in ([3], [-1], [0.5], 1, [[0]]):
        with pytest.raises(InputError, match="members: expected numbers from 0 to 2"):
            state.put("q", members, 0.0)
    with pytest.raises(InputError, match=r"'q': expected real numbers that broadcast to shape \(1, 2\)"):
        state.put("q", [0], np.zeros(3))


def test_signals_in_place_are_those_that_are_passed(stepper: Stepper) -> None:
    """From the step on that the room is filled from."""
    problem, late = Problem(11), ((2, 0), (0, 0), (0, 0))
    passed, placed = (problem.ensemble(stepper) for _ in range(2))
    signals, rooms = placed.signals(STEPS + 2), (passed.allocate_outputs(STEPS + 2), placed.allocate_outputs(STEPS + 2))
    signals.shared["target"] = np.pad(problem.target[:, None], late)
    signals.driven["push"] = np.pad(problem.push, late)
    passed.record_into(rooms[0], 2, STEPS, problem.signals)
    placed.record_into(rooms[1], 2, STEPS, signals)
    np.testing.assert_array_equal(rooms[0].blocks[2:], rooms[1].blocks[2:])
    np.testing.assert_array_equal(passed.state.blocks, placed.state.blocks)


def test_signals_of_another_form_or_of_too_few_steps_are_refused(stepper: Stepper) -> None:
    three = stepper.ensemble(3)
    with pytest.raises(InputError, match="record: signals: expected steps from 0 to 2, got 1 to 3"):
        three.record_into(three.allocate_outputs(3), 1, 2, three.signals(2))
    with pytest.raises(InputError, match="record: signals: expected an array made by this ensemble"):
        three.record_into(three.allocate_outputs(3), 0, 2, stepper.ensemble(2).signals(2))
