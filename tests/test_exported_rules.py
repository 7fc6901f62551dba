"""What export adds to a law: its check on its own arm, its rules for gains, and how its C puts memory back."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from c_compiler import build, said
from golden.capture import arms

import adaptctl
from adaptctl.codegen.c_loops import _position
from adaptctl.codegen.c_package import CPackage
from adaptctl.codegen.c_program import _callees
from adaptctl.codegen.gain_rules import _most, gain_rules
from adaptctl.codegen.interface import Field, Interface, short_names, status_bits, status_of
from adaptctl.compilation import outlined, trace
from adaptctl.compilation.loops import Index
from adaptctl.control import Controller, PDGravity, ReferencePoint, Sinusoids, SlotineLi
from adaptctl.description import builtin_file
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.loops.continuation import MAX_LOST_GAP
from adaptctl.dynamics.loops.single_precision import MAX_CLOSURE_GAP
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, absolute, where
from adaptctl.simulation import Plant

EXAMPLE = builtin_file("two_link")


def test_the_check_states_the_errors_of_the_first_and_of_the_last_ten_seconds(tmp_path: Path) -> None:
    """Against the plant stepped period by period, 600 s of it; the arm starts off the reference's path, and the slow
    sinusoid is at another place at the end than at the beginning."""
    law = PDGravity(load(EXAMPLE), [90.0, 60.0], [9.0, 6.0])
    reference = Sinusoids([0.3, -0.5], [0.6, 0.5], [0.0104, 0.0136])
    checked = adaptctl.export(
        law, tmp_path / "arm", without_safety_filter=True, check=True, reference=reference
    ).manifest["check"]
    plant, period = Plant(law.mechanism, 1e-3), 1e-3
    time = period * np.arange(600_000)
    squares = {}
    points = reference(time)
    start = points.p[0]
    state, memory = plant.init(start, [0.0, 0.0]), law.init(start, [0.0, 0.0])
    for k in range(10_000):
        squares[k] = np.mean((state.p - points.p[k]) ** 2)
        torque, memory = law.step(memory, state.p, state.v, ReferencePoint(points.p[k], points.v[k], points.a[k]))
        state = plant.step(state, torque)
    assert checked["rms_error_first_10_s"] == pytest.approx(np.sqrt(np.mean(list(squares.values()))), rel=1e-6)
    # The motion is so slow that the error is gravity-free and nearly that of a quasi-static one: v_d is followed by
    # the spring's stretch. What is stated of the end follows from the sinusoids alone.
    last = slice(590_000, 600_000)
    M = law.mechanism.mass_matrix(points.p[last])
    stretch = np.linalg.solve(np.diag([90.0, 60.0]), np.einsum("kij,kj->ki", M, points.a[last]).T).T
    assert checked["rms_error_last_10_s"] == pytest.approx(np.sqrt(np.mean(stretch**2)), rel=0.05)


TURRET = """
schema = "adaptctl/mechanism/1"
name = "turret"

[[links]]
name = "table"
joint = "turn"
mass = 1
first_moment = [0, 0, 0]
inertia = { xx = 1, yy = 1, zz = 0.1 }

[[links]]
name = "sledge"
joint = "out"
type = "prismatic"
parent = "table"
axis = [1, 0, 0]
range = [0, 1]
mass = 1
first_moment = [0, 0, 0]
inertia = { xx = 0, yy = 0, zz = 0 }
"""


def test_a_bandwidth_is_bounded_where_the_arm_carries_least_of_it(tmp_path: Path) -> None:
    """A turning table with inertia 0.1 + r^2, r how far the sledge is out. Of damping alone the sledge carries least,
    T K/m = 1, wherever it is; of the table's bandwidth the arm carries least with the sledge in, T (K/0.1 + Lambda) =
    1.5."""
    (tmp_path / "turret.toml").write_text(TURRET)
    turret, damping = load(tmp_path / "turret.toml"), [90.0, 1000.0]
    law = SlotineLi(ReducedModel.full(turret), [10.0, 0.01], damping, control_period=1e-3)
    fields = [field for field in Interface(law).gains if field.name == "bandwidth"]
    (rule,) = gain_rules(law, tuple(fields))
    assert rule.most is not None
    allowed = 1.5 / 1e-3 - 90.0 / 0.1
    assert 0.75 * allowed < rule.most[0] <= allowed


@pytest.mark.parametrize(("arm", "law"), [("two", "gradient"), ("two", "guarded"), ("three", "tool")])
def test_gains_that_the_code_accepts_are_gains_that_the_law_accepts(arm: str, law: str) -> None:
    controller = arms()[arm][law]
    found = gain_rules(controller, Interface(controller).gains)
    limited = [rule for rule in found if rule.most is not None]
    assert limited
    for rule in limited:
        names = list(controller.numbers)
        name = names[short_names(names).index(rule.field.name)]
        controller.tuned({name: rule.most})
        with pytest.raises(GainError):
            controller.tuned({name: 1.3 * np.asarray(rule.most)})


def lawful(values: list[float], allowed: Callable[[Any], bool], error: type[Exception] = GainError) -> Any:
    """A controller of one gain, which it takes where that is allowed."""

    def tuned(numbers: dict[str, Any]) -> None:
        if not allowed(numbers["inner.gain"]):
            raise error

    return SimpleNamespace(numbers={"inner.gain": np.array(values)}, tuned=tuned)


@pytest.mark.parametrize(
    ("values", "allowed", "positive", "signed"),
    [
        ([0.5, 0.25], lambda x: min(x) > 0.0, True, False),
        ([0.5, 0.25], lambda x: min(x) >= 0.0, False, False),
        ([0.5, 0.25], lambda x: True, False, True),
        ([0.5, 0.0], lambda x: x[0] > 0.0 and x[1] >= 0.0, False, False),
        ([-0.5, 0.25], lambda x: x[0] < 0.0 < x[1], False, True),
    ],
)
def test_signs_of_gains_are_those_that_the_law_takes(
    values: list[float], allowed: Callable[[Any], bool], positive: bool, signed: bool
) -> None:
    for error in (GainError, InputError, ValueError, ZeroDivisionError):
        law = lawful(values, allowed, error)
        (rule,) = gain_rules(law, (Field("gain", law.numbers["inner.gain"]),))
        assert (rule.positive, rule.signed, rule.infinite, rule.bounds) == (positive, signed, False, False)


@pytest.mark.parametrize(("limit", "found"), [(1.1, 0), (7.0, 13), (9.0e3, 63), (1.0001e4, None)])
def test_a_gain_is_bounded_by_the_largest_of_64_even_steps_to_ten_thousand(limit: float, found: int | None) -> None:
    values = np.array([2.0, 3.0])
    most = _most(lawful([2.0, 3.0], lambda x: max(x / values) <= limit), "inner.gain", values)
    assert (most is None) == (found is None)
    if most is not None:
        assert most == pytest.approx(10.0 ** (4 * (found or 0) / 64) * values)
    other = lawful([2.0, 3.0], lambda x: max(x / values) <= limit, InputError)
    assert _most(other, "inner.gain", values) is None  # what refuses it is no bound of the period
    assert _most(other, "inner.gain", np.array([np.inf, 1.0])) is None


@pytest.mark.parametrize(("limit", "factor"), [(8.0, 0.9), (7.1, 0.81), (0.5, 0.0), (2e4, 1.0)])
def test_a_bound_of_the_worst_position_shrinks_by_tenths_where_another_refuses_it(
    limit: float, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.ones(1)
    monkeypatch.setattr("adaptctl.codegen.gain_rules._at_its_worst", lambda law: lawful([1.0], lambda x: x[0] < 8.7))
    most = _most(lawful([1.0], lambda x: x[0] <= limit), "inner.gain", values)
    assert most is not None
    assert most == pytest.approx([max(factor * 10.0 ** (4 * 15 / 64), 1.0)])


def test_each_flag_of_a_state_is_a_bit_of_its_own_beside_those_of_faults() -> None:
    law = arms()["two"]["guarded"]
    interface = Interface(law)
    bits = {bit.name.lower(): bit.value for bit in status_bits(interface)}
    assert sorted(bits.values()) == [1 << k for k in range(3 + len(interface.flags))]
    state = law.init([0.1, 0.2], [0.0, 0.0])
    assert status_of(interface, state) == 0
    for name in interface.flags:
        marked = state._replace(flags=state.flags._replace(**{name: np.ones(1)}))
        assert status_of(interface, marked) == bits[name] >= 8
    every = state._replace(flags=type(state.flags)(*(np.ones(1) for _ in state.flags)))
    assert status_of(interface, every) == sum(bits[name] for name in interface.flags)
    plain = arms()["two"]["gradient"]
    assert status_of(Interface(plain), plain.init([0.1, 0.2], [0.0, 0.0])) == 0


class Held(NamedTuple):
    """What was measured last while the arm was slow."""

    held: Any


@dataclass(frozen=True, eq=False)
class SlowlySeen(Controller[Held]):
    """A spring to where each joint was when it last was slow: the memory that is put back is used in the torque too."""

    mechanism: Mechanism

    @property
    def dof(self) -> int:
        return self.mechanism.dof

    def initial_state(self, p: Any, v: Any) -> Held:
        return Held(p)

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Held) -> tuple[Column, Held]:
        fast = absolute(v[0]) > 0.5
        held = Column(where(fast, before, now) for before, now in zip(memory.held, p, strict=True))
        return -3.0 * (held - reference.p), Held(held)


def test_memory_that_is_put_back_may_be_used_in_the_torque_too(tmp_path: Path) -> None:
    law = SlowlySeen(load(EXAMPLE))
    fast = Sinusoids([0.2, 0.4], [0.5, 0.5], [0.9, 0.9])
    made = adaptctl.export(law, tmp_path / "arm", name="arm", without_safety_filter=True, reference=fast)
    assert re.fullmatch(r"passed: .*\n", said(build(made.directory, "arm.c", "test_arm.c")))


def test_functions_are_written_before_those_that_call_them() -> None:
    """Also those that are called by none but a called one."""
    inner = outlined(lambda a: a * a)
    middle = outlined(lambda a: inner(a) + inner(2.0 * a))
    found = _callees(trace(lambda x: Column((middle(x[0]), 3.0 * x[1])), {"x": 2}))
    assert len(found) == 2
    assert all(set(one.subroutines) <= set(found[:k]) for k, one in enumerate(found))


def test_a_place_in_an_array_is_the_sum_of_its_counters_without_those_that_cancel() -> None:
    i, j = (Index(((counter, 1),)) for counter in range(2))
    for place, at in ((2 * i - 3 * j + 4, "2 * i0 + 4 - 3 * i1"), (i - j - 1, "i0 - i1 - 1"), (j + i - j, "i0")):
        assert _position(place) == at
    assert [_position(place) for place in (7, 3 + i - i, i - i)] == ["7", "3", "0"]


def test_loops_may_be_further_open_at_a_start_in_single_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("adaptctl.codegen.c_package.start_of", lambda interface, gap: gap)
    plain: Any = SimpleNamespace(names_of_constants=list, memory=())
    double, single = (CPackage(plain, "arm", kind).start for kind in ("double", "float"))
    assert (double, single) == (MAX_LOST_GAP, MAX_CLOSURE_GAP)
