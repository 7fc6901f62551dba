"""Gains are arguments: what differs in them alone shares native code, and computes what it would alone."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from every_law import ARM, GAIN, LAWS, slotine_li
from nightly import mostly_at_night

from adaptctl.arrays import Array
from adaptctl.control import (
    ComputedTorque,
    Controller,
    PDGravity,
    ReferencePoint,
    SafetyFilter,
    Sinusoids,
    SlotineLi,
)
from adaptctl.control.adaptation.composite import decayed
from adaptctl.control.pytree import leaves
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, NotFoundError
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.scalars import Column
from adaptctl.simulation import Plant, simulate_many

WITH_GAINS = [name for name, law in LAWS.items() if law.numbers and law.reference_size == law.dof]
POINT = ReferencePoint(np.array([0.1, -0.5, 0.4]), np.array([0.2, -0.1, 0.3]), np.array([1.0, 0.5, -1.0]))


def changed(law: Controller[Any]) -> Controller[Any]:
    """The law with every number a little greater, each array by a share of its own."""
    rng = np.random.default_rng(0)
    shares = {name: 1.0 + 0.1 * rng.random() for name in law.numbers}
    for name in [name for name in shares if name.endswith("adaptation.lift")]:
        shares[name] = shares[name.replace("adaptation.lift", "initial")]  # a lift has the first estimate
    return law.tuned({name: shares[name] * array for name, array in law.numbers.items()})


def began(law: Controller[Any]) -> tuple[Array, Array, ReferencePoint]:
    """A position, a velocity and a reference for an arm of at most three joints."""
    r = law.dof
    p, v = np.array([0.2, -0.4, 0.3])[:r], np.array([0.1, 0.2, -0.3])[:r]
    return p, v, ReferencePoint(*(part[: law.reference_size] for part in POINT))


def ticks(law: Controller[Any], count: int = 4) -> list[Array]:
    """All that a law makes of some ticks, one after the other."""
    p, v, point = began(law)
    state, made = law.init(p, v), []
    for _ in range(count):
        torque, state = law.step(state, p, v, point)
        made += [torque, *leaves(state)]
        p, v = p + 1e-3 * v, 0.99 * v
    return made


def test_models_have_one_structure_if_they_have_one_mechanism_and_basis() -> None:
    basis = fundamental_basis(essential_space(ARM))
    one, other, full = ReducedModel(ARM, basis), ReducedModel(ARM, basis), ReducedModel.full(ARM)
    assert one.structure is one.structure
    assert one.structure == other.structure
    assert one.structure != full.structure
    laws = [SlotineLi(model, 8.0, 5.0) for model in (one, other, full)]
    assert laws[0].structure == laws[1].structure
    assert laws[0].structure != laws[2].structure


@pytest.mark.parametrize("name", mostly_at_night(WITH_GAINS, *list(WITH_GAINS)[::4]))
def test_laws_that_differ_in_gains_alone_share_native_code_and_do_not_mix_them_up(name: str) -> None:
    law, other = LAWS[name].tuned(LAWS[name].numbers), changed(LAWS[name])
    before = ticks(law)
    after = ticks(other)
    assert other.kernel is law.kernel is not None
    assert all(np.array_equal(x, y) for x, y in zip(ticks(law), before, strict=True))
    assert any(not np.array_equal(x, y) for x, y in zip(before, after, strict=True))


@pytest.mark.parametrize("name", WITH_GAINS)
def test_a_gain_that_is_an_argument_does_what_a_compiled_in_one_does(name: str) -> None:
    law = changed(LAWS[name])
    p, v, point = began(law)
    state = law.init(p, v)
    for _ in range(3):
        plain = law.python_step(p, v, *point, *leaves(state))
        torque, state = law.step(state, p, v, point)
        for native, expected in zip((torque, *leaves(state)), plain, strict=True):
            np.testing.assert_allclose(native, expected, rtol=0, atol=1e-11 * max(1.0, np.abs(expected).max(initial=0)))
        p, v = p + 1e-3 * v, 0.99 * v


def test_gains_are_checked_as_those_of_a_new_law() -> None:
    law = LAWS["gradient"]
    with pytest.raises(GainError, match="too stiff"):
        law.tuned({"damping": [1e6, 1e6, 1e6]})
    with pytest.raises(InputError, match="positive"):
        law.tuned({"adaptation.gain": -GAIN})
    with pytest.raises(NotFoundError, match=r"did you mean 'damping'.*bandwidth.*adaptation\.gain"):
        law.tuned({"dampin": 3.0})


@pytest.mark.parametrize("name", ["dampin", "adaptation.gian", "adaptaton.gain", "damping.gain"])
def test_numbers_that_a_law_has_not_are_not_put_into_a_copy(name: str) -> None:
    law = LAWS["gradient"]
    with pytest.raises(NotFoundError, match=rf"SlotineLi has no number '{name}' to tune \(did you mean '.*'\?\)"):
        law.having({name: 3.0})
    assert law.having({"damping": 3.0}).damping == 3.0


@pytest.mark.parametrize("count", [-1, 1])
def test_packed_numbers_are_as_many_as_a_law_has(count: int) -> None:
    law = LAWS["gradient"]
    packed = Column(np.resize(law.packed, law.packed.size + count).tolist())
    for method in (law.substituted, law.unpacked):
        with pytest.raises(InputError, match=rf"packed: expected {law.packed.size} numbers, got {len(packed)}"):
            method(packed)


def test_what_is_not_a_gain_is_compiled_in() -> None:
    longer = slotine_li(GAIN, control_period=2e-3)
    assert longer.structure != LAWS["gradient"].structure
    assert LAWS["euler"].structure != LAWS["gradient"].structure == slotine_li(2.0 * GAIN).structure
    assert SafetyFilter(LAWS["gradient"], 50.0).structure != SafetyFilter(LAWS["gradient"], 50.0, 1e4).structure  # type: ignore[arg-type]


class Squared(SlotineLi):
    """A law of a user's, which reads its gains as numbers."""

    def reference_velocity(self, *given: Any) -> Any:
        assert isinstance(self.bandwidth, np.ndarray)
        return super().reference_velocity(*given)


@dataclass(frozen=True)
class Spring(Controller[Any]):
    """A law of a user's, from nothing of ours."""

    mechanism: Mechanism
    stiffness: float

    @property
    def dof(self) -> int:
        return 3

    def initial_state(self, p: Array, v: Array) -> Any:
        return ()

    def law(self, p: Column, v: Column, reference: ReferencePoint, memory: Any) -> Any:
        stiff = 2.0 if self.stiffness > 1.0 else 1.0
        return (-stiff * self.stiffness) * (p - reference.p), memory


def test_a_law_that_names_no_gains_has_them_compiled_in() -> None:
    ours = slotine_li(GAIN)
    derived = [slotine_li(GAIN, Squared), slotine_li(2.0 * GAIN, Squared)]
    assert [law.tunable for law in derived] == [(), ()]
    assert set(derived[0].numbers) == {"adaptation.gain"}
    np.testing.assert_allclose(ticks(derived[0])[0], ticks(ours)[0], rtol=1e-12)
    soft, hard = Spring(ARM, 1.0), Spring(ARM, 10.0)
    assert soft.structure != hard.structure == Spring(ARM, 10.0).structure
    p = np.ones(3)
    for law, factor in ((soft, 1.0), (hard, 20.0)):
        torque, _ = law.step(law.init(p, p), p, p, POINT)
        np.testing.assert_allclose(torque, -factor * (p - POINT.p))


def test_a_used_controller_can_be_pickled_and_goes_on() -> None:
    law = slotine_li(GAIN)
    expected = ticks(law)
    again = pickle.loads(pickle.dumps(law))
    for x, y in zip(ticks(again), expected, strict=True):
        np.testing.assert_array_equal(x, y)


def test_runs_of_other_gains_need_no_new_code() -> None:
    plant = Plant(ARM, 1e-3)
    reference = Sinusoids(np.zeros(3), np.full(3, 0.3), np.full(3, 0.5))
    first = simulate_many(plant, slotine_li(GAIN), reference, duration=0.05, batch_size=2)
    stiff = slotine_li(GAIN).tuned({"damping": [6.0, 8.0, 4.0]})
    second = simulate_many(plant, stiff, reference, duration=0.05, batch_size=2)
    kept = simulate_many(plant, slotine_li(GAIN, Squared).tuned({}), reference, duration=0.05, batch_size=2)
    np.testing.assert_allclose(kept.torque, first.torque, rtol=0, atol=1e-9)
    assert np.abs(second.torque - first.torque).max() > 1e-2


@pytest.mark.parametrize("x", [1e-6, 1e-3, 0.02, 0.3, 1.0])
def test_a_decay_is_the_exponential(x: float) -> None:
    left, mean = decayed(x)
    assert left == pytest.approx(np.exp(-x), rel=1e-15, abs=0)
    assert mean == pytest.approx(-np.expm1(-x) / x, rel=1e-15, abs=0)


@pytest.mark.parametrize("kind", [ComputedTorque, PDGravity])
def test_laws_of_other_parameters_share_code_but_for_their_zeros(kind: Any) -> None:
    own, rng = ARM.inertial_parameters, np.random.default_rng(1)
    gains = (6.0,) if kind is ComputedTorque else (40.0, 5.0)
    true, rough = (kind(ARM, *gains, parameters=x) for x in (own, own * rng.uniform(0.8, 1.2, own.shape)))
    assert true.structure == rough.structure
    assert true._tick is rough._tick
    for law in (true, rough):
        alone = kind(ARM, *gains, parameters=law.parameters).fixed()
        assert "parameters" not in alone.numbers
        for x, y in zip(ticks(law), ticks(alone), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-12)
    holes = np.where(np.arange(own.size) % 3 == 0, 0.0, own)
    fewer = kind(ARM, *gains, parameters=holes)
    assert fewer.structure != true.structure
    assert fewer.kernel is not None
    assert true.kernel is not None
    assert fewer.kernel.operations.flops < true.kernel.operations.flops


def test_a_guarded_laws_parameters_are_compiled_in_where_they_are_fixed() -> None:
    law = SafetyFilter(ComputedTorque(ARM, 6.0), 50.0, stop_damping=5.0)  # type: ignore[arg-type]
    assert law.fixed().structure != law.structure
    assert set(law.numbers) - set(law.fixed().numbers) == {"inner.parameters"}
