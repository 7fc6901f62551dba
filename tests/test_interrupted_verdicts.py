"""Ctrl-C ends a command: no run or search that was cut off is taken for a whole one, and no arm is driven."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from driven_robots import ARM, RecordedRobot
from signals import signalled
from test_drive import CENTER, LAW, PERIOD, REFERENCE

import adaptctl
from adaptctl.cli.main import main
from adaptctl.control.excitation.excitation_trajectory import _Best
from adaptctl.hardware import MuJoCoRobot
from adaptctl.hardware.loop import DriveLoop
from adaptctl.identification.robot_motion import RobotLimits, exciting_motion
from adaptctl.tuning import trial_runs


def test_ctrl_c_in_a_verification_is_no_verdict_and_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    moved: list[str] = []
    advanced = trial_runs._advanced

    def interrupted(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return advanced(*given)

    monkeypatch.setattr(trial_runs, "_advanced", interrupted)
    monkeypatch.setattr(MuJoCoRobot, "start", lambda *_: moved.append("started"))
    drive = ["drive", "mujoco", "two_link", "--robot", "two_link", "--duration", "1"]
    code = main([*drive, "--out", str(tmp_path / "run")])
    assert (code, moved) == (130, [])
    assert "fail" not in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


class Pressed(RecordedRobot):
    """Robot at which Ctrl-C is pressed in some calls of `write`, and in each of `stop`."""

    pressed: tuple[int, ...] = ()
    stops = 0

    def write(self, torque: Any) -> None:
        super().write(torque)
        if self.tick in self.pressed:
            signal.raise_signal(signal.SIGINT)

    def stop(self) -> None:
        signal.raise_signal(signal.SIGINT)
        self.stops += 1
        super().stop()


def test_ctrl_c_before_the_first_torque_moves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Pressed(ARM, PERIOD, CENTER)
    monkeypatch.setattr(DriveLoop, "_described", lambda loop, state: signal.raise_signal(signal.SIGINT) or state)
    with pytest.raises(KeyboardInterrupt) as stop:
        adaptctl.drive(robot, LAW, REFERENCE, 3.0)
    assert stop.value.args == ()
    assert not hasattr(robot, "sent")


def test_what_was_recorded_outlives_a_second_ctrl_c(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    robot = Pressed(ARM, PERIOD, CENTER)
    robot.pressed = (50, 60)
    with pytest.raises(KeyboardInterrupt) as stop:
        adaptctl.drive(robot, LAW, REFERENCE, 3.0, tmp_path / "run.parquet")
    (run,) = stop.value.args
    assert (run.by_robot, robot.stops, robot.tick) == (True, 1, 60)
    assert "twice" in run.stopped
    assert capfd.readouterr().err.count("stopping") == 1
    assert adaptctl.Rollout.load(tmp_path / "run.parquet").interrupted


@pytest.mark.parametrize(("place", "cut"), [("_result", True), ("RunLogger.__exit__", False)])
@pytest.mark.parametrize("stopped", [False, True])
def test_ctrl_c_once_the_arm_is_handed_back_loses_nothing(place: str, cut: bool, stopped: bool, tmp_path: Path) -> None:
    robot = Pressed(ARM, PERIOD, CENTER)
    robot.pressed = (10,) if stopped else ()
    with pytest.raises(KeyboardInterrupt) as stop, signalled(place, signal.SIGINT):
        adaptctl.drive(robot, LAW, REFERENCE, 0.2, tmp_path / "run.parquet")
    (run,) = stop.value.args
    assert (run.by_robot, run.stopped) == (False, "interrupted" if stopped else "")
    kept = adaptctl.Rollout.load(tmp_path / "run.parquet")
    assert (len(kept.time), kept.interrupted) == (len(run.rollout.time), cut or stopped)


def test_a_search_that_was_cut_off_is_no_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Best, "iterated", lambda *_: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        exciting_motion(ARM, RobotLimits.of(ARM, 1.0), harmonics=2, iterations=2)
