"""Arms in closed loop, as described and with counterweights: what one run by itself has, and what is refused."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from adaptctl.cli.main import main
from adaptctl.design import DesignStudy, DesignTask, design_study
from adaptctl.design.driving import DrivenArm, driven
from adaptctl.design.report import _facts, change, quantities
from adaptctl.dynamics import load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import rollout
from adaptctl.tuning import tune

ARM = "two_link"
SECONDS = 2.5


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return design_study(DesignTask.within_limits(load(ARM), 100), links=("upper", "lower"), mass_ratio=1.0)


@pytest.fixture(scope="module")
def runs(study: DesignStudy) -> dict[str, DrivenArm]:
    return {run.name: run for run in driven(study, duration=SECONDS, components=3)}


def test_each_arm_is_driven_by_three_controllers(runs: dict[str, DrivenArm]) -> None:
    assert list(runs) == [f"{kind}-{when}" for when in ("before", "after") for kind in ("all", "few", "held")]
    assert [run.demand.duration for run in runs.values()] == pytest.approx([SECONDS] * 6)
    assert not any(run.demand.stopped for run in runs.values())


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_run_is_that_of_the_environment(study: DesignStudy, runs: dict[str, DrivenArm], when: str) -> None:
    task, tuning = study.task if when == "before" else study.counterweights.balanced_task, tune(study.task.mechanism)
    env = TrackingEnv(
        task.mechanism,
        tuning.reference,
        duration=SECONDS,
        initial_error=tuning.initial_error,
        torque_limits=tuning.torque_limits,
        substeps=tuning.substeps,
        integrator=tuning.integrator,
    )
    alone = rollout(env, tuning.controller(ReducedModel(task.mechanism, task.basis), "gradient"), seed=0)
    found = runs[f"all-{when}"].demand
    assert found.rms_error == pytest.approx(float(np.sqrt(np.mean(alone.error**2))), rel=1e-6)
    late = alone.error[alone.time >= SECONDS - 2.0 - 1e-9]
    assert found.final_rms_error == pytest.approx(float(np.sqrt(np.mean(late**2))), rel=2e-3)
    power = np.abs(alone.applied * alone.v).sum(axis=1)
    assert found.work == pytest.approx(float(power.sum()) * 1e-3, rel=1e-6)
    share = (alone.applied / tuning.torque_limits) ** 2
    assert found.rms_torque == pytest.approx(float(np.sqrt(share.sum(axis=1).mean())), rel=1e-6)


def test_costs_are_facts_by_their_names(study: DesignStudy) -> None:
    costs = [name.casefold() for name, _ in quantities(study.task, study.percent)]
    told = [fact.question.casefold() for fact in _facts(study)]
    assert told == [costs[0], *costs[2:6], "counterweights"]


def test_counterweights_spare_the_motors(runs: dict[str, DrivenArm]) -> None:
    assert runs["all-after"].demand.rms_torque < 0.9 * runs["all-before"].demand.rms_torque


def test_what_cannot_be_driven_is_refused() -> None:
    rubbing = DesignTask.within_limits(load("puma560_friction"), 50)
    with pytest.raises(InputError, match="puma560_friction has friction, which has no energy components; use an arm"):
        driven(design_study(rubbing, links=("link2",)))


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--duration", "5"), "--duration is for closed-loop runs: add --drive"),
        (("--components", "3"), "--components is for closed-loop runs"),
        (("--drive", "--components", "7"), "components of two_link: expected a whole number from 1 to 6, got 7"),
        (("--drive", "--duration", "-1"), "duration: expected a positive number of s"),
        (
            ("--drive", "--control-period", "1"),
            "period: expected a positive time in s (1 ms is 0.001), from 1e-09 to 0.1",
        ),
    ],
)
def test_wrong_flags_are_one_line(more: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", ARM, "--samples", "50", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line


def test_the_folder_shows_runs(tmp_path: Path) -> None:
    out = tmp_path / "driven"
    line = ["design", ARM, "--samples", "50", "--drive", "--duration", "2.5", "--components", "3", "--out", str(out)]
    assert main(line) == 0
    page, said = (out / "report.html").read_text(), json.loads((out / "design.json").read_text())["runs"]
    share = said["all-after"]["work"] / said["all-before"]["work"] - 1.0
    assert f"the mechanical work of the motors changes by {change(share)}." in html.unescape(page)
    assert f" to {1e3 * said['few-after']['final_rms_error']:.3g} mrad." in page
    entities = {str(path) for path in RrdReader(out / "recording.rrd").store().schema().entity_paths()}
    assert {"/error/few-before", "/torque/held-after"} <= entities


def test_the_command_tells_of_runs_and_bodies(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    line = ["design", ARM, "--samples", "100", "--drive", "--duration", "1", "--components", "3"]
    assert main([*line, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said["runs"]["few-after"]) >= {"rms_error", "work", "rms_torque", "stopped"}
    assert said["runs"]["all-before"]["final_rms_error"] is None
    assert said["bodies"]["motor"]["lower"] > said["bodies"]["gripper"]["lower"] > said["bodies"]["camera"]["lower"]
    assert main([*line, "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    for told in ("Closed loop", "All adapted, with counterweights", "gripper", "torque over limit"):
        assert told in page
    for name in ("tracking", "applied"):
        assert (tmp_path / "out" / "figures" / f"{name}.png").is_file()
    words = " ".join(capsys.readouterr().out.split())
    for told in ("Closed loop", "All adapted, with counterweights", "camera", "torque over limit"):
        assert told in words
