"""`adaptctl design`, as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nightly import nightly
from rerun.chunk import RrdReader
from robot_files import urdf

from adaptctl.cli.main import main
from adaptctl.design import DesignTask, added_mass, design_study, gripper
from adaptctl.design.picture import colors, norm, spots
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.recording.skeleton import skeleton

QUICK = ("--samples", "100")


def said(capsys: pytest.CaptureFixture[str], *line: str) -> dict[str, Any]:
    assert main(["design", *line, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_json_tells_what_the_api_does(capsys: pytest.CaptureFixture[str]) -> None:
    content = said(
        capsys, "puma560_measured", *QUICK, "--body", "gripper", "--link", "link6", "--mount", "0", "0", "0.05"
    )
    task = DesignTask.within_limits(load("puma560_measured"), 100)
    found = added_mass(task, "link6", gripper(), (0.0, 0.0, 0.05))
    assert content["schema"] == "adaptctl/design/2"
    assert content["before"]["rank"] == 36
    assert content["added"]["energy_change"] == pytest.approx(found.energy_change)
    assert content["added"]["newly_identifiable"] == list(found.newly_identifiable)
    assert content["counterweights"]["after"]["energy"] < content["before"]["energy"]
    ways = {removal["kind"] for removal in content["simplifications"]}
    assert ways == {"symmetry", "balance", "relocation"} or ways == {"symmetry", "balance"}
    assert all(removal["rank"] < 36 and removal["operations_saved"] > 0 for removal in content["simplifications"])
    assert all(removal["before"] and removal["after"] for removal in content["simplifications"])
    assert [link["link"] for link in content["links"]] == [f"link{i}" for i in range(1, 7)]


def test_the_report_is_for_a_person(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", str(urdf("ur5_robot.urdf")), *QUICK, "--link", "wrist_3_link", "--mass", "2"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for told in ("2 kg on wrist_3_link", "Counterweights that minimise the energy", "Eliminated parameters", "36"):
        assert told in text


@pytest.mark.parametrize("folder", [True, False])
def test_what_a_folder_needs_is_missed_first_and_for_a_folder_alone(
    folder: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> None:
        raise InputError("a package is missing")

    monkeypatch.setattr("adaptctl.optional_packages.validate_for_results", missing)
    line = ("--out", str(tmp_path / "study")) if folder else ()
    assert main(["design", "puma560_measured", "--samples", "1", *line]) == 2
    assert ("a package is missing" in capsys.readouterr().err) == folder


@nightly
def test_a_folder_is_written_whole(tmp_path: Path) -> None:
    out = tmp_path / "study"
    assert main(["design", "semi_direct_drive", *QUICK, "--objective", "coupling", "--out", str(out)]) == 0
    content = json.loads((out / "design.json").read_text())
    assert content["counterweights"]["objective"] == "coupling"
    assert content["counterweights"]["relative_reduction"] > 0.3
    page = (out / "report.html").read_text()
    assert "Eliminated parameters" in page
    assert page.count("<img") == 2
    assert {path.name for path in out.iterdir()} == {"design.json", "report.html", "recording.rrd", "figures"}
    entities = {str(path) for path in RrdReader(out / "recording.rrd").store().schema().entity_paths()}
    assert {"/world/arm/link2/cost", "/world/arm/link2/counterweight", "/summary"} <= entities
    assert main(["design", "semi_direct_drive", *QUICK, "--out", str(out)]) == 2


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (("--link", "hand"), "no link 'hand' with inertia; links: link1, link2"),
        (("--counterweights", "hand"), "no link 'hand' with inertia"),
        (("--counterweights", "link2", "link2"), "one or more different links"),
        (("--mass", "-1"), "--mass: expected a mass above 0 kg, got -1"),
        (("--mass", "0"), "--mass: expected a mass above 0 kg, got 0"),
        (("--mass", "nan"), "--mass: expected a mass above 0 kg, got nan"),
        (("--body", "anvil"), "unknown body 'anvil'; bodies: gripper, camera, motor"),
        (("--body", "gripper", "--mass", "2"), "--mass is for a point mass, and --body has a mass of its own"),
        (("--mount", "0", "0", "0"), "--mount is a position on a link: add --link"),
        (("--link", "link6", "--mount", "9", "0", "0"), "the position [9.0, 0.0, 0.0] is outside the bounds"),
        (("--mass-ratio", "-0.1"), "mounting bounds: --mass-ratio: expected a ratio of at least 0"),
        (("--objective", "beauty"), "objective: expected one of energy, torque, coupling, components, got 'beauty'"),
        (("--energy-error", "-1"), "--energy-error: expected a finite number of at least 0"),
        (("--samples", "1"), "--samples: expected a whole number from 2 to 100000"),
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
    study = design_study(DesignTask.within_limits(load("puma560_measured"), 50, 0, 0.25), 1.0)
    found = spots(study.map, skeleton(study.task.mechanism))
    worst, least = int(np.argmax(found.change)), int(np.argmin(found.change))
    shades = colors(found.change, norm(study, found.change)).astype(int)
    assert shades[worst, 0] > shades[worst, 2] + 50, "red"
    assert np.ptp(shades[least, :3]) < 60, "grey: what is on the first axis costs nothing"
    link = study.task.mechanism.links[int(found.link[worst])].name
    assert found.change[worst] == pytest.approx(added_mass(study.task, link, 1.0, found.place[worst]).energy_change)
