"""Arms in closed loop, as described and with counterweights: what one run by itself has, and what is refused."""

from __future__ import annotations

import html
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from rerun.chunk import RrdReader

from adaptctl.cli.main import main
from adaptctl.design import DesignStudy, DesignTask, design_study, picture
from adaptctl.design.driving import Demand, DrivenArm, _judged, driven
from adaptctl.design.report import _components_figure, _curves, _facts, _late, change, quantities
from adaptctl.dynamics import load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.recording.skeleton import Solid, skeleton
from adaptctl.simulation import rollout
from adaptctl.tuning import tune

ARM = "two_link"
SECONDS = 2.5


@pytest.fixture(scope="module")
def study() -> DesignStudy:
    return design_study(DesignTask.within_limits(load(ARM), 100), links=("upper", "lower"), mass_ratio=1.0)


@pytest.fixture(scope="module")
def runs(study: DesignStudy) -> dict[str, DrivenArm]:
    shares: list[float] = []
    found = driven(study, duration=SECONDS, components=3, seed=0, progress=shares.append)
    assert shares == pytest.approx([k / 6.0 for k in range(7)])
    return {run.name: run for run in found}


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


def test_a_run_is_judged_until_its_error_is_too_large() -> None:
    """Of four samples of two joints the last two are beyond."""
    rows = np.arange(8.0).reshape(4, 1, 2)
    found: Any = SimpleNamespace(
        time=1e-3 * np.arange(4.0), control_period=1e-3, diverged_at=np.array([2e-3]), p=rows, v=rows + 1.0,
        error=0.1 * rows, applied=-rows, rms_error=np.array([[3.0, 4.0]]), final_rms_error=np.full((1, 2), np.nan),
    )  # fmt: skip
    run = _judged(found, np.array([1.0, 2.0]), "all-before", "All")
    assert run.time.tolist() == [0.0, 1e-3]
    np.testing.assert_array_equal(run.error, 0.1 * rows[:2, 0])
    work = 1e-3 * (0.0 * 1.0 + 1.0 * 2.0 + 2.0 * 3.0 + 3.0 * 4.0)
    torque = np.sqrt(((0.0 + 0.5**2) + (2.0**2 + 1.5**2)) / 2.0)
    assert run.demand == Demand(np.sqrt(12.5), None, pytest.approx(torque), pytest.approx(work), 2e-3, True)
    assert (_late(run.demand), _late(run.demand._replace(stopped=False))) == ("stopped at 0.002 s", "–")
    assert _late(Demand(1.0, 0.25, 1.0, 1.0, 1.0, False), 1e3, " mrad") == "250 mrad"


def test_curves_of_runs_are_root_mean_squares_of_all_joints(runs: dict[str, DrivenArm]) -> None:
    (axes,) = _curves(list(runs.values()), lambda run: 1e3 * run.error, "error", log=True).axes
    assert len({line.get_color() for line in axes.lines}) == len(runs)
    assert axes.get_yscale() == "log"
    for line, run in zip(axes.lines, runs.values(), strict=True):
        assert len(line.get_xdata()) <= 3000
        np.testing.assert_allclose(
            np.interp(2.0, *line.get_data()), 1e3 * np.sqrt(np.mean(_at(run, 2.0) ** 2)), rtol=0.05
        )
    streamed = {curves.path: curves for curves in picture._curves(list(runs.values()))}
    assert set(streamed) == {f"{what}/{name}" for what in ("error", "torque") for name in runs}
    run, torque = runs["all-after"], streamed["torque/all-after"]
    last = run.applied[run.time > run.time[-1] - 0.25]
    assert np.ravel(torque.values)[-1] == pytest.approx(np.sqrt(np.mean(last**2)), rel=1e-2)


def _at(run: DrivenArm, time: float) -> np.ndarray:
    return run.error[np.searchsorted(run.time, time)]


def test_errors_are_drawn_by_components_without_and_with_counterweights(study: DesignStudy) -> None:
    (axes,) = _components_figure(study).axes
    *curves, bound = axes.lines
    assert np.allclose(bound.get_ydata(), study.percent)
    assert [line.is_dashed() for line in axes.lines] == [False, False, True]
    assert len({line.get_color() for line in axes.lines}) == 3
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["as described", "with counterweights"]
    for line, task in zip(curves, (study.task, study.counterweights.balanced_task), strict=True):
        counts, errors = line.get_data()
        assert errors[0] == pytest.approx(100.0)
        assert all(task.components(1.01 * error) == count for count, error in zip(counts, errors, strict=True))


def test_an_arm_is_coloured_along_its_links(study: DesignStudy) -> None:
    parts = skeleton(study.task.mechanism)
    found = picture.spots(study.map, parts)
    names = [link.name for link in study.task.mechanism.links]
    shapes = [
        shape for shape in parts.shapes if shape.solid is not Solid.JOINT and names[shape.link] in ("upper", "lower")
    ]
    assert len(found.link) == 24 * len(shapes) > 0
    for first, shape in zip(found.place[::24], shapes, strict=True):
        np.testing.assert_allclose(first, shape.start)
    np.testing.assert_allclose(found.place[-1], shapes[-1].end)
    for link in np.unique(found.link):
        own = found.link == link
        np.testing.assert_allclose(found.change[own], study.map.at(names[int(link)], found.place[own]))
        assert set(found.radius[own]) <= {shape.radius for shape in parts.shapes if shape.link == link}


def test_counterweights_and_their_places_are_shown_where_they_are(study: DesignStudy) -> None:
    recording, arm = MagicMock(), study.task.mechanism
    p = arm.neutral_configuration[None]
    picture._log_costs(recording, study, skeleton(arm), np.zeros(1), p)
    shown = {call.args[0].strip("/"): call.args[1] for call in recording.log.call_args_list}
    fixed = [call for call in recording.log.call_args_list if call.args[0].endswith(("cost", "room", "counterweight"))]
    assert all(call.kwargs["static"] for call in fixed)
    (weight, *_) = study.counterweights.weights
    ball = shown[f"world/arm/{weight.link}/counterweight"]
    assert ball.positions.as_arrow_array().to_pylist()[0] == pytest.approx(weight.place, rel=1e-6)
    volume = 4.0 / 3.0 * np.pi * ball.radii.as_arrow_array().to_pylist()[0] ** 3
    assert volume * weight.density == pytest.approx(weight.mass, rel=1e-5)
    places = np.array(shown[f"world/arm/{weight.link}/room"].positions.as_arrow_array().to_pylist())
    own = next(places for places in study.bounds if places.link == weight.link)
    for corner in (own.lower, own.upper, 0.5 * (own.lower + own.upper)):
        assert np.linalg.norm(places - corner, axis=1).min() < 1e-6


def test_counterweights_spare_the_motors(runs: dict[str, DrivenArm]) -> None:
    assert runs["all-after"].demand.rms_torque < 0.9 * runs["all-before"].demand.rms_torque


def test_what_cannot_be_driven_is_refused_before_gains_are_sought(
    study: DesignStudy, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adaptctl.design.driving.tune", None)
    with pytest.raises(InputError, match="duration: expected a positive number of s"):
        driven(study, duration=-1.0, seed=0)
    rubbing = DesignTask.within_limits(load("puma560_friction"), 50)
    with pytest.raises(InputError, match="puma560_friction has friction, which has no energy components; use an arm"):
        driven(design_study(rubbing, links=("link2",)), seed=0)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--duration", "5"), "--duration is for closed-loop runs: add --drive"),
        (("--components", "3"), "--components is for closed-loop runs"),
        (("--drive", "--components", "7"), "components of two_link: expected a whole number from 1 to 6, got 7"),
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


def test_the_folder_shows_runs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "driven"
    line = ["design", ARM, "--samples", "50", "--drive", "--duration", "2.5", "--components", "3", "--out", str(out)]
    assert main(line) == 0
    page, said = (out / "report.html").read_text(), json.loads((out / "design.json").read_text())["runs"]
    share = said["all-after"]["work"] / said["all-before"]["work"] - 1.0
    assert f"the mechanical work of the motors changes by {change(share)}." in html.unescape(page)
    assert f" to {1e3 * said['few-after']['final_rms_error']:.3g} mrad." in page
    entities = {str(path) for path in RrdReader(out / "recording.rrd").store().schema().entity_paths()}
    assert {"/error/few-before", "/torque/held-after"} <= entities
    words = " ".join(capsys.readouterr().out.split())
    for told in ("Closed loop", "All adapted, with counterweights", "gripper", "torque over limit"):
        assert told in page
        assert told in words
    for name in ("tracking", "applied"):
        assert (out / "figures" / f"{name}.png").is_file()


def test_the_command_tells_of_runs_and_bodies(capsys: pytest.CaptureFixture[str]) -> None:
    line = ["design", ARM, "--samples", "100", "--drive", "--duration", "1", "--components", "3"]
    assert main([*line, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said["runs"]["few-after"]) >= {"rms_error", "work", "rms_torque", "stopped"}
    assert said["runs"]["all-before"]["final_rms_error"] is None
    assert said["bodies"]["motor"]["lower"] > said["bodies"]["gripper"]["lower"] > said["bodies"]["camera"]["lower"]
