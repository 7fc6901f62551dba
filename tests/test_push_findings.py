"""What is found of a hand's push, from flags that are written by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.experiments import contact
from adaptctl.experiments.contact import Contact
from adaptctl.experiments.push_findings import _felt, _relative, answer_of_push, findings_of_push
from adaptctl.simulation import HandPush


@pytest.mark.parametrize(
    ("doubted", "felt"), [([0.0, 0.75], None), ([0.25], 0.0), ([0.5, 0.625], 0.25), ([0.1, 0.625], 0.375), ([], None)]
)
def test_a_push_is_felt_from_its_begin_until_before_its_end(doubted: list[float], felt: float | None) -> None:
    time = np.arange(9) / 8.0
    decision = np.isin(time, doubted).astype(float)
    run: Any = SimpleNamespace(rollout=SimpleNamespace(time=time, logged_state=decision[:, None]))
    assert _felt(HandPush([1.0, 0.0, 0.0], 0.25, 0.5), run) == felt


def pushed(estimate: Any) -> Any:
    """Run of 10 s, whose errors in rad rise by one each second, on a push from 4 to 6 s."""
    time = np.arange(10.0)
    estimates = np.zeros((10, 0)) if estimate is None else np.asarray(estimate, dtype=float)[:, None]
    rollout = SimpleNamespace(time=time, estimate=estimates, logged_state=np.zeros((10, 0)))

    def rms_error(start: float, stop: float) -> float | None:
        return float(time[(time >= start) & (time < stop)].mean()) if start < 10.0 else None

    return SimpleNamespace(name="one", label="One", rollout=rollout, rms_error=rms_error)


def test_errors_are_of_two_seconds_before_a_push_of_it_and_of_two_after_it() -> None:
    """Estimates' distances from 3 are told over the first one's, in percent."""
    run = pushed([1.0, 1.0, 1.0, 2.0, 9.0, 9.0, 9.0, 9.0, 9.0, 2.5])
    told = list(findings_of_push(HandPush([1.0, 0.0, 0.0], 4.0, 2.0), run, lambda x: abs(float(x[0]) - 3.0)))
    assert {one.name: (one.value, one.unit) for one in told} == {
        "error_before.one": (2500.0, "mrad"), "error_pushed.one": (4500.0, "mrad"), "error_after.one": (6500.0, "mrad"),
        "parameter_error_before.one": (50.0, "%"), "parameter_error_after.one": (25.0, "%"),
    }  # fmt: skip
    answer = answer_of_push(told, [run])
    assert answer is not None
    assert "in 2 s are 6500 mrad (One)" in answer


def test_without_estimates_or_time_there_are_no_errors_of_a_push() -> None:
    late = HandPush([1.0, 0.0, 0.0], 9.0, 1.0)
    told = {one.name: one.value for one in findings_of_push(late, pushed(None), lambda x: 1.0)}
    assert [name for name, value in told.items() if np.isnan(value)] == [
        "error_after.one", "parameter_error_before.one", "parameter_error_after.one",
    ]  # fmt: skip
    assert answer_of_push([], [pushed(None)]) is None
    assert _relative(0.0, pushed(np.ones(10)), lambda x: 1.0) is None
    assert _relative(9.0, pushed(np.ones(10)), lambda x: 0.0) is None
    assert _relative(1.0, pushed(np.ones(10)), lambda x: 2.0) == 100.0


def test_estimates_are_told_by_their_distance_from_the_loaded_arm_over_their_range(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    distances: list[float] = []
    model: Any = SimpleNamespace(fundamental_parameters=np.array([5.0, 1.0]))
    monkeypatch.setattr(contact, "ReducedModel", lambda *_: model)
    monkeypatch.setattr(contact, "findings_of_push", lambda push, run, d: [distances.append(d(np.array([2.0, 9.0])))])
    ranges: Any = SimpleNamespace(adaptation_gain_for=lambda _: np.diag([9.0, 4.0]))
    monkeypatch.setattr(Contact, "tuning", ranges)
    of, outcome = Contact(scene="air", push=(0.0, 9.0, 0.0)), SimpleNamespace(mechanism=None, runs=[None])
    list(of._after_push(outcome, None))  # type: ignore[arg-type]
    assert distances == [pytest.approx(np.hypot(3.0 / 3.0, 8.0 / 2.0))]
