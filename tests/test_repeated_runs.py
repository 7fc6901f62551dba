"""Runs that judged gains are not computed again by the experiment that runs the same, and nothing else is taken."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from comparisons import no_progress

from adaptctl.compilation import Ensemble, compile_step
from adaptctl.experiments.adaptive import AdaptiveTracking, _tuned
from adaptctl.experiments.contest import Learning
from adaptctl.recording import ControllerRun
from adaptctl.simulation.repeated_runs import is_kept, kept_runs, recorded, repeated

STEP = compile_step(lambda x, k, u: (x + k * u, x), state={"x": 1}, constants={"k": 1}, inputs={"u": 1}, lanes=1)
OTHER = compile_step(lambda x, k, u: (x - k * u, x), state={"x": 1}, constants={"k": 1}, inputs={"u": 1}, lanes=1)


def arms(step: Any = STEP, x: float = 1.0, k: float = 2.0) -> Ensemble:
    made = Ensemble(step, 1)
    made.state["x"], made.held["k"] = [[x]], [[k]]
    return made


def signals(of: Ensemble, u: float = 3.0) -> Any:
    made = of.signals(3)
    made.shared["u"] = np.full((3, 1, 1), u)
    return made


def run(of: Ensemble) -> None:
    recorded(of, of.allocate_outputs(4), 3, signals(of))


def test_a_run_is_repeated_once_with_the_outputs_that_were_recorded() -> None:
    with kept_runs():
        run(arms())
        assert [is_kept(arms(), steps) for steps in (2, 3, 4)] == [False, True, False]
        found = repeated(arms(), 3, signals(arms()))
        assert found is not None
        assert found.seconds > 0.0
        np.testing.assert_array_equal(found.outputs["0"][:3, 0, 0], [1.0, 7.0, 13.0])
        np.testing.assert_array_equal(found.last.ravel(), [19.0])
        assert repeated(arms(), 3, signals(arms())) is None


@pytest.mark.parametrize(
    ("changed", "u"),
    [({"step": OTHER}, 3.0), ({"x": 0.5}, 3.0), ({"k": 1.0}, 3.0), ({}, 2.0)],
    ids=("law", "start", "constant", "reference"),
)
def test_a_run_with_another_law_start_constant_or_reference_is_computed(changed: dict[str, Any], u: float) -> None:
    with kept_runs():
        run(arms())
        assert repeated(arms(**changed), 3, signals(arms(), u)) is None


def test_nothing_is_kept_without_being_asked_for_and_only_the_last_two_runs() -> None:
    run(arms())
    with kept_runs():
        assert not is_kept(arms(), 3)
        for x in (1.0, 2.0, 3.0):
            run(arms(x=x))
        kept = [repeated(of, 3, signals(of)) is not None for of in (arms(), arms(x=2.0), arms(x=3.0))]
    assert kept == [False, True, True]


def _differing(one: ControllerRun, other: ControllerRun) -> list[str]:
    names = ("time", "p", "v", "torque", "applied", "clipped", "energy", "reward", "estimate", "reference_p")
    return [name for name in names if not np.array_equal(getattr(one.rollout, name), getattr(other.rollout, name))]


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_an_experiment_with_the_runs_of_its_tuning_tells_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: Counter[str] = Counter()
    record = Ensemble.record_into

    def counted(self: Ensemble, room: Any, first: int, steps: int, given: Any) -> None:
        taken[self.stepper.name] += steps
        record(self, room, first, steps, given)

    monkeypatch.setattr(Ensemble, "record_into", counted)
    asked = AdaptiveTracking(robot="puma560_arm3", control_period=0.004)
    found, less = asked.compare(no_progress), taken.copy()
    taken.clear()
    _tuned.cache_clear()
    anew = Learning.compare(asked, no_progress)
    assert {run.name: _differing(run, other) for run, other in zip(found.runs, anew.runs, strict=True)} == {
        run.name: [] for run in anew.runs
    }
    periods = len(anew.runs[0].rollout.time)
    assert less["LeakyIntegral"] < 1.5 * periods < 1.9 * periods < taken["LeakyIntegral"]
    assert found.runs[0].rollout.wall_time > 0.0
