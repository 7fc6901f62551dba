"""The serial arm and the one with a loop on one path: inverse kinematics, counts, and the experiment as run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from adaptctl.cli.main import main
from adaptctl.control import Spline
from adaptctl.dynamics import load
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import InputError, NotFoundError
from adaptctl.experiments import find
from adaptctl.experiments.replication.closed_loop import START_OFF
from adaptctl.experiments.sheu_walker_1991 import SheuWalker1991, chosen
from adaptctl.experiments.task_space import ARMS, TaskSpaceTracking

FIVE_BAR = ARMS[1]
TIP_ERRORS = (
    ("first_tool_error", "adaptive"),
    ("final_tool_error", "adaptive"),
    ("final_tool_error", "adaptation-off"),
)
COMMAND = ("experiment", "run", "sheu-walker-1991", "--only", "serial-versus-graph")


@pytest.fixture(scope="module")
def tip() -> Tip:
    return Tip(load(FIVE_BAR.robot), FIVE_BAR.link, np.array(FIVE_BAR.tip))


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "pair"
    assert main([*COMMAND, "--duration", "5", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def arms(out: Path) -> dict[str, Any]:
    return json.loads((out / "summary.json").read_text())["arms"]


@pytest.mark.parametrize("goal", [(0.55, 0.0, 0.47), (0.5, 0.15, 0.45), (0.65, -0.15, 0.5), (0.6, 0.1, 0.55)])
def test_inverse_kinematics_finds_joints_that_put_the_tip_there(tip: Tip, goal: tuple[float, float, float]) -> None:
    p = tip.joints(goal, FIVE_BAR.start)
    poses = link_poses(tip.mechanism, p)
    np.testing.assert_allclose(poses.translations[4] + poses.rotations[4] @ tip.offset, goal, atol=1e-11)
    np.testing.assert_allclose(tip.at(p), goal, atol=1e-11)


def test_inverse_kinematics_of_many_goals_is_that_of_each(tip: Tip) -> None:
    goals = TaskSpaceTracking().path(np.linspace(0.0, 10.0, 6)).p
    each = [tip.joints(goal, FIVE_BAR.start) for goal in goals]
    np.testing.assert_allclose(tip.joints(goals, FIVE_BAR.start), each, atol=1e-10)


def test_what_is_out_of_reach_is_told(tip: Tip) -> None:
    with pytest.raises(InputError, match="link5"):
        tip.joints((1.1, 0.0, 0.5), FIVE_BAR.start)
    with pytest.raises(InputError, match="link5"):  # too near: the five-bar would have to fold
        tip.joints((0.45, 0.0, 0.37), FIVE_BAR.start)
    with pytest.raises(InputError, match="unknown link 'hand'; links: link1"):
        Tip(tip.mechanism, "hand", np.zeros(3))


@pytest.mark.parametrize("duration", [4.0])
def test_the_reference_keeps_the_tip_on_its_path(tip: Tip, duration: float) -> None:
    experiment = TaskSpaceTracking(robot=FIVE_BAR.robot, duration=duration)
    reference = experiment.reference(tip.mechanism)
    times = np.linspace(0.0, duration, 173)
    np.testing.assert_allclose(tip.at(reference(times).p), experiment.path(times).p, atol=1e-6)


def test_splines_are_exact_for_quintics_and_rest_outside() -> None:
    times = np.linspace(0.0, 2.0, 9)
    coefficients = np.array([0.3, -1.0, 0.5, 2.0, -0.7, 0.1])
    quintic = np.polynomial.Polynomial(coefficients)
    spline = Spline(quintic(times)[:, None], times)
    inside = np.linspace(0.0, 2.0, 31)
    point = spline(inside)
    for values, curve in zip(point, (quintic, quintic.deriv(), quintic.deriv(2)), strict=True):
        np.testing.assert_allclose(values[:, 0], curve(inside), atol=1e-9)
    after = spline(3.0)
    assert (after.p[0], after.v[0], after.a[0]) == (pytest.approx(quintic(2.0)), 0.0, 0.0)
    with pytest.raises(InputError, match="at least 6 positions"):
        Spline(np.zeros((5, 1)), np.arange(5.0))


def test_table_13_and_what_it_costs(arms: dict[str, Any]) -> None:
    serial, graph = arms["serial"], arms["graph"]
    assert [serial[key] for key in ("links", "joints", "actuators", "inertial_parameters")] == [3, 3, 3, 30]
    assert [graph[key] for key in ("links", "joints", "actuators", "inertial_parameters")] == [5, 6, 3, 50]
    assert (serial["rank"], serial["rank_printed"], graph["rank"], graph["rank_printed"]) == (15, 16, 26, 26)
    for arm in (serial, graph):
        assert arm["regressor_flops"]["reduced"] < arm["regressor_flops"]["full"]
        assert arm["runs"]["adaptive"]["tick"]["flops"] < arm["runs"]["adaptive-full"]["tick"]["flops"]
    assert graph["regressor_flops"]["reduced"] > serial["regressor_flops"]["reduced"]


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_the_paper_s_16_is_the_rank_of_energies_that_are_not_differenced() -> None:
    arm = load(ARMS[0].robot)
    p, v, a = np.random.default_rng(0).uniform(-3.0, 3.0, (3, 200, 3))
    energies = arm.energy_regressor(p, v)
    assert np.linalg.matrix_rank(energies, rtol=1e-9) == 16
    assert np.linalg.matrix_rank(np.diff(energies, axis=0), rtol=1e-9) == 15
    assert np.linalg.matrix_rank(arm.torque_regressor(p, v, a).reshape(-1, 30), rtol=1e-9) == 15


def test_both_learn_to_follow_the_path(arms: dict[str, Any]) -> None:
    for arm in arms.values():
        assert arm["lyapunov_max_increase"] == 0.0
        assert arm["clipped_steps"] == 0
        first, last, off = (arm["findings"][f"{what}.{run}"]["value"] for what, run in TIP_ERRORS)
        assert last < 0.2 * first
        assert last < 0.5 * off


def test_both_start_equally_far_off_the_path(out: Path) -> None:
    """0.05 m in each direction; the same path, whatever the joints."""
    for arm in ARMS:
        table = pq.read_table(out / arm.name / "trace.parquet")
        names = [name for name in table.column_names if name.startswith("p.")]
        if arm is FIVE_BAR:
            tip = Tip(load(arm.robot), arm.link, np.array(arm.tip))
            first = np.array([table[name][0].as_py() for name in names])
            np.testing.assert_allclose(tip.at(first) - TaskSpaceTracking().center, START_OFF, atol=1e-9)
        assert table.num_rows == 5000


def test_the_report_says_why_not_16_and_the_recording_is_there(out: Path) -> None:
    page = (out / "report.html").read_text()
    assert "the paper prints 16" in page
    assert "in the folder serial" in page
    assert [path.stem for path in (out / "figures").iterdir()] == ["tip-error"]
    assert (out / "recording.rrd").stat().st_size > 1000
    for arm in ARMS:
        assert "not a sum of sinusoids" in (out / arm.name / "report.html").read_text()
        assert (out / arm.name / "recording.rrd").stat().st_size > 100_000


def test_paths_have_three_coordinates() -> None:
    with pytest.raises(InputError, match="amplitude: expected 3 numbers"):
        TaskSpaceTracking(amplitude=(0.1, 0.2))


def test_the_old_name_answers_with_the_new_command() -> None:
    with pytest.raises(NotFoundError, match=f"has been replaced by: adaptctl {' '.join(COMMAND)}$"):
        find("serial-versus-graph")


def test_the_arms_in_closed_loop_are_a_run_of_their_own() -> None:
    assert chosen(("serial-versus-graph",)) == ()
    with pytest.raises(InputError, match="only: serial-versus-graph is a separate run"):
        SheuWalker1991(only=("table7", "serial-versus-graph"))
