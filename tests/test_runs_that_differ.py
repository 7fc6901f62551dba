"""Runs of many arms that each have their own gains, noise and reference, and what is summed up of them."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.control import BoundedGainForgetting, Sinusoids, SlotineLi
from adaptctl.errors import GainError, InputError, NotFoundError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant, Rollouts, simulate_many
from adaptctl.simulation.effects import Encoder

ARM = random_chain(3, 3)
MODEL = ReducedModel.full(ARM)
K = len(MODEL.columns)
TRUE = np.asarray(ARM.inertial_parameters)
LAW = SlotineLi(MODEL, 6.0, [3.0, 4.0, 2.0], BoundedGainForgetting(np.ones(K), cutoff=15.0), 0.9 * TRUE)  # type: ignore[arg-type]
PLANT = Plant(ARM, 1e-3)
NOISY = Plant(ARM, 1e-3, effects=(Encoder(noise=1e-4),))


def reference(k: int) -> Sinusoids:
    return Sinusoids(np.zeros(3), np.full(3, 0.2 + 0.05 * k), np.array([0.5, 0.7, 0.9]))


def alike(many: Rollouts, k: int, alone: Rollouts) -> None:
    for name in ("p", "torque", "estimate"):
        wanted = getattr(alone, name)[:, 0]
        got = getattr(many, name)[:, k]
        np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * max(1.0, np.abs(wanted).max()))


def test_each_arm_runs_as_it_would_alone() -> None:
    rng = np.random.default_rng(0)
    gains = {
        "damping": rng.uniform(2.0, 5.0, (4, 3)),
        "initial": TRUE * rng.uniform(0.8, 1.2, (4, 1)),
        "adaptation.cutoff": np.array([10.0, 15.0, 20.0, 25.0]),
    }
    seeds, p = [5, 6, 7, 8], rng.uniform(-0.1, 0.1, (4, 3))
    references = [reference(k) for k in range(4)]
    true = TRUE * rng.uniform(0.9, 1.1, (4, 1))
    many = simulate_many(
        NOISY, LAW, references, duration=0.2, gains=gains, seed=seeds, p=p, v=np.zeros(3), parameters=true
    )
    for k in (0, 3):
        law = LAW.tuned({name: values[k] for name, values in gains.items()})
        alone = simulate_many(
            NOISY, law, [references[k]], duration=0.2, seed=[seeds[k]], p=p[k], v=np.zeros(3), parameters=true[k]
        )
        alike(many, k, alone)


def test_batches_of_arms_run_as_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    p = np.random.default_rng(1).uniform(-0.1, 0.1, (11, 3))
    damping = np.linspace(2.0, 4.0, 11)[:, None] * np.ones(3)

    def run() -> Rollouts:
        references = [reference(k) for k in range(11)]
        given = {"gains": {"damping": damping}, "seed": list(range(11)), "p": p}
        return simulate_many(NOISY, LAW, references, duration=0.1, record_every=7, v=np.zeros(3), **given)  # type: ignore[arg-type]

    whole = run()
    monkeypatch.setattr(sys.modules["adaptctl.simulation.simulate_many"], "BATCH", 4)
    parts = run()
    for name in ("p", "torque", "estimate", "rms_error", "largest_error", "final_rms_error"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("periods", "known"), [(2000, True), (1999, False)])
def test_a_run_of_two_seconds_has_a_final_error_of_all_of_it(periods: int, known: bool) -> None:
    run = simulate_many(PLANT, LAW, [reference(0)], duration=1e-3 * periods, record_every=100)
    assert run.rms_error.min() > 0.0
    expected = run.rms_error if known else np.full_like(run.rms_error, np.nan)
    np.testing.assert_allclose(run.final_rms_error, expected, rtol=1e-12)


def test_summaries_are_those_of_all_samples() -> None:
    p = np.array([[0.1, -0.1, 0.1], [0.001, 0.0, 0.0], [0.3, 0.3, 0.3]])
    kept = simulate_many(PLANT, LAW, reference(0), duration=2.5, p=p, v=np.zeros(3), tolerance=0.02)
    bare = simulate_many(PLANT, LAW, reference(0), duration=2.5, p=p, v=np.zeros(3), tolerance=0.02, record_every=None)
    assert bare.p.shape == (0, 3, 3)
    assert bare.time.shape == (0,)
    error = np.abs(kept.error)
    last = [np.flatnonzero((error[:, k] > 0.02).any(axis=1)) for k in range(3)]
    for runs in (kept, bare):
        np.testing.assert_allclose(runs.rms_error, np.sqrt((error**2).mean(axis=0)), rtol=1e-9)
        np.testing.assert_allclose(runs.final_rms_error, np.sqrt((error[500:] ** 2).mean(axis=0)), rtol=1e-9)
        np.testing.assert_allclose(runs.largest_error, error.max(axis=0), rtol=1e-12)
        expected = [np.nan if len(x) and x[-1] == 2499 else 1e-3 * (x[-1] + 1) if len(x) else 0.0 for x in last]
        np.testing.assert_allclose(runs.settling_time, expected, atol=1e-12)
        assert np.isnan(runs.diverged_at).all()
        assert runs.diverged_joint.tolist() == [-1, -1, -1]


def test_a_run_that_diverges_tells_when_and_where_and_stops_counting() -> None:
    p, v = np.array([[0.01, 0.0, 0.0], [0.0, 0.02, 0.5]]), np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    kept = simulate_many(PLANT, LAW, reference(0), duration=0.3, p=p, v=v, divergence_bound=0.05)
    free = np.abs(simulate_many(PLANT, LAW, reference(0), duration=0.3, p=p, v=v).error)
    assert kept.diverged_at[1] == 0.0
    assert kept.diverged_joint[1] == 2
    beyond = np.argwhere(free[:, 0] > 0.05)
    step, joint = beyond[0]
    assert step > 0
    assert kept.diverged_at[0] == pytest.approx(1e-3 * step)
    assert kept.diverged_joint[0] == joint
    np.testing.assert_allclose(kept.rms_error[0], np.sqrt((free[:step, 0] ** 2).mean(axis=0)))


def test_what_is_not_finite_is_told() -> None:
    p = np.zeros((2, 3))
    wild = {"initial": np.stack([TRUE, 1e7 * TRUE])}
    runs = simulate_many(PLANT, LAW, reference(0), duration=0.3, p=p, v=np.zeros(3), gains=wild)
    assert runs.finite.tolist() == [True, False]
    assert np.isnan(runs.diverged_at[0])
    assert 0.0 < runs.diverged_at[1] < 0.3
    assert np.isfinite(runs.rms_error).tolist() == [[True] * 3, [False] * 3]


def test_gains_that_cannot_be_are_refused() -> None:
    def run(**gains: object) -> Rollouts:
        return simulate_many(PLANT, LAW, reference(0), duration=0.01, gains=gains)  # type: ignore[arg-type]

    with pytest.raises(NotFoundError, match="did you mean 'damping'"):
        run(dampin=3.0)
    with pytest.raises(InputError, match=r"damping: expected shape \(3,\), or \('M', 3\), got \(2, 2\)"):
        run(damping=np.ones((2, 2)))
    with pytest.raises(GainError, match="too stiff"):
        run(damping=np.stack([np.ones(3), np.full(3, 1e5)]))
    with pytest.raises(InputError, match="one row per arm"):
        run(damping=np.ones((2, 3)), bandwidth=np.ones((3, 3)))
