"""Counts that are none: members, steps, threads, lanes and lengths that are no whole numbers, or too few."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from adaptctl.compilation import LaneArray, Stepper, compile_step
from adaptctl.errors import InputError
from adaptctl.scalars import Column

COLUMNS = {"state": {"q": 2}, "per_member_inputs": {"push": 2}}
PUSH = {"push": 1.0}
NO_COUNTS: tuple[Any, ...] = (-1, 1.5, 2.0, np.float64(2.0), np.nan, np.inf, "2", None, True, np.True_, [2])


def pushed(q: Column, push: Column) -> tuple[Column, Column]:
    return q + push, q


@pytest.fixture(scope="module")
def stepper() -> Stepper:
    return compile_step(pushed, **COLUMNS, lanes=2)


@pytest.mark.parametrize("wrong", NO_COUNTS, ids=repr)
def test_what_is_no_count_is_refused(stepper: Stepper, wrong: Any) -> None:
    three = stepper.ensemble(3)
    refused = "expected a whole number of at least"
    with pytest.raises(InputError, match=f"^members: {refused} 1"):
        stepper.ensemble(wrong)
    for record in (False, True):
        with pytest.raises(InputError, match=f"^steps: {refused} 0"):
            three.run(wrong, PUSH, record=record)
    with pytest.raises(InputError, match=f"^threads: {refused} 1"):
        three.run(1, PUSH, threads=wrong)
    with pytest.raises(InputError, match=f"^steps: {refused} 0"):
        three.allocate_outputs(wrong)
    with pytest.raises(InputError, match=f"^record: first: {refused} 0"):
        three.record_into(three.allocate_outputs(5), wrong, 2, PUSH)
    with pytest.raises(InputError, match=f"^record: steps: {refused} 0"):
        three.record_into(three.allocate_outputs(5), 0, wrong, PUSH)
    np.testing.assert_array_equal(three.state["q"], 0.0)


@pytest.mark.parametrize("wrong", [0, -1, 2.0, True, np.nan, "2"], ids=repr)
def test_lanes_are_counted(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"^lanes: expected a whole number of at least 1"):
        compile_step(pushed, **COLUMNS, lanes=wrong)


def test_members_and_threads_are_at_least_one(stepper: Stepper) -> None:
    with pytest.raises(InputError, match="members: expected a whole number of at least 1, got 0"):
        stepper.ensemble(0)
    with pytest.raises(InputError, match="threads: expected a whole number of at least 1, got 0"):
        stepper.ensemble(3).run(1, PUSH, threads=0)
    np.testing.assert_array_equal(stepper.ensemble(1).run(2, PUSH, threads=1)[0], 1.0)


@pytest.mark.parametrize("count", [np.int64(2), np.uint8(2)])
def test_whole_numbers_of_numpy_are_counts(stepper: Stepper, count: Any) -> None:
    two = stepper.ensemble(count)
    (positions,) = two.run(count, PUSH, record=True, threads=count)
    np.testing.assert_array_equal(positions, np.broadcast_to([[[0.0]], [[1.0]]], (2, 2, 2)))
    room = two.allocate_outputs(count)
    two.record_into(room, np.int64(1), np.int64(1), PUSH)
    np.testing.assert_array_equal(room["0"][1], np.full((2, 2), 2.0))


def test_threads_beyond_the_members_change_nothing(stepper: Stepper) -> None:
    np.testing.assert_array_equal(stepper.ensemble(5).run(3, PUSH, threads=300)[0], np.full((5, 2), 2.0))


def test_memory_that_is_no_room_is_refused(stepper: Stepper) -> None:
    wrong: Any = 3
    with pytest.raises(InputError, match="record: room: expected an array made by this ensemble"):
        stepper.ensemble(3).record_into(wrong, 0, 1, PUSH)


BAD_SIZES: dict[str, tuple[dict[str, Any], str]] = {
    "members": ({"members": -1}, "^members: expected a whole number of at least 0, got -1"),
    "a fraction of members": ({"members": 1.5}, r"^members: expected a whole number of at least 0, got 1\.5"),
    "length": ({"columns": {"x": 1, "y": -2}}, "^length of 'y': expected a whole number of at least 0, got -2"),
    "a length's kind": ({"columns": {"x": "2"}}, "^length of 'x': expected a whole number of at least 0, got '2'"),
    "no lanes": ({"lanes": 0}, "^lanes: expected a whole number of at least 1, got 0"),
    "lanes": ({"lanes": -2}, "^lanes: expected a whole number of at least 1, got -2"),
    "steps": ({"steps": (3, -1)}, "^steps: expected a whole number of at least 0, got -1"),
}


@pytest.mark.parametrize("case", BAD_SIZES)
def test_wrong_sizes_of_an_array_are_refused(case: str) -> None:
    wrong, message = BAD_SIZES[case]
    with pytest.raises(InputError, match=message):
        LaneArray(**{"columns": {"x": 2}, "members": 3, **wrong})


def test_an_array_may_be_empty() -> None:
    assert LaneArray({}, 3).blocks.shape == (3, 0, 1)
    assert LaneArray({"x": 2}, 0)["x"].shape == (0, 2)
    assert LaneArray({"x": 0}, 3, 2, (0,))["x"].shape == (0, 3, 0)


@pytest.mark.parametrize("chosen", [[0], [0, 1], [0, 1, 2, 3]])
def test_members_are_not_put_into_an_array_with_steps(chosen: list[int]) -> None:
    """Axes of steps and of members could be taken for each other."""
    array = LaneArray({"x": 2}, 4, 2, (len(chosen),))
    with pytest.raises(InputError, match=r"put: expected an array without axes of steps, got steps \("):
        array.put("x", chosen, np.ones((len(chosen), 2)))
    np.testing.assert_array_equal(array["x"], 0.0)
