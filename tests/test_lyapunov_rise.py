"""The largest rise of V is known without a sample, and is that of the samples."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nightly import at_night, turn_by_turn
from sampled_loops import arm, full, gains, reduced, swinging

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptationLaw,
    CompositeLearning,
    Gradient,
    Natural,
    PassivityIntegral,
    Projection,
    SlotineLi,
    Subspace,
)
from adaptctl.control.controller import Controller
from adaptctl.control.lyapunov import lyapunov
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import Plant, Rollouts, simulate_many
from adaptctl.simulation.effects import Effect, ElasticJoints, PayloadHeld

TREE, LOOP = "puma560_arm3", "semi_direct_drive"
MEMBERS = 5
SMALL = 0.05


def law_of(kind: str, model: ReducedModel) -> AdaptationLaw[Any] | None:
    """An adaptation law whose V is known. Of a whole gain, one so large that V rises while parameters change: else its
    only rises are those of kinetic energy."""
    k = len(model.names)
    mixed = np.linalg.qr(np.random.default_rng(k).normal(size=(k, k)))[0]
    return {
        "gradient": Gradient(np.full(k, SMALL)),
        "whole gain": Gradient(mixed @ np.diag(np.linspace(0.5, 1.0, k) * 60.0 * SMALL) @ mixed.T),
        "projection": Projection(Gradient(np.full(k, SMALL)), np.full(k, -50.0), np.full(k, 50.0)),
        "subspace": Subspace(np.full(3, SMALL), mixed[:, :3]),
        "natural": Natural(SMALL) if model.basis is None else None,
        "off": None,
    }[kind]


def runs(
    name: str, controller: Controller[Any] | Sequence[Controller[Any]], effects: list[Effect], every: int | None
) -> Rollouts:
    rng, mechanism = np.random.default_rng(2), arm(name)
    parameters = mechanism.inertial_parameters * rng.uniform(0.95, 1.05, (MEMBERS, 1))
    references = [swinging(mechanism, seed=k, amplitude=0.3) for k in range(MEMBERS)]
    substeps = 50 if any(isinstance(one, ElasticJoints) for one in effects) else 1
    plant = Plant(mechanism, 1e-3, effects=effects, substeps=substeps)
    return simulate_many(plant, controller, references, duration=0.2, parameters=parameters, record_every=every)


def recorded(controller: SlotineLi, found: Rollouts, name: str, m: int) -> Array:
    """V of run m, from its samples."""
    names = ("p", "v", "reference_p", "reference_v", "estimate")
    run: Any = SimpleNamespace(**{each: getattr(found, each)[:, m] for each in names})
    return lyapunov(controller, run, arm(name).with_parameters(found.parameters[m]))


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *turn_by_turn(("gradient", "projection"), (TREE, LOOP)),
        ("whole gain", TREE),
        *map(at_night, [("whole gain", LOOP), ("subspace", TREE), ("subspace", LOOP), ("off", TREE), ("off", LOOP)]),
        ("natural", LOOP),  # the other's links are no rigid bodies
    ],
)
def test_the_rise_is_that_of_the_samples(name: str, kind: str) -> None:
    model = full(name) if kind == "natural" else reduced(name)
    own = model.regrouping @ arm(name).inertial_parameters
    controller = SlotineLi(model, 8.0, gains(name).damping, law_of(kind, model), 1.3 * own)
    found, summed = runs(name, controller, [], 1), runs(name, controller, [], None)
    for m in range(MEMBERS):
        values = recorded(controller, found, name, m)
        assert found.lyapunov_rise[m] == pytest.approx(max(0.0, np.diff(values).max()), abs=1e-10 * values.max())
    np.testing.assert_array_equal(summed.lyapunov_rise, found.lyapunov_rise)
    if kind == "off":
        assert found.lyapunov_rise.min() > 0.0


def test_each_law_counts_by_its_own_gains() -> None:
    model = reduced(TREE)
    law = SlotineLi(
        model, 8.0, gains(TREE).damping, law_of("off", model), 1.3 * model.regrouping @ arm(TREE).inertial_parameters
    )
    laws = [law.having({"bandwidth": share * law.bandwidth}) for share in (0.25, 0.5, 1.0, 2.0, 4.0)]
    found = runs(TREE, laws, [], 1)
    for m, own in enumerate(laws):
        values = recorded(own, found, TREE, m)
        assert found.lyapunov_rise[m] == pytest.approx(np.diff(values).max(), abs=1e-10 * values.max())


@pytest.mark.parametrize(
    ("make", "effects"),
    [
        (lambda model, k: SlotineLi(model, 8.0, K, Gradient(k)), [PayloadHeld(1.0, 0.0, 0.1)]),
        (lambda model, k: SlotineLi(model, 8.0, K, CompositeLearning(k)), []),
        (lambda model, k: PassivityIntegral(model, 4.0, K, Gradient(k)), []),
        (lambda model, k: SlotineLi(reduced(LOOP), 8.0, K), []),
    ],
    ids=["a load that is taken up", "a law that remembers", "another sliding variable", "a model of another arm"],
)
def test_a_v_that_depends_on_more_is_not_told(make: Any, effects: list[Effect]) -> None:
    model = reduced(TREE)
    found = runs(TREE, make(model, np.full(len(model.names), SMALL)), effects, None)
    assert np.isnan(found.lyapunov_rise).all()


K = gains(TREE).damping
