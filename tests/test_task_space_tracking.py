"""The experiment of a tool on a path in the world."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night

from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments.task_space import ARMS, TaskSpaceTracking
from adaptctl.identifiability import essential_space
from adaptctl.recording.judgement import facts
from adaptctl.recording.rerun_recording import summary_markdown

pytestmark = pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")


def test_tools_are_where_wrist_and_forearm_end() -> None:
    """At the PUMA's flange with its wrist held straight, d4 + d6 of its Denavit-Hartenberg parameters; half a metre
    past the elbow of the five-bar."""
    serial, graph = ARMS
    np.testing.assert_allclose(serial.tip, [0.0, 0.0, 0.4331 + 0.05625])
    loops = load(graph.robot).description.loops
    assert loops is not None
    (elbow,) = loops.closures
    assert elbow.second == graph.link
    np.testing.assert_allclose(np.subtract(graph.tip, elbow.second_frame.translation), [0.5, 0.0, 0.0])
    assert essential_space(load(graph.robot)).rank == graph.printed_rank


@pytest.fixture(scope="module", params=mostly_at_night(["puma560_arm3", "semi_direct_drive"], "semi_direct_drive"))
def compared(request: pytest.FixtureRequest) -> Any:
    return TaskSpaceTracking(robot=request.param, duration=5.0).compare(lambda what, share: None)


def test_the_tool_learns_its_path_as_the_joints_do(compared: Any) -> None:
    found = {finding.name: finding.value for finding in compared.findings}
    final = {name.partition(".")[2]: value for name, value in found.items() if name.startswith("final")}
    assert compared.complete
    assert final["task-space"] < 0.5 * final["adaptation-off"]
    assert final["task-space"] < 2.0 * final["joint-space"]
    assert final["task-space"] < 0.3 * found["first_tool_error.task-space"]
    assert final["computed-torque"] < 0.2
    assert final["task-space-damped"] > final["task-space"], "a damped Jacobian lags"


def test_the_tools_errors_are_drawn(compared: Any) -> None:
    (drawing,) = compared.more_drawings
    (axes,) = drawing.draw().axes
    assert [line.get_label() for line in axes.lines] == [run.label for run in compared.runs]


def test_what_it_is_about_comes_first(compared: Any) -> None:
    (about, told, _), (whose, *_) = list(facts(compared))[:2]
    found = {finding.name: finding.value for finding in compared.findings}
    assert about == "Distance of the tool from its path"
    assert float(told.split(" mm")[0]) == pytest.approx(found["final_tool_error.task-space"], rel=1e-2)
    assert whose == "Joint RMS error, first second"
    text = summary_markdown(compared)
    (head,) = [line for line in text.splitlines() if line.startswith("| controller")]
    (row,) = [line for line in text.splitlines() if line.startswith("| Task space, gradient")]
    assert head.count("|") == row.count("|") == 7
    assert row.split(" | ")[2] in told


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"center": (0.5, 0.0)}, "center: expected 3 numbers, x, y and z, got 2"),
        ({"robot": "puma560_geared"}, "expected puma560_arm3 or semi_direct_drive, whose tools are defined"),
        ({"center": (2.0, 0.0, 0.0)}, "cannot reach"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        TaskSpaceTracking(duration=0.1, **options).compare(lambda what, share: None)
