"""Motions for a robot to run: from rest to rest, within every limit, and as telling as forecast."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_loops import RECIPES, random_loop
from random_trees import random_chain
from synthetic_logs import joint_drives

from adaptctl.cli.excite import _box, _earlier, _print, _validate_rate
from adaptctl.cli.main import main
from adaptctl.control import MotionLimits
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identification.columns import JointLog
from adaptctl.identification.friction_model import FrictionModel
from adaptctl.identification.identify import identified
from adaptctl.identification.regular_range import keeps_regular, regular_limits
from adaptctl.identification.robot_motion import RobotLimits, RobotMotion, exciting_motion, time_scaled
from adaptctl.identification.uncertainty import forecast
from adaptctl.identification.workspace import workspace


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_friction")


@pytest.fixture(scope="module")
def motion(puma: Mechanism) -> RobotMotion:
    limits = RobotLimits.of(puma, 0.8, 10.0, 100.0)
    return exciting_motion(puma, limits, start=START, end=END, iterations=3)


START, END = [0.0, -0.7, 0.5, 0.0, 0.3, 0.0], [0.5, -0.9, 0.9, 0.2, 0.1, 0.0]


def test_it_keeps_to_every_limit_and_rests_at_both_ends(puma: Mechanism, motion: RobotMotion) -> None:
    time, p, v, a, jerk = motion.sampled(1000.0)
    np.testing.assert_allclose(p[[0, -1]], [START, END], atol=1e-12)
    for ends in (v[[0, -1]], a[[0, -1]], jerk[[0, -1]]):
        np.testing.assert_allclose(ends, 0.0, atol=1e-9)
    slack = 1.0 + 1e-3  # limits are looked at 250 times a second
    for values, limit in ((a, 10.0), (jerk, 100.0)):
        assert np.abs(values).max() <= slack * limit
    joints = puma.primary_joints
    assert np.all(np.abs(v).max(axis=0) <= slack * 0.8 * np.array([j.limits.velocity for j in joints]))
    assert np.all(np.abs(puma.inverse_dynamics(p, v, a)).max(axis=0) <= slack * 0.8 * puma.effort_limits)
    assert np.all(p >= [j.limits.lower for j in joints])
    assert np.all(p <= [j.limits.upper for j in joints])
    assert time[-1] == pytest.approx(motion.duration)
    assert np.all(np.ptp(p, axis=0) > 0.3)


def test_its_derivatives_are_its_derivatives(motion: RobotMotion) -> None:
    time = np.linspace(0.0, motion.duration, 40)
    step = 1e-5
    before, now, after = (motion.at(time + shift) for shift in (-step, 0.0, step))
    inner = slice(1, -1)
    for lower, higher in ((0, 1), (1, 2), (2, 3)):
        difference = (after[lower] - before[lower]) / (2.0 * step)
        size = np.abs(now[higher]).max()
        np.testing.assert_allclose(difference[inner], now[higher][inner], atol=1e-5 * size)
    slower = time_scaled(motion, 2.0 * motion.time_scale)
    np.testing.assert_allclose(slower.at(2.0 * time)[0], now[0], atol=1e-12)
    np.testing.assert_allclose(8.0 * slower.at(2.0 * time)[3], now[3], atol=1e-9)


def test_what_is_forecast_is_found() -> None:
    """Deviations to be expected are those of the identification of its log, to a factor of some."""
    arm = random_chain(3, 2).with_drives(load("puma560_friction").links[0].joint.drive)
    motion = exciting_motion(arm, RobotLimits.of(arm, 0.8, 8.0, 200.0), iterations=3, duration=12.0)
    told = forecast(arm, motion, 0.5)
    time, p, v, a, _ = motion.sampled(250.0)
    rng = np.random.default_rng(0)
    torque = arm.inverse_dynamics(p, v, a) + 0.5 * np.sqrt(250.0 / 50.0) * rng.normal(size=p.shape)
    log = JointLog("made", time, p, torque)
    result = identified(arm, joint_drives(arm), [log], [log], friction=FrictionModel(), cutoff=25.0, prior_weight=0.5)
    expected = dict(zip(told.model.names, told.deviations.tolist(), strict=True))
    ratios = [s / expected[name] for name, s in zip(result.names, result.deviations, strict=True)]
    assert 0.3 < float(np.median(ratios)) < 3.0
    assert told.condition > 1.0
    assert len(told.combinations) == len(told.model.names)


@pytest.mark.parametrize("noise", [0.0, -0.5, np.inf, [0.5, 0.0]])
def test_residuals_to_expect_are_positive(noise: float | list[float]) -> None:
    arm = random_chain(3, 2)
    still = exciting_motion(arm, RobotLimits.of(arm, 0.8, 8.0, 200.0), iterations=1, duration=12.0)
    with pytest.raises(InputError, match="noise: expected positive numbers, got"):
        forecast(arm, still, noise)


BOXES = """<robot name="boxes">
  <link name="ground">
    <collision><origin xyz="0 1.2 0"/><geometry><box size="0.4 0.4 2"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><mass value="1"/><origin xyz="0.5 0 0"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute"><parent link="ground"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="3" effort="50"/></joint>
  <link name="tip">
    <inertial><mass value="1"/><origin xyz="0.5 0 0"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>
  </link>
  <joint name="bend" type="revolute"><parent link="arm"/><child link="tip"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="3" effort="50"/></joint>
</robot>
"""


def test_collisions_and_the_workspace_are_kept_clear_of(tmp_path: Path) -> None:
    (tmp_path / "boxes.urdf").write_text(BOXES)
    arm = load(tmp_path / "boxes.urdf")
    area = workspace(arm, tmp_path / "boxes.urdf")
    assert area.collides is not None
    assert area.allows(np.array([[0.0, 0.0], [0.3, 0.0]]))
    assert not area.allows(np.array([[0.0, 0.0], [1.5, 0.0]]))
    limits = RobotLimits.of(arm, 0.8)
    free = exciting_motion(arm, limits, iterations=2)
    assert not area.allows(free.sampled(50.0)[1])
    clear = exciting_motion(arm, limits, iterations=2, allowed=area.allows)
    assert area.allows(clear.sampled(50.0)[1])
    with pytest.raises(InputError, match="start: the pose collides, leaves the workspace, or"):
        exciting_motion(arm, limits, start=[1.5, 0.0], iterations=2, allowed=area.allows)
    boxed = workspace(arm, "boxes", np.array([-2.0, -0.5, -1.0]), np.array([2.0, 0.5, 1.0]))
    assert boxed.collides is None
    assert boxed.allows(np.array([[0.1, 0.0]]))
    assert not boxed.allows(np.array([[1.5, 0.0]]))


def test_the_command_writes_what_robots_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "boxes.urdf").write_text(BOXES)
    line = [
        "excite",
        str(tmp_path / "boxes.urdf"),
        "--iterations",
        "2",
        "--sample-rate",
        "50",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*line, "--acceleration", "5", "--jerk", "50", "80"]) == 0
    assert "self-collision                       checked" in capsys.readouterr().out
    for name in ("excitation", "validation"):
        rows = np.genfromtxt(tmp_path / "out" / f"{name}.csv", delimiter=",", names=True, deletechars="")
        assert rows.dtype.names == (
            "time",
            *(f"{w}.{j}" for w in ("position", "velocity", "acceleration") for j in ("turn", "bend")),
        )
        message = json.loads((tmp_path / "out" / f"{name}.json").read_text())
        assert message["joint_names"] == ["turn", "bend"]
        assert len(message["points"]) == len(rows)
        first, last = message["points"][0], message["points"][-1]
        assert first["velocities"] == last["velocities"] == [0.0, 0.0]
        seconds = last["time_from_start"]["sec"] + 1e-9 * last["time_from_start"]["nanosec"]
        assert seconds == pytest.approx(rows["time"][-1], abs=1e-6)
        text = (tmp_path / "out" / f"{name}.yaml").read_text().splitlines()
        assert json.loads(text[1].removeprefix("joint_names: ")) == ["turn", "bend"]
        assert json.loads(text[-1].removeprefix("- ")) == last
    assert (tmp_path / "out" / "excitation.rrd").read_bytes()[:4] == b"RRF2"
    told = json.loads((tmp_path / "out" / "forecast.json").read_text())
    assert told["self_collision_checked"] is True
    assert all(entry["deviation"] > 0.0 for entry in told["parameters"].values())
    assert main(line) == 2
    assert "the folder is not empty" in capsys.readouterr().err


def test_a_motion_after_a_log_adds_what_that_left_open(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A log of the turning joint alone, and the motion forecast with it: no parameter is known less than from it."""
    (tmp_path / "boxes.urdf").write_text(BOXES)
    arm, time = load(tmp_path / "boxes.urdf"), np.arange(0.0, 6.0, 0.01)[:, None]
    wave, rate = np.array([0.4, 0.01]), np.array([2.0, 1.0])
    p, v = wave * np.sin(rate * time), rate * wave * np.cos(rate * time)
    rows = np.column_stack([time, p, arm.inverse_dynamics(p, v, -(rate**2) * p)])
    names = "time,position.turn,position.bend,torque.turn,torque.bend"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=names, comments="")
    line = ["excite", str(tmp_path / "boxes.urdf"), "--json", "--iterations", "1", "--noise", "1", "--out"]
    told = []
    for more in ([], ["--after", str(tmp_path / "log.csv"), "--units", "time=s", "position=rad", "torque=N m"]):
        folder = tmp_path / f"{len(more)}"
        assert main([*line, str(folder), *more]) == 0
        told.append(json.loads((folder / "forecast.json").read_text()))
        assert json.loads(capsys.readouterr().out) == {**told[-1], "folder": str(folder)}
    alone, after = ([entry["deviation"] for entry in one["parameters"].values()] for one in told)
    assert np.all(np.array(after) < np.array(alone))
    written = {
        name: [(tmp_path / folder / f"{name}.csv").read_text() for folder in ("0", "6")]
        for name in ("excitation", "validation")
    }
    assert {name for name, (one, other) in written.items() if one == other} == {"validation"}  # which the log leaves


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--start", "9", "0"], "start: joint 'turn' at 9 is outside its range"),
        (["--start", "0"], "--start: boxes has 2 joints"),
        (["--box", "0", "0"], "--box: expected six numbers"),
        (["--box", "5", "5", "5", "6", "6", "6"], "start: the pose collides, leaves the workspace, or"),
        (["--duration", "3"], "duration: expected more than 4 s, twice the fade, got 3"),
        (["--jerk", "1", "2", "3"], "jerk: expected"),
        (["--noise", "0"], "noise: expected positive numbers"),
        (["--sample-rate", "0"], "rate: expected a positive number of Hz, got 0.0"),
        (["--sample-rate", "nan"], "rate: expected a positive number of Hz, got nan"),
        (["--sample-rate", "1e9"], "rate: expected at most 100000 points per second, got 1e+09"),
        (["--acceleration", "0"], "acceleration: expected positive numbers, got [0.0, 0.0]"),
        (["--jerk", "1", "-1"], "jerk: expected positive numbers, got [1.0, -1.0]"),
        (["--duration", "inf"], "duration: expected a positive number of seconds, got inf"),
        (["--duration", "nan"], "duration: expected a positive number of seconds, got nan"),
        (["--box", "1", "1", "1", "2", "0", "2"], "--box: expected the last three numbers above the first three"),
        (["--box", "1", "1", "1", "2", "nan", "2"], "--box: expected the last three numbers above the first three"),
        (["--noise", "1", "2", "3"], "noise: expected"),
        (["--units", "position=rad"], "--drives, --columns and --units are of earlier logs: give them by --after LOG"),
        (["--after", "none.csv"], "none.csv: does not exist"),
    ],
)
def test_what_cannot_be_is_refused(
    given: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "boxes.urdf").write_text(BOXES)
    assert (
        main(["excite", str(tmp_path / "boxes.urdf"), "--iterations", "1", "--out", str(tmp_path / "out"), *given]) == 2
    )
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("logs", "drives", "columns", "units", "message"),
    [
        ((), "d.toml", (), (), "of earlier logs"),
        ((), None, ("position=q",), (), "of earlier logs"),
        ((Path("a.csv"),), "d.toml", ("position=q",), (), "because --drives specifies them"),
        ((Path("a.csv"),), "d.toml", (), ("position=deg",), "because --drives specifies them"),
    ],
)
def test_columns_are_of_earlier_logs_and_told_once(
    logs: Any, drives: str | None, columns: Any, units: Any, message: str, puma: Mechanism
) -> None:
    with pytest.raises(InputError, match=message):
        _earlier(puma, logs, Path(drives) if drives else None, columns, units)


def test_a_box_has_room_and_files_at_most_a_hundred_thousand_points_a_second() -> None:
    ends = _box((0.0, 0.1, 0.2, 1.0, 1.1, 1.2))
    assert [end.tolist() for end in ends] == [[0.0, 0.1, 0.2], [1.0, 1.1, 1.2]]
    assert _box(()) == (None, None)
    with pytest.raises(InputError, match="last three numbers above"):
        _box((0.0, 0.1, 0.2, 1.0, 0.1, 1.2))
    _validate_rate(1e5)
    with pytest.raises(InputError, match="100001"):
        _validate_rate(100_001.0)


def test_ranges_of_loops_are_clear_of_singularities_and_keep_conditions() -> None:
    """A four-bar without ranges, which folds within a turn, and an arm whose elbow is to stay bent."""
    free = np.array([np.inf])
    bars, arm = random_loop(1, RECIPES["four-bar"])[0], load("semi_direct_drive")
    turn = MotionLimits(np.array([-np.pi]), np.array([np.pi]), free, free)
    ranges = np.array([[joint.limits.lower, joint.limits.upper] for joint in arm.primary_joints]).T
    for mechanism, limits in ((bars, turn), (arm, MotionLimits(*ranges, np.full(3, np.inf), np.full(3, np.inf)))):
        found = regular_limits(mechanism, limits)
        rng = np.random.default_rng(5)
        assert not keeps_regular(mechanism, rng.uniform(limits.lower, limits.upper, (300, mechanism.dof))).all()
        inside = rng.uniform(found.lower, found.upper, (300, mechanism.dof))
        axes = np.eye(mechanism.dof) if found.axes is None else found.axes
        assert keeps_regular(mechanism, inside @ axes.T).all()
        assert np.all((inside @ axes.T >= limits.lower) & (inside @ axes.T <= limits.upper))
        assert np.all(found.upper - found.lower > 0.3)
    assert found.upper[2] - found.lower[2] > 1.8  # of the 2.1 rad that the condition leaves between joints 2 and 3
    assert np.all(np.ptp(inside @ axes.T, axis=0)[1:] > 3.0)  # which move together further than that


@pytest.mark.parametrize("name", mostly_at_night(RECIPES, "four-bar"))
def test_motions_of_loops_keep_away_from_singularities(name: str) -> None:
    narrow = "spatial hinge", "two spatial loops"  # which turn too little for a certain rank with the first seed
    mechanism, _ = random_loop(2 if name in narrow else 1, RECIPES[name])
    motion = exciting_motion(mechanism, RobotLimits.of(mechanism, 0.8), iterations=1)
    assert keeps_regular(mechanism, motion.sampled(50.0)[1]).all()
    assert np.isfinite(mechanism.inverse_dynamics(*motion.sampled(50.0)[1:4])).all()


def test_the_outcome_is_told_with_what_it_leaves_open_and_what_comes_next(capsys: pytest.CaptureFixture[str]) -> None:
    combinations = [SimpleNamespace(words=f"words {k}", strength=0.5 + k) for k in range(7)]
    predicted: Any = SimpleNamespace(
        condition=123.4, relative=np.array([0.05, 0.0999, 0.1, 3.0]), combinations=combinations
    )
    motions: Any = {"excitation": SimpleNamespace(duration=10.04), "validation": SimpleNamespace(duration=7.25)}
    for collisions, word in ((True, "checked"), (False, "not checked")):
        _print(motions, predicted, collisions, Path("out"))
        told = capsys.readouterr().out
        rows = dict(re.findall(r"^  (\S.*?)  +(\S.*)$", told, re.MULTILINE))
        assert "10.0 s and 7.2 s" in told
        assert rows["condition of the scaled regressor"] == "123"
        assert rows["parameters known to 10 %"] == "2 of 4"
        assert rows["self-collision"].startswith(word)
        assert re.findall(r"words (\d) .* (\S+)\)", told) == [(str(k), f"{0.5 + k:.2g}") for k in range(5)]
        assert [word in told for word in ("out/excitation.csv", "out/validation.csv", "out/excitation.rrd")] == [
            True
        ] * 3
        assert "adaptctl identify" in told
