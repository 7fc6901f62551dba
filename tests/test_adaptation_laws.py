"""The experiment that sets laws side by side: equal conditions, parameter errors, costs."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import at_night

from adaptctl.cli.main import main
from adaptctl.description.inertia import is_physically_consistent
from adaptctl.dynamics import load
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments.disturbed_arm import LAWS
from adaptctl.experiments.laws import Laws
from adaptctl.experiments.laws_controllers import deviations
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.verification import scaled_links

COMMAND = ("experiment", "run", "laws")
SMALL = "two_link"
CHOSEN = ("composite", "gradient", "gradient-euler", "dead-zone", "natural", "pd-gravity")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs") / "laws"


@pytest.fixture(scope="module")
def said(out: Path) -> dict[str, Any]:
    """The summary of the first 3 s, some of the laws, on an arm for which they compile in a moment."""
    laws = [argument for law in CHOSEN for argument in ("--laws", law)]
    assert main([*COMMAND, "--robot", SMALL, "--out", str(out), "--duration", "3", *laws]) == 0
    return json.loads((out / "summary.json").read_text())


def test_every_law_that_adapts_learns(said: dict[str, Any]) -> None:
    assert tuple(said["runs"]) == (*CHOSEN, "adaptation-off")
    errors = {name: said["findings"][f"parameter_error.{name}"]["value"] for name in (*CHOSEN[:-1], "adaptation-off")}
    assert all(errors[name] < 0.6 * errors["adaptation-off"] for name in CHOSEN[:-1])
    final = {name: run["final_rms_error"] for name, run in said["runs"].items()}
    assert all(final[name] < 0.4 * final["adaptation-off"] for name in CHOSEN[:-1])
    assert final["pd-gravity"] > final["adaptation-off"]


def test_six_joints_learn_too() -> None:
    said = Laws(laws=("gradient",), duration=3.0).compare(lambda what, share: None)
    errors = {finding.name: finding.value for finding in said.findings}
    assert errors["parameter_error.gradient"] < 0.6 * errors["parameter_error.adaptation-off"]
    final = {run.name: run.final_rms_error for run in said.runs}
    assert final["gradient"] < 0.4 * final["adaptation-off"]  # type: ignore[operator]


def test_composite_is_nearer_to_the_truth_than_the_gradient_alone(said: dict[str, Any]) -> None:
    errors = {name: said["findings"][f"parameter_error.{name}"]["value"] for name in ("composite", "gradient")}
    assert errors["composite"] < errors["gradient"]


def test_each_tick_has_its_price(said: dict[str, Any]) -> None:
    ticks = {name: run["tick"] for name, run in said["runs"].items()}
    assert ticks["adaptation-off"]["flops"] < ticks["gradient"]["flops"] < ticks["composite"]["flops"]
    assert all((tick["called"], tick["native"]) == (None, None) for tick in ticks.values())


def test_ticks_are_timed_where_it_is_asked() -> None:
    for run in (
        Laws(robot=SMALL, laws=("gradient",), duration=0.5, measure_step_time=True)
        .compare(lambda what, share: None)
        .runs
    ):
        assert run.cost is not None
        assert 0.0 < (run.cost.called or 0.0) < 1.0


def test_the_lyapunov_function_hardly_rises_between_samples(said: dict[str, Any]) -> None:
    for name in ("gradient", "gradient-euler"):
        assert said["runs"][name]["lyapunov_max_increase"] < 1e-3 * said["lyapunov_initial"]


def test_parameter_errors_are_drawn(out: Path, said: dict[str, Any]) -> None:
    page = (out / "report.html").read_text()
    assert "final parameter error" in page
    assert "one line per adaptive law" in page
    assert "with its final value" in page


def test_a_rough_model_is_rigid_bodies_within_its_deviations() -> None:
    arm = load("puma560_geared")
    rough = scaled_links(arm, 0.5, seed=1)
    assert all(is_physically_consistent(ten) for ten in rough[:60].reshape(6, 10))
    np.testing.assert_array_equal(rough[60:], arm.inertial_parameters[60:])
    np.testing.assert_allclose(np.abs(rough[:60:10] / arm.inertial_parameters[:60:10] - 1.0), 0.5)
    full, model = ReducedModel.full(arm), ReducedModel(arm)
    assert np.all(deviations(full, arm.inertial_parameters, 0.5) >= 0.999 * np.abs(rough - arm.inertial_parameters))
    assert deviations(model, rough, 0.5).shape == (len(model.columns),)
    np.testing.assert_allclose(deviations(model, rough, 0.25), 0.5 * deviations(model, rough, 0.5))


def test_the_most_exciting_motion_is_that_of_the_search() -> None:
    """Of a small arm, and refused for loops."""
    asked = Laws(robot=SMALL, motion="exciting", laws=("gradient",), duration=1.0)
    said = asked.compare(lambda what, share: None)
    reference = said.runs[0].rollout.reference_p
    expected = asked.reference(said.mechanism)(said.runs[0].rollout.time).p
    np.testing.assert_allclose(reference, expected, rtol=0.0, atol=1e-12)
    assert np.abs(np.diff(reference, axis=0)[0]).max() > 0.0  # it begins in motion
    with pytest.raises(InputError, match="exciting is only for arms without loops"):
        Laws(motion="exciting").reference(load("semi_direct_drive"))
    with pytest.raises(NotFoundError, match="motion: expected random, exciting, single, rest, got 'wild'"):
        Laws(motion="wild")


def test_laws_that_do_not_exist_or_come_twice_are_refused() -> None:
    with pytest.raises(NotFoundError, match="unknown law 'gradients'; laws: composite, gradient"):
        Laws(laws=("gradients",))
    with pytest.raises(InputError, match="each at most once"):
        Laws(laws=(LAWS[0], LAWS[0]))
    with pytest.raises(InputError, match=r"farther than its loops allow; give less than 0.25 rad"):
        Laws().followed(load("semi_direct_drive"))


def five_bar(folder: Path) -> str:
    """A file of the built-in five-bar linkage without the vertical axis that carries it, gravity in its plane."""
    before, *links = (
        Path(str(files("adaptctl.description.robots") / "semi_direct_drive.toml")).read_text().split("[[links]]\n")
    )
    standing = [link.replace('parent = "link1"', "rpy_deg = [-90, 0, 0]") for link in links[1:]]
    path = folder / "five_bar.toml"
    path.write_text("[[links]]\n".join([before.replace('"joint1", ', ""), *standing]))
    return str(path)


@pytest.mark.parametrize("laws", [("gradient", "composite", "natural"), at_night((LAWS,))])
def test_every_law_runs_through_a_loop(laws: tuple[str, ...], tmp_path: Path) -> None:
    """All laws, on reduced and on full parameters of a closed chain."""
    asked = Laws(robot=five_bar(tmp_path), laws=laws, amplitude=0.12, duration=2.0)
    said = asked.compare(lambda what, share: None)
    assert [run.name for run in said.runs] == [*laws, "adaptation-off"]
    assert not any(run.rollout.terminated for run in said.runs)
    off = said.runs[-1].rms_error()
    assert all(run.rms_error() < 0.3 * off for run in said.runs if run.name in LAWS[:-2])
