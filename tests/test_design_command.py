"""`adaptctl design` and the experiments `added-mass` and `counterweight`, as a user runs them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from robot_files import urdf

from adaptctl.cli.main import main
from adaptctl.design import DesignTask, added_mass, gripper
from adaptctl.design.picture import colors, norm, spots
from adaptctl.dynamics import load
from adaptctl.experiments.added_mass import AddedMassStudy, bodies
from adaptctl.experiments.counterweight import CounterweightedTracking, burden
from adaptctl.recording import ControllerRun
from adaptctl.recording.result import silent
from adaptctl.recording.skeleton import skeleton
from adaptctl.simulation import Rollout

QUICK = ("--samples", "100")


def said(capsys: pytest.CaptureFixture[str], *line: str) -> dict[str, Any]:
    assert main(["design", *line, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_json_tells_what_the_api_does(capsys: pytest.CaptureFixture[str]) -> None:
    content = said(capsys, "puma560_measured", *QUICK, "--body", "gripper", "--link", "link6", "--at", "0", "0", "0.05")
    task = DesignTask.within_limits(load("puma560_measured"), 100)
    found = added_mass(task, "link6", gripper(), (0.0, 0.0, 0.05))
    assert content["schema"] == "adaptctl/design/1"
    assert content["before"]["rank"] == 36
    assert content["added"]["energy_change"] == pytest.approx(found.energy_change)
    assert content["added"]["becomes_essential"] == list(found.becomes_essential)
    assert content["counterweights"]["after"]["energy"] < content["before"]["energy"]
    ways = {removal["way"] for removal in content["removals"]}
    assert ways == {"symmetry", "balance", "relocation"} or ways == {"symmetry", "balance"}
    assert all(removal["rank"] < 36 and removal["operations_saved"] > 0 for removal in content["removals"])
    assert all(removal["before"] and removal["after"] for removal in content["removals"])
    assert [link["link"] for link in content["links"]] == [f"link{i}" for i in range(1, 7)]


def test_the_report_is_for_a_person(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", str(urdf("ur5_robot.urdf")), *QUICK, "--link", "wrist_3_link", "--mass", "2"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for told in ("2 kg on wrist_3_link", "Counterweights for the least energy", "Parameters that can go", "36"):
        assert told in text


def test_a_folder_is_written_whole(tmp_path: Path) -> None:
    out = tmp_path / "study"
    assert main(["design", "semi_direct_drive", *QUICK, "--objective", "coupling", "--out", str(out)]) == 0
    content = json.loads((out / "design.json").read_text())
    assert content["counterweights"]["objective"] == "coupling"
    assert content["counterweights"]["saved"] > 0.3
    page = (out / "report.html").read_text()
    assert "Parameters that can go" in page
    assert page.count("<img") == 4
    assert {path.name for path in out.iterdir()} == {"design.json", "report.html", "recording.rrd", "figures"}
    entities = {str(path) for path in RrdReader(out / "recording.rrd").store().schema().entity_paths()}
    assert {"/world/arm/link2/cost", "/world/arm/link2/counterweight", "/summary"} <= entities
    assert main(["design", "semi_direct_drive", *QUICK, "--out", str(out)]) == 2


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (("--link", "hand"), "there is no link 'hand' with inertia; links: link1, link2"),
        (("--counterweights", "hand"), "there is no link 'hand' with inertia"),
        (("--counterweights", "link2", "link2"), "each once"),
        (("--mass", "-1"), "expected a mass of at least 0 kg, got -1"),
        (("--mass", "0"), "a mass above 0 kg, got 0"),
        (("--mass", "nan"), "expected a mass of at least 0 kg, got nan"),
        (("--body", "anvil"), "there is no body 'anvil'; bodies: gripper, camera, motor"),
        (("--body", "gripper", "--mass", "2"), "--mass is of a point, and --body has its own: give one of them"),
        (("--at", "0", "0", "0"), "--at says where on a link: give --link too"),
        (("--link", "link6", "--at", "9", "0", "0"), "the place [9.0, 0.0, 0.0] is outside the bounds"),
        (("--share", "-0.1"), "expected shares of at least 0"),
        (("--objective", "beauty"), "objective: expected one of energy, torque, coupling, components, got 'beauty'"),
        (("--energy-error", "-1"), "expected a percentage of at least 0"),
        (("--samples", "1"), "samples: expected a whole number from 2 to 100000"),
        (("--samples", "1000000000"), "samples: expected a whole number from 2 to 100000"),
        (("--speed", "-1"), "speed: expected a finite number of at least 0"),
    ],
)
def test_wrong_input_is_one_line(line: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", "puma560_measured", *(() if "--samples" in line else QUICK), *line]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1


def test_the_arm_is_coloured_by_cost() -> None:
    study = AddedMassStudy(samples=50).study(silent)
    found = spots(study.map, skeleton(study.task.mechanism))
    worst, least = int(np.argmax(found.change)), int(np.argmin(found.change))
    shades = colors(found.change, norm(study, found.change)).astype(int)
    assert shades[worst, 0] > shades[worst, 2] + 50, "red"
    assert np.ptp(shades[least, :3]) < 60, "grey: what is on the first axis costs nothing"
    link = study.task.mechanism.links[int(found.link[worst])].name
    assert found.change[worst] == pytest.approx(added_mass(study.task, link, 1.0, found.place[worst]).energy_change)


def test_bodies_cost_by_their_mass() -> None:
    found = bodies(AddedMassStudy(samples=50).study(silent))
    assert found["motor"]["link6"] > found["gripper"]["link6"] > found["camera"]["link6"] > 0.0


def test_an_experiment_of_added_mass(tmp_path: Path) -> None:
    out = tmp_path / "added"
    assert main(["experiment", "run", "added-mass", "--samples", "100", "--out", str(out)]) == 0
    content = json.loads((out / "summary.json").read_text())
    assert content["experiment"] == "added-mass"
    assert (out / "figures" / "bodies.png").stat().st_size > 1000
    assert RrdReader(out / "recording.rrd").store() is not None


def test_counterweights_in_closed_loop(tmp_path: Path) -> None:
    """An arm of two links carries less energy with counterweights, and its motors give less torque."""
    out = tmp_path / "balanced"
    arm = Path(__file__).parents[1] / "docs" / "examples" / "two_link.toml"
    line = ("experiment", "run", "counterweight", "--robot", str(arm), "--duration", "3", "--samples", "200")
    assert main([*line, "--components", "3", "--share", "1", "--out", str(out)]) == 0
    content = json.loads((out / "summary.json").read_text())
    runs = content["runs"]
    assert set(runs) == {f"{kind}-{name}" for kind in ("all", "few", "held") for name in ("before", "after")}
    assert content["counterweights"]["saved"] > 0.2
    assert runs["all-after"]["rms_torque"] < 0.95 * runs["all-before"]["rms_torque"]
    assert runs["all-after"]["work"] < runs["all-before"]["work"]
    assert not any(run["stopped"] for run in runs.values())
    assert {path.stem for path in (out / "figures").iterdir()} >= {"arm", "tracking", "applied", "components"}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (("--links", "hand"), "there is no link 'hand'"),
        (("--components", "99"), "has 36 essential parameters, got 99"),
        (("--robot", "puma560_friction"), "has friction, which carries no energy"),
        (("--objective", "beauty"), "objective: expected one of"),
        (("--share", "-1"), "share: expected a number"),
    ],
)
def test_wrong_settings_are_refused(line: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    robot = () if "--robot" in line else ("--robot", "puma560_measured")
    assert main(["experiment", "run", "counterweight", "--duration", "1", "--samples", "50", *robot, *line]) == 2
    assert told in capsys.readouterr().err


def test_a_burden_is_what_a_run_cost() -> None:
    time = np.arange(4000) * 1e-3
    v = np.stack([np.cos(time), -np.ones(4000)], axis=1)
    error, torque, nothing = np.full((4000, 2), 0.01), np.full((4000, 2), 2.0), np.zeros((4000, 2))
    flat = np.zeros(4000)
    run = Rollout(
        time, error, v, nothing, nothing, nothing, torque, torque, flat, flat, flat, np.zeros((4000, 0)), 1e-3, 0.0
    )
    found = burden(ControllerRun("all", "", "", run), np.array([4.0, 8.0]))
    assert found.rms_error == pytest.approx(0.01)
    assert found.final_rms_error == pytest.approx(0.01)
    assert found.rms_torque == pytest.approx(np.hypot(0.5, 0.25))
    assert found.work == pytest.approx(np.sum(2.0 * np.abs(np.cos(time)) + 2.0) * 1e-3)
    assert found.duration == pytest.approx(4.0)
    thinned = replace(run, every=10)  # each sample stands for ten periods
    assert burden(ControllerRun("all", "", "", thinned), np.array([4.0, 8.0])).work == pytest.approx(10.0 * found.work)
    assert CounterweightedTracking().components == 10
