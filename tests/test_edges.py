"""Edges of what is accepted, defaults and rare branches, in which a program could change unnoticed."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from every_law import ARM, GAIN, MODEL, TRUE, K, slotine_li
from test_loops_in_closed_form import four_bar

from adaptctl.control import BoundedGainForgetting, GainDesign, MinimumJerk, ReleasedGradient, SafetyFilter
from adaptctl.control.adaptation.gradient import _is_positive_definite
from adaptctl.control.gains.error_feedback import ErrorFeedback, _lag
from adaptctl.control.gains.sampling_ratio import slowest_decay
from adaptctl.errors import GainError, InputError, SingularityError
from adaptctl.identifiability import FundamentalBasis, Relation, essential_space, fundamental_basis
from adaptctl.identifiability.certificate import MAX_LISTED_VALUES, _listing
from adaptctl.simulation.references import warn_of_derivatives


def test_one_point_of_a_stretch_is_that_of_many() -> None:
    """From other places than zero, in another time than one second."""
    reference = MinimumJerk([[0.3, -1.0], [-0.5, 2.0], [0.1, 0.7]], [0.2, 2.2, 2.9])
    times = np.array([0.0, 0.2, 0.9, 2.1, 2.4, 2.9, 3.5])
    for time, *point in zip(times, *reference(times), strict=True):
        for one, many in zip(reference.at(float(time)), point, strict=True):
            np.testing.assert_allclose(one, many, rtol=0, atol=1e-12)


def test_the_worst_of_many_configurations_is_named() -> None:
    bars = four_bar(0.2, 0.55, 0.45, 0.6)
    assert bars.continuation is not None
    fine = bars.configuration([[1.4], [1.6]])
    crossed = np.array([1.51, -2.610195, -2.432009])
    bars.continuation.validate_regular(fine)
    with pytest.raises(SingularityError, match=r"near a singularity at p = \[1\.51\]"):
        bars.continuation.validate_regular(np.stack([fine[0], crossed, fine[1], fine[0]])[None])


@pytest.mark.parametrize(("stiffness", "rate"), [(0.0, 10.0), (10.0, 0.0)])
def test_no_feedback_is_refused(stiffness: float, rate: float) -> None:
    with pytest.raises(InputError, match="gains: expected positive numbers"):
        ErrorFeedback(stiffness, rate, 1e-3)


def test_scales_of_zero_are_refused(tmp_path: Path) -> None:
    basis = fundamental_basis(essential_space(ARM))
    none = np.array(basis.scales)
    none[3] = 0.0
    with pytest.raises(InputError, match="scales: expected positive numbers"):
        replace(basis, scales=none)
    basis.save(tmp_path / "basis.json")
    content = json.loads((tmp_path / "basis.json").read_text())
    content["scales"][3] = 0.0
    (tmp_path / "basis.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"`\$\.scales`: expected {len(none)} positive numbers, one per parameter"):
        FundamentalBasis.load(tmp_path / "basis.json")


def test_a_relation_keeps_what_it_was_given() -> None:
    weights = {"link1.m": 1.0}
    relation = Relation(weights)
    weights.clear()
    assert dict(relation.weights) == {"link1.m": 1.0}
    with pytest.raises(TypeError):
        relation.weights["link2.m"] = 1.0  # type: ignore[index]


def test_forgetting_needs_a_gain_for_every_parameter_and_forgets_by_default() -> None:
    assert BoundedGainForgetting(GAIN).forgetting == 1.0
    with pytest.raises(InputError, match=f"gain: expected {K} numbers"):
        slotine_li(BoundedGainForgetting(GAIN[:-1]))


def test_lag_of_a_loop_at_minus_one_is_a_whole_turn() -> None:
    assert _lag(complex(-1.0, -0.0)) == 2.0 * math.pi
    assert _lag(complex(0.0, -1.0)) == pytest.approx(math.pi / 2.0)


def test_effort_weighs_one_unless_told() -> None:
    asked, told = (GainDesign.from_lqr(ARM, 1e4, 2.0, *effort).feedback for effort in ((), (1.0,)))
    assert asked == told


@pytest.mark.parametrize(
    ("count", "rank"),
    [(MAX_LISTED_VALUES, 5), (MAX_LISTED_VALUES + 1, 5), (3 * MAX_LISTED_VALUES, 2 * MAX_LISTED_VALUES)],
)
def test_very_many_values_are_listed_about_the_gap(count: int, rank: int) -> None:
    assert _listing(np.ones(count), rank).startswith("(") == (count > MAX_LISTED_VALUES)
    words = (
        _listing(np.ones(count), rank)
        .removeprefix(f"(from the {max(0, rank - MAX_LISTED_VALUES // 2) + 1}th) ")
        .split()
    )
    assert words == ["1.0e+00"] * MAX_LISTED_VALUES


def test_an_estimate_may_begin_on_its_bounds() -> None:
    first = 0.9 * TRUE
    for bounds in ((first, first + 1.0), (first - 1.0, first)):
        SafetyFilter(slotine_li(GAIN), estimate_bounds=bounds)


def test_small_gains_are_as_symmetric_as_large_ones() -> None:
    skewed = np.array([[1.0, 1e-7], [0.0, 1.0]])
    assert [_is_positive_definite(size * skewed) for size in (1.0, 1e-6)] == [False, False]
    assert [_is_positive_definite(size * np.eye(2)) for size in (1.0, 1e-6)] == [True, True]


def test_a_theorem_is_not_given_where_the_hold_is_too_long() -> None:
    with pytest.raises(GainError, match=r"the sampling ratio is .*, but the theorem needs a ratio below 2"):
        ReleasedGradient.certified(MODEL, GAIN, 5000.0, 0.1)
    law = ReleasedGradient.certified(MODEL, GAIN, 0.1, 1e-4)
    assert law.share < 1.1
    assert law.share * law.release == pytest.approx(slowest_decay(MODEL.mechanism, 0.1))


def test_a_feedback_just_beyond_what_its_hold_carries_is_refused() -> None:
    """The sampled double integrator is stable while stiffness is below 2 rate / T and rate below 2 / T."""
    ErrorFeedback(1.0, 1999.0, 1e-3)
    with pytest.raises(GainError, match=r"are unstable at a control period of 0\.001 s"):
        ErrorFeedback(1.0, 2001.0, 1e-3)


def test_what_is_no_reference_is_not_looked_at_for_derivatives() -> None:
    with pytest.raises(InputError, match="ReferencePoint"):
        warn_of_derivatives(lambda t: (0.0, 0.0, 0.0), ("a",), 1.0)  # type: ignore[arg-type, return-value]


def test_the_gain_of_least_squares_is_a_copy() -> None:
    gain = np.ones(3)
    law = BoundedGainForgetting(gain)
    gain[0] = 7.0
    assert law.gain[0] == 1.0
    assert not law.gain.flags.writeable
