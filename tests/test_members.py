"""What many arms are given in one call: their rows, memories, noise, laws and references."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from every_law import PAIR, on, slotine_li

from adaptctl.arrays import Array
from adaptctl.control import Sinusoids
from adaptctl.control.safety_filter import SafetyFilter
from adaptctl.dynamics import load
from adaptctl.errors import InputError, ReferenceWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant
from adaptctl.simulation.members import Noise, _first_of, checked_seeds
from adaptctl.simulation.simulate_many import _is_in_joints, _members, _of_arms, simulate_many

TWO = load("two_link")
LAW = on(PAIR, None)


def test_arms_are_counted_by_what_has_a_row_for_each() -> None:
    assert _members(None, {"p": (), "v": ()}) == 1
    assert _members(3, {"p": (3,), "v": ()}) == 3
    assert _members(None, {"p": (2,), "v": ()}) == 2
    for given, rows in ((3, {"p": (2,)}), (None, {"p": (2,), "v": (3,)}), (None, {"p": (2, 3)})):
        with pytest.raises(InputError, match="one row per arm in all arguments, got "):
            _members(given, rows)


class Memory(NamedTuple):
    """Of each arm, and of all."""

    each: Array
    shared: Array


def test_a_memory_is_that_of_the_controller_for_one_arm_or_each() -> None:
    loop, reference = {"plant": Plant(PAIR.mechanism, 1e-3), "duration": 1e-3}, Sinusoids(*np.full((3, 2), 0.1))
    for memory in (np.zeros(3), (np.zeros(3),)):
        with pytest.raises(InputError, match="memory: expected the result of SlotineLi"):
            simulate_many(controller=LAW, reference=reference, memory=memory, **loop)  # type: ignore[arg-type]
    each = Memory(np.arange(6.0).reshape(3, 2), np.array([7.0, 8.0]))
    rows, shared = _of_arms(each, slice(1, 3))
    assert (rows.tolist(), shared.tolist()) == ([[2.0, 3.0], [4.0, 5.0]], [7.0, 8.0])
    assert _of_arms(None, slice(1)) is None


def test_noise_is_of_batches_or_of_seeds_of_arms() -> None:
    batches = Noise.of(5, 5, 2, 3)
    assert [noise.members for noise in batches] == [2, 2, 1]
    assert [noise.drawn(4).shape for noise in batches] == [(4, 2, 3), (4, 2, 3), (4, 1, 3)]
    seeds = checked_seeds([4, 9, 2])
    own = Noise.of(seeds, 3, 2, 3)
    drawn = np.concatenate([noise.drawn(2) for noise in own], axis=1)
    for k, seed in enumerate((4, 9, 2)):
        np.testing.assert_array_equal(drawn[:, k], np.random.default_rng(seed).standard_normal((2, 3)))
    assert checked_seeds(3) == 3
    with pytest.raises(InputError, match="seed"):
        checked_seeds([3, -1])


def test_laws_of_many_arms_differ_in_numbers_alone() -> None:
    assert _first_of([LAW, LAW]) is LAW
    with pytest.raises(InputError, match="number 1 differs otherwise"):
        _first_of([LAW, slotine_li()])
    for wrong in ([], [LAW, 3], 5):
        with pytest.raises(InputError, match="expected a Controller or a sequence"):
            _first_of(wrong)


def test_what_is_filtered_has_a_reference_of_its_own_kind() -> None:
    inner = SimpleNamespace(reference_in_joints=False)
    filtered = SafetyFilter.__new__(SafetyFilter)
    object.__setattr__(filtered, "inner", inner)
    assert [_is_in_joints(one) for one in (filtered, inner, LAW)] == [False, False, True]  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [{"record_every": 0}, {"threads": 0}, {"threads": 1.0}, {"batch_size": 0}])
def test_periods_between_samples_threads_and_arms_are_whole_numbers(given: dict[str, Any]) -> None:
    reference = Sinusoids(*np.full((3, 2), 0.1))
    with pytest.raises(InputError, match=f"{next(iter(given))}: expected a whole number"):
        simulate_many(Plant(PAIR.mechanism, 1e-3), LAW, reference, duration=0.01, **given)


def test_runs_of_many_arms_tell_of_references_beyond_limits() -> None:
    law, far = on(ReducedModel.full(TWO), None), Sinusoids([3.1, 0.0], [0.1, 0.1], [0.1, 0.1])
    with pytest.warns(ReferenceWarning, match="reference: shoulder goes to 3.2 rad, beyond -2.967 to 2.967"):
        simulate_many(Plant(TWO, 1e-3), law, far, duration=5.0, record_every=None)
