"""What a step computes of held columns alone: once a run, and to the same numbers."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.compilation import Stepper, compile_step, llvm, outlined
from adaptctl.compilation.graph import Op
from adaptctl.compilation.routine import Invariants, trace
from adaptctl.scalars import Column, Scalar, sin, where

RNG = np.random.default_rng(0)


@outlined
def pulled(x: Column, weights: Column, k: Scalar) -> Column:
    return Column(w * a + k for w, a in zip(weights, x, strict=True))


def step(x: Column, h: Column, u: Column) -> tuple[Column, Scalar, Scalar, Scalar]:
    """Sums of held numbers alone, in a call and outside; one of them is a result."""
    heavy = h[0] * h[1] + sin(h[2])
    weights = Column((heavy, h[1], h[0] - h[2]))
    pull = pulled(x, weights, u[0])
    again = pulled(pull, weights, heavy)
    bounded = where(h[0] < h[1], heavy, u[0])
    return Column(0.1 * a + 0.2 * b for a, b in zip(pull, again, strict=True)), heavy, bounded, h[2]


def by_hand(x: Array, h: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    heavy = h[:, 0] * h[:, 1] + np.sin(h[:, 2])
    weights = np.stack([heavy, h[:, 1], h[:, 0] - h[:, 2]], axis=1)
    for (k,) in u:
        pull = weights * x + k
        x = 0.1 * pull + 0.2 * (weights * pull + heavy[:, None])
    return x, heavy, np.where(h[:, 0] < h[:, 1], heavy, u[-1, 0]), h[:, 2]


def compiled(lanes: int) -> Stepper:
    return compile_step(step, state={"x": 3}, constants={"h": 3}, inputs={"u": 1}, lanes=lanes)


@pytest.mark.parametrize("length", [None, 2, 5])
@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_the_numbers_are_those_of_each_member(lanes: int, length: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """In as many pieces as there are, and for more blocks than one."""
    if length is not None:
        monkeypatch.setattr(llvm, "MAX_WHOLE_EXPRESSIONS", 0)
        monkeypatch.setattr(llvm, "PIECE_EXPRESSIONS", length)
    arms = compiled(lanes).ensemble(11)
    x, u = RNG.uniform(-1.0, 1.0, (11, 3)), RNG.uniform(-1.0, 1.0, (6, 1))
    arms.state["x"] = x
    for _ in range(2):  # what is held may change from run to run
        h = RNG.uniform(-1.0, 1.0, (11, 3))
        arms.held["h"] = h
        found = arms.run(len(u), {"u": u})
        x, *expected = by_hand(x, h, u)
        np.testing.assert_allclose(arms.state["x"], x, rtol=1e-13, atol=1e-15)
        for values, true in zip(found, expected, strict=True):
            np.testing.assert_allclose(values, true, rtol=1e-13, atol=1e-15)


@pytest.mark.usefixtures("optimized")
def test_lanes_give_the_same_bits_as_one_by_one() -> None:
    x, h, u = RNG.uniform(-1.0, 1.0, (11, 3)), RNG.uniform(-1.0, 1.0, (11, 3)), RNG.uniform(-1.0, 1.0, (50, 1))
    ends = []
    for lanes in (1, 8):
        arms = compiled(lanes).ensemble(11)
        arms.state["x"], arms.held["h"] = x, h
        arms.run(len(u), {"u": u})
        ends.append(arms.state["x"])
    np.testing.assert_array_equal(ends[0], ends[1])


def test_no_step_leaves_what_is_held_alone() -> None:
    arms = compiled(4).ensemble(5)
    x = RNG.uniform(-1.0, 1.0, (5, 3))
    arms.state["x"], arms.held["h"] = x, np.nan
    arms.run(0, {"u": np.zeros((0, 1))})
    np.testing.assert_array_equal(arms.state["x"], x)


def test_each_is_stored_once_and_what_a_call_takes_side_by_side() -> None:
    routine = trace(step, {"x": 3, "h": 3, "u": 1})
    same = Invariants.of(routine, [1])
    assert [x.op for x in same.stored] == [Op.ADD, Op.INPUT, Op.SUBTRACT]
    assert list(same.groups.values()) == [0]
    assert sorted(same.places.values()) == [0, 2]
    assert not any(x.op is Op.SIN for x in same.left(routine))
    assert Invariants.of(routine, []).stored == []


def test_operations_are_those_of_a_step() -> None:
    def weighed(x: Column, h: Column) -> tuple[Column]:
        return (Column((x[0] + h[0] * h[0] * h[1],)),)

    assert compile_step(weighed, state={"x": 1}, constants={"h": 2}).operations.flops == 1
    assert compile_step(weighed, state={"x": 1}, inputs={"h": 2}).operations.flops == 3
