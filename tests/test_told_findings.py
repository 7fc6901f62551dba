"""What experiments tell of runs whose numbers are made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_law_findings import ARM, STEP, run_of

from adaptctl.control import PDGravity
from adaptctl.dynamics import load
from adaptctl.experiments import contact
from adaptctl.experiments.adaptive import FINE, OURS, AdaptiveTracking
from adaptctl.experiments.contact import Contact
from adaptctl.experiments.contest import ADAPTATION_OFF, Outcome, Told, step_cost
from adaptctl.experiments.laws import Laws, _rubbed, _saturated, friction_curves, memory_findings
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis, reduce, states_within_limits

SLOW: dict[str, Any] = {"sample_time": 1.0, "control_period": 1.0}


def values(told: Told) -> dict[str, float]:
    return {one.name: one.value for one in told.findings}


def test_a_force_is_judged_from_fifteen_seconds_on_and_asked_to_be_none_before(monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.arange(20.0)
    forces = {name: np.where(time < 15.0, 3.0, last) for name, last in (("impedance", 11.0), ("tracking", 90.0))}
    upward = {
        name: size[:, None] * np.array([0.5, 0.5, 1.0]) for name, size in forces.items()
    }  # a table's, and rubbing
    monkeypatch.setattr(contact, "contact_forces", lambda rollout: upward[rollout.law])
    runs = [run_of(0.0 * time, name, time=time, duration=20.0, law=name) for name in forces]
    told = Contact(force=12.0)._pressed(Outcome(ARM, tuple(runs), True))
    assert values(told) == {"mean_force.impedance": 11.0, "mean_force.tracking": 90.0}
    assert told.task_error is not None
    assert told.task_error.errors["impedance"] == pytest.approx(1e-3 * np.where(time < 15.0, 3.0, 1.0))
    assert "Asked for 12 N" in (told.answer or "")
    short = run_of(0.0 * time[:15], "tracking", time=time[:15], duration=15.0, law="tracking")
    upward["tracking"] = upward["tracking"][:15]
    assert np.isnan(values(Contact()._pressed(Outcome(ARM, (short,), True)))["mean_force.tracking"])


@pytest.mark.parametrize(("fine", "is_explained"), [(0.0019, True), (0.0021, False)])
def test_integration_explains_what_a_quarter_of_the_step_halves(fine: float, is_explained: bool) -> None:
    p = np.zeros(9)
    runs = [run_of(p + 0.004, "learning"), run_of(p[:5] - fine, FINE), run_of(p, OURS)]
    told = AdaptiveTracking(robot="two_link", plant="both").told(Outcome(ARM, tuple(runs), True), None)  # type: ignore[arg-type]
    assert values(told) == pytest.approx({"plants_apart": 0.004, "plants_apart_fine": fine})
    assert ("caused by MuJoCo's integrator" in (told.answer or "")) is is_explained
    assert "4 mrad" in (told.answer or "")


def test_freezing_is_told_over_none_and_errors_after_the_release() -> None:
    size = np.where(np.arange(900) * STEP < 6.0, 0.01, 0.03)
    estimate = np.array([[1.0, -7.0]] * 900)
    runs = run_of(size, estimate=estimate), run_of(2.0 * size, "never-frozen"), run_of(size[:500], "pd")
    of = Laws(robot="two_link", torque_limit_scale=0.5, payload=1.0, payload_start=3.0, payload_stop=6.0)
    found = values(_saturated(of, Outcome(ARM, runs, True), None))  # type: ignore[arg-type]
    assert found == pytest.approx({
        **{f"saturated.{name}": 0.0 for name in ("gradient", "never-frozen", "pd")},
        "largest_estimate.gradient": 7.0, "largest_estimate.never-frozen": 0.0, "largest_estimate.pd": 0.0,
        "rms_error_after.gradient": 0.03, "rms_error_after.never-frozen": 0.06, "freeze_over_none": 0.5,
    })  # fmt: skip


def test_friction_is_told_as_learned_and_with_columns_over_without() -> None:
    arm = load("puma560_friction").locked([f"joint{k}" for k in range(2, 7)])
    basis = fundamental_basis(essential_space(arm))
    names = ReducedModel(arm, basis).names
    estimate = np.tile(np.arange(len(names), dtype=float), (300, 1))
    runs = (
        run_of(np.full(300, 0.002), estimate=estimate, v=np.ones((300, 1))),
        run_of(np.full(300, 0.008), "no-friction-columns"),
    )
    found = values(_rubbed(Laws(robot="puma560_friction", stribeck=0.5), Outcome(arm, runs, True), basis))
    expected = {f"learned.joint1.{kind}": names.index(f"joint1.{kind}") for kind in ("viscous", "coulomb")}
    assert found == pytest.approx(expected | {"columns_over_none": 0.25})


def test_the_excess_at_rest_is_half_at_a_tenth_of_a_radian_a_second() -> None:
    arm = load("puma560_friction")
    drive = arm.primary_joints[1].drive
    viscous, coulomb = float(drive.viscous or 0.0), float(drive.coulomb or 0.0)
    v = np.zeros((2, 6))
    v[1, 1] = -0.2  # so that the middle of the curve is at 0.1 rad/s
    figure = friction_curves(arm, {"joint2.viscous": 2.0, "joint2.coulomb": 5.0}, v, 0.5)
    true, learned = figure.axes[1].lines
    speeds, torques = (np.asarray(x, dtype=float) for x in true.get_data())
    assert torques[0] == pytest.approx(1.5 * coulomb)
    assert np.interp(0.1, speeds, torques) == pytest.approx(0.1 * viscous + 1.25 * coulomb, rel=1e-4)
    assert learned.get_ydata()[[0, -1]] == pytest.approx([5.0, 5.0 + 2.0 * 0.2])
    assert len({round(axes.get_position().y0, 3) for axes in figure.axes}) == 2  # rows of three joints


def test_a_law_remembers_in_the_periods_above_its_threshold() -> None:
    law: Any = SimpleNamespace(adaptation_law=SimpleNamespace(novelty_threshold=5.0))
    run = run_of(np.zeros(4), logged_state=np.array([[0.0], [0.5], [2.0], [0.0]]))
    (finding,) = memory_findings(law, run, ARM)
    assert (finding.name, finding.value) == ("remembered.gradient", 0.5)
    assert "above the threshold of 5 1/s" in finding.meaning
    assert not list(memory_findings(law, run_of(np.zeros(4), logged_state=np.zeros((4, 0))), ARM))
    assert not list(memory_findings(SimpleNamespace(adaptation_law=None), run, ARM))  # type: ignore[arg-type]


def test_errors_by_components_are_of_the_most_the_least_and_the_least_held() -> None:
    of = Puma560Adaptive(components=(3, 2))
    errors = {"adaptive-3": 0.001, "adaptive-2": 0.005, "fixed-2": 0.02, ADAPTATION_OFF: 0.5}
    runs = tuple(run_of(np.full(300, error), name) for name, error in errors.items())
    told = of.told(Outcome(ARM, runs, True), None)  # type: ignore[arg-type]
    found = values(told)
    assert [found[f"final_rms_error.{name}"] for name in errors] == pytest.approx([1.0, 5.0, 20.0, 500.0])
    # of 101 states, as many as the paper has
    space = essential_space(ARM, seed=0, states=states_within_limits(ARM, 101, 0))
    percents = reduce(space, ARM, components=space.rank).percent_errors
    assert [found["energy_error.3"], found["energy_error.2"]] == pytest.approx([percents[3], percents[2]])
    assert "With 3 adapted components, the final RMS tracking error is 1 mrad; with 2" in (told.answer or "")
    assert "it is 5 mrad, and with their true values held 20 mrad" in (told.answer or "")


def test_a_law_that_is_not_timed_has_no_time() -> None:
    law = PDGravity(ARM, np.ones(2), np.ones(2))
    run: Any = SimpleNamespace(time=np.arange(3.0), **dict.fromkeys(("p", "v"), np.zeros((3, 2))),
                               **{f"reference_{x}": np.zeros((3, 2)) for x in "pva"})  # fmt: skip
    untimed, timed = (step_cost(law, run, is_timed) for is_timed in (False, True))
    assert untimed.flops == timed.flops > 0
    assert untimed.called is None
    assert 1e-7 < (timed.called or 0.0) < 0.1
