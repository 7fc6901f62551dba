"""Runs of a sweep that fail, or that cannot be computed together: each by itself, and no other with it."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.compilation.lanes import Precision
from adaptctl.control import ReferencePoint, Sinusoids, SlotineLi
from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import NO_MODEL, Contender
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import FundamentalBasis
from adaptctl.sweeps import rows
from adaptctl.sweeps.rows import RunOutcome, alone, batched


class Singular(Puma560Adaptive):
    """Of whose runs some meet a singular matrix, and some numbers that are too large."""

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        if self.payload == 1.0:
            np.linalg.inv(np.zeros((2, 2)))
        if self.payload == 2.0:
            raise OverflowError("too large\nby far")
        return super().contenders(mechanism, basis)


class Stepping(SlotineLi):
    """With a step of its own, which is not compiled, and may meet a number that is too large."""

    def step(self, state: Any, p: ArrayLike, v: ArrayLike, reference: ReferencePoint) -> tuple[Array, Any]:
        if self.bandwidth[0] > 5.0:
            raise OverflowError("too large")
        return super().step(state, p, v, reference)


class Stepped(Puma560Adaptive):
    """Of whose runs those with a payload have a controller with a step of its own."""

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        usual = super().contenders(mechanism, basis)
        if not self.payload:
            return usual
        law: Any = next(one.controller for one in usual if one.name == "adaptive")
        own = Stepping(**{entry.name: getattr(law, entry.name) for entry in fields(law) if entry.init})
        return [Contender.of("adaptive", "own", NO_MODEL, own)]


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize(("payload", "says"), [(1.0, "Singular matrix"), (2.0, "too large by far")])
def test_what_fails_before_it_begins_fails_for_itself(payload: float, says: str) -> None:
    runs = [Singular(duration=0.05, payload=kg) for kg in (0.0, payload)]
    together = batched(runs, ("adaptive",))
    assert [(name, outcome.status) for name, outcome in together[0]] == [("adaptive", "done")]
    assert together[1] == alone(runs[1], ("adaptive",)) == [("", RunOutcome.failed(says))]


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.NotCompiledWarning")
def test_what_the_simulation_of_many_refuses_is_computed_by_itself_in_double_and_fails_in_single() -> None:
    settings = ((0.0, 4.0), (1.0, 4.0), (1.0, 6.0))
    runs = [Stepped(duration=0.05, payload=kg, bandwidth=rate) for kg, rate in settings]
    double, single = (batched(runs, ("adaptive",), precision) for precision in get_args(Precision))
    assert double.keys() == {0}
    assert double[0][0][1].status == alone(runs[1], ("adaptive",))[0][1].status == "done"
    assert alone(runs[2], ("adaptive",)) == [("", RunOutcome.failed("too large"))]
    assert single[0][0][1].status == "done"
    assert single[1] == single[2]
    assert "Stepping has a custom step" in single[1][0][1].reason


SWINGING = Sinusoids(np.zeros(2), np.ones(2), np.ones(2))


@pytest.mark.parametrize(
    ("changes", "size", "together"),
    [
        ({}, 2, 1),
        ({"effects": ("delay",)}, 2, 0),
        ({"mechanism": SimpleNamespace(continuation="loops")}, 2, 0),
        ({"reference": "spline"}, 2, 0),
        ({}, 3, 0),
    ],
)
def test_plain_runs_alone_are_computed_together(
    changes: dict[str, Any], size: int, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = SimpleNamespace(**{"effects": (), "dof": 2, "mechanism": SimpleNamespace(continuation=None)} | changes)
    episode = SimpleNamespace(plant=plant, reference=changes.get("reference", SWINGING))
    law = SimpleNamespace(name="law", controller=SimpleNamespace(reference_size=size))
    monkeypatch.setattr(rows, "_mechanism", lambda experiment: None)
    monkeypatch.setattr(rows, "offline", lambda mechanism: None)
    monkeypatch.setattr(rows, "started", lambda *given: (episode, None))
    experiment: Any = SimpleNamespace(contenders=lambda mechanism, basis: [law])
    assert len(rows._trials(experiment, (), {})) == together


def test_a_task_and_its_environment_are_of_one_class_or_each_run_is_begun_anew() -> None:
    assert rows._home(Singular, "contenders") is Singular
    assert rows._home(Singular, "environment") is rows._home(Puma560Adaptive, "environment") is not Singular
    assert rows._home(Singular, "nothing") is None
