"""Experiments on laws that remember, on lifts and on elastic joints: what they find, and what they say of nothing."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import at_night

from adaptctl.description.inertia import pseudo_inertia
from adaptctl.errors import InputError
from adaptctl.experiments.laws import Laws
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.recording import Comparison
from adaptctl.simulation import Rollout, rollout, simulate

CONSISTENT = ("consistent-adaptation", "natural")
SMALL = "two_link"


def found(comparison: Comparison) -> dict[str, float]:
    return {finding.name: finding.value for finding in comparison.findings}


def quietly(what: str, share: float) -> None:
    """No progress."""


def test_laws_that_remember_know_more_once_motion_has_ended() -> None:
    laws = ("gradient", "composite-learning", "concurrent-learning", "consistent-adaptation")
    said = Laws(robot=SMALL, laws=laws, duration=8.0, reference_stop=3.0).compare(quietly)
    numbers = found(said)
    assert numbers["parameter_error.composite-learning"] < 0.1 * numbers["parameter_error.gradient"]
    assert numbers["parameter_error.concurrent-learning"] < 0.2 * numbers["parameter_error.gradient"]
    for law in ("composite-learning", "concurrent-learning"):
        assert 0.0 < numbers[f"remembered.{law}"] < 1.0
    assert numbers["smallest_eigenvalue.consistent-adaptation"] > 0.0
    assert np.abs(said.runs[0].rollout.reference_v[-3000:]).max() == 0.0
    assert "stored no samples" not in (said.answer or "")


def test_what_nothing_excites_enough_is_said_to_be_remembered_by_none() -> None:
    laws = ("composite-learning", "concurrent-learning")
    comparison = Laws(robot=SMALL, laws=laws, duration=1.0, excitation_threshold=1e9, novelty_threshold=1e9).compare(
        quietly
    )
    numbers = found(comparison)
    assert [numbers[f"remembered.{law}"] for law in laws] == [0.0, 0.0]
    assert (comparison.answer or "").count("stored no samples: the excitation never exceeded the threshold") == 2
    meanings = [finding.meaning for finding in comparison.findings if finding.name.startswith("remembered")]
    assert all(meaning.endswith("no samples were stored") for meaning in meanings)


def test_runs_keep_what_a_law_tells_of_its_memory(tmp_path: Path) -> None:
    """Behind guards too: a lift whose estimate is the run's; stepped, compiled, thinned out and from a file alike."""
    study = Laws(disturbance="noise", robot=SMALL, laws=("consistent-adaptation", "composite-learning"), duration=0.3)
    mechanism = study.mechanism()
    basis = fundamental_basis(essential_space(mechanism))
    for contender, told in zip(study.contenders(mechanism, basis), (len(mechanism.parameter_names), 1, 0), strict=True):
        with study.environment(mechanism) as env:
            whole, stepped = (drive(env, contender.controller, seed=0) for drive in (simulate, rollout))
            thinned = simulate(env, contender.controller, seed=0, record_every=7)
        assert whole.logged_state.shape == (150, told)
        np.testing.assert_allclose(stepped.logged_state, whole.logged_state, atol=1e-9)
        np.testing.assert_array_equal(thinned.logged_state, whole.logged_state[::7])
        whole.save(tmp_path / f"{contender.name}.parquet")
        np.testing.assert_array_equal(
            Rollout.load(tmp_path / f"{contender.name}.parquet").logged_state, whole.logged_state
        )
        if contender.name == "consistent-adaptation":
            model: Any = contender.controller.inner.model  # type: ignore[attr-defined]
            np.testing.assert_allclose(whole.logged_state @ model.regrouping.T, whole.estimate, atol=1e-9)
            assert np.abs(whole.logged_state[-1] - whole.logged_state[0]).max() > 0.0


@pytest.mark.parametrize(
    "study",
    [
        Laws(robot=SMALL, laws=CONSISTENT, duration=0.5),
        Laws(
            disturbance="payload",
            robot=SMALL,
            laws=CONSISTENT,
            duration=8.0,
            payload_cycles=2,
            payload_start=2.0,
            payload_stop=3.0,
        ),
        Laws(disturbance="noise", robot=SMALL, laws=CONSISTENT, duration=0.5),
    ],
    ids=lambda study: study.disturbance,
)
def test_every_comparison_tells_how_consistent_the_bodies_of_estimates_stayed(study: Laws) -> None:
    comparison = study.compare(quietly)
    numbers, runs = found(comparison), {run.name: run.rollout for run in comparison.runs}
    for law, parameters in (("consistent-adaptation", "logged_state"), ("natural", "estimate")):
        tens = getattr(runs[law], parameters)[:, :20].reshape(-1, 2, 10)
        least = min(float(np.linalg.eigvalsh(pseudo_inertia(ten))[0]) for ten in tens[::10].reshape(-1, 10))
        assert 0.0 < numbers[f"smallest_eigenvalue.{law}"] <= least
        assert numbers[f"smallest_eigenvalue.{law}"] > 0.5 * least


def test_a_payload_may_come_back() -> None:
    laws = ("composite-learning", "bounded-gain-forgetting")
    study = Laws(
        disturbance="payload",
        robot=SMALL,
        laws=laws,
        duration=40.0,
        payload_cycles=2,
        payload_start=5.0,
        payload_stop=12.0,
    )
    comparison = study.compare(quietly)
    numbers = found(comparison)
    for event in ("pickup", "last_pickup"):
        assert numbers[f"return_after_{event}.composite-learning"] < 6.0
    held = comparison.runs[0].rollout.flags["payload"]
    np.testing.assert_array_equal(np.flatnonzero(np.diff(held)), [4998, 11998, 24998, 31998])
    assert "After the last pickup, the errors are below twice" in (comparison.answer or "")
    with pytest.raises(InputError, match=r"within each of 4 parts of the 40 s of the run, got 5 and 12"):
        Laws(disturbance="payload", robot=SMALL, duration=40.0, payload_cycles=4, payload_start=5.0, payload_stop=12.0)


@pytest.mark.parametrize("stiffness", [at_night(((1e3, 1e5),)), (1e4,)])
def test_stiffer_joints_carry_more_bandwidth(stiffness: tuple[float, ...]) -> None:
    study = Laws(disturbance="springs", laws=("gradient",), joint_stiffness=stiffness, duration=0.2, trial_duration=0.6)
    comparison = study.compare(quietly)
    numbers = found(comparison)
    carried = [numbers[f"stable_bandwidth.gradient.{at}"] for at in (*(f"{k:.0f}" for k in stiffness), "rigid")]
    assert all(soft < 0.5 * stiff for soft, stiff in pairwise(carried))
    assert "Gradient is stable up to" in (comparison.answer or "")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"joint_stiffness": (-1e3,)}, "joint_stiffness: expected numbers from 0 to"),
        ({"encoder_side": "both"}, "encoders: expected 'link' or 'motor', got 'both'"),
        (
            {"robot": "puma560_measured"},
            "has no joint1.rotor_inertia: elastic joints need rotor inertias",
        ),
    ],
)
def test_elastic_joints_that_cannot_be_are_refused(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Laws(disturbance="springs", laws=("gradient",), duration=0.1, **settings).compare(quietly)
