"""Energy that arms give while they learn: random contacts, references that jump, and stiffness that varies."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import nightly
from test_impedance import DAMPING, HOME, PERIOD, REST, TOOL, Tussle, held_motion, joints, model, tool

import adaptctl
from adaptctl.arrays import Array
from adaptctl.control import (
    Gradient,
    GuardedLearning,
    JointImpedance,
    TaskImpedance,
    save_learned,
    warm_start,
    with_external_torque,
)
from adaptctl.control.adaptation.doubt import MODEL, PAYLOAD, UNKNOWN, Watch
from adaptctl.control.energy_tank import CALM, TRUST, EnergyTank, full, trusting
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column

TANK = 2.0


@lru_cache
def wrong() -> Array:
    """Estimate whose moments and inertias are off by a third."""
    error = np.array([-0.3, 0.1, 0.2, 0.3, -0.1, 0.3])
    return np.asarray(model().fundamental_parameters + 0.3 * error)


def learning(make: Any, law: Any, tank: float | None = TANK) -> Any:
    return replace(make(tank=tank), adaptation=law, initial=wrong())


def released(reduced: ReducedModel, error: Array, p: Array) -> Array:
    """Most energy (N,) in J that the weights of errors (N, k) give from positions (N, 2)."""
    turns = np.linspace(-np.pi, np.pi, 25)
    everywhere = np.array(np.meshgrid(turns, turns)).reshape(2, -1).T
    columns, equations = list(reduced.columns), reduced.mechanism.equations

    def heights(p: Array) -> Array:
        rows = equations.potential_regressor(column(p))
        return np.array([np.broadcast_to(np.asarray(x, float), len(p)) for x in rows]).T[:, columns]

    there, here = (heights(everywhere) @ error.T).max(axis=0), (heights(p) * error).sum(axis=1)
    return np.asarray(there - here)


@pytest.mark.parametrize(
    ("make", "law"), [(joints, GuardedLearning(np.full(6, 20.0), 400.0)), (tool, Gradient(np.full(6, 2.0)))]
)
def test_what_is_learned_in_contact_comes_out_of_the_tank(make: Any, law: Any) -> None:
    """In contact from the start: at most the tank, and what the weight of the first error gives."""
    tussle = Tussle(learning(make, law), 40, 0)
    error = np.tile(wrong() - model().fundamental_parameters, (40, 1))
    most = released(model(), error, tussle.p)
    tussle.run(800)
    assert np.isfinite(tussle.p).all()
    assert (tussle.least > -(TANK + most)).all()
    assert tussle.least.min() < -0.9 * TANK


def in_columns(tank: EnergyTank) -> EnergyTank:
    return EnergyTank(*map(column, tank))


class Watched:
    """A tank of one parameter, whose estimate is 1 and is not trusted yet."""

    def __init__(self, first: float) -> None:
        self.tank = in_columns(full(3.0, REST, REST, np.array([first])))

    def watch(self, seconds: float, decision: float = MODEL, age: float = 9.0, announced: float = 0.0) -> float:
        alarm = 0.0 if decision == MODEL else 1.0
        parts = (2.0,), (1.0,), (0.0,), (9.0,), (age,), (alarm,), (announced,), (decision,)
        watch = Watch(*(Column(part) for part in parts))
        for _ in range(round(seconds / 0.1)):
            self.tank = trusting(self.tank, Column((1.0,)), watch, 0.1)
        return float(self.tank.trusted[0])


def test_an_estimate_is_trusted_after_a_while_without_a_doubt() -> None:
    arm = Watched(0.5)
    assert arm.watch(9.0, age=1.0) == 0.5
    assert arm.watch(CALM - 0.2) == 0.5
    assert arm.watch(2.0, UNKNOWN) == 0.5
    assert arm.watch(CALM - 0.2) == 0.5
    assert arm.watch(TRUST) == pytest.approx(1.0 - 0.5 / np.e, abs=0.05)


def test_an_arm_that_knows_nothing_trusts_what_it_learns_first() -> None:
    arm = Watched(0.0)
    assert arm.watch(0.1, age=1.0) == 1.0
    assert arm.watch(0.1) == 1.0


def test_a_payload_is_trusted_at_once_if_it_was_announced() -> None:
    assert Watched(0.5).watch(0.1, PAYLOAD) == 0.5
    assert Watched(0.5).watch(0.1, PAYLOAD, announced=1.0) == 2.0


def test_of_a_law_without_doubts_only_the_first_estimate_is_trusted() -> None:
    for first, expected in ((0.5, 0.5), (0.0, 1.0)):
        tank = in_columns(full(3.0, REST, REST, np.array([first])))
        assert list(trusting(tank, Column((1.0,)), None, 0.1).trusted) == [expected]


def test_what_was_learned_earlier_is_trusted(tmp_path: Path) -> None:
    law: Any = learning(joints, GuardedLearning(np.full(6, 0.05), 400.0))
    first, path = law.init(HOME, REST), tmp_path / "learned.json"
    save_learned(path, law, first._replace(estimate=np.arange(6.0)))
    assert warm_start(path, law, first).controller_state.trusted.tolist() == list(range(6))


@lru_cache
def default(task: bool, tank: float | None) -> Any:
    """An impedance with the default learning law and the observer of external torques."""
    law = adaptctl.adaptive_controller(adaptctl.load("two_link"), control_period=PERIOD)
    given: Any = law.model, 10.0 if task else 40.0, DAMPING, law.adaptation, None, PERIOD
    more: dict[str, Any] = {"torque_limits": np.inf, "tank": tank}
    return with_external_torque(TaskImpedance(*given, **more, **TOOL) if task else JointImpedance(*given, **more))


class LearnedInAir(Tussle):
    """Arms that learned for 5 s in the air, from a share of the true parameters, before they come into contact."""

    def __init__(self, task: bool, start: float, arms: int, seed: int) -> None:
        law = default(task, 5.0)
        super().__init__(law, arms, seed)
        true = law.model.fundamental_parameters
        self.plant, self.law, off = held_motion(law.model.mechanism), default(task, None), 1.0 - start
        first = true * (start + off * self.rng.uniform(0.0, 2.0, (arms, len(true))))
        state = every(self.law.init(self.p, self.v), arms)
        watch = state.law_state.watch._replace(trusted=first.copy())
        state = state._replace(estimate=first, law_state=state.law_state._replace(watch=watch, prior=first.copy()))
        self.state, gains, self.gains = state, self.gains, np.tile(self.law.packed, (arms, 1))
        for k in range(5000):
            goal = self._goal(PERIOD * k)
            torque, self.state = self.law.step_tuned(self.gains, self.state, self.p, self.v, goal)
            self.p, self.v = self.plant(self.p, self.v, torque)
        tank = every(law.init(self.p, self.v).controller_state, arms)._replace(trusted=self.state.estimate.copy())
        self.state, self.law, self.gains = self.state._replace(controller_state=tank), law, gains
        M, self.began = law.model.mechanism.mass_matrix(self.p), 5.0
        self.moving = 0.5 * np.einsum("ni,nij,nj->n", self.v, M, self.v)
        self.most = self.moving + released(law.model, self.state.estimate - true, self.p)


def every(state: Any, arms: int) -> Any:
    """State of many arms that begin alike."""
    if hasattr(state, "_fields"):
        return type(state)(*(every(part, arms) for part in state))
    values = np.asarray(state, dtype=float)
    return np.tile(values, (arms, 1)) if values.ndim == 1 else values


@nightly
@pytest.mark.parametrize("start", [0.0, 0.7])
@pytest.mark.parametrize("task", [False, True])
def test_ten_thousand_contacts_of_arms_that_learn_give_no_more_than_was_stored(task: bool, start: float) -> None:
    """Tank, kinetic energy, and what the weight of the estimate's error gives."""
    tussle = LearnedInAir(task, start, 250, 2003)
    tussle.run(6000)
    assert tussle.contacts > 3000
    assert (tussle.least > -(5.0 + tussle.most)).all()
    assert np.median(tussle.most) < 1.0
