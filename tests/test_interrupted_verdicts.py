"""Ctrl-C before an arm moves: no run that was cut off is judged, and the arm is not driven."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest

from adaptctl.cli.main import main
from adaptctl.hardware import MuJoCoRobot
from adaptctl.simulation.simulate_many import _Runs


def test_ctrl_c_in_a_verification_is_no_verdict_and_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    moved: list[str] = []
    advance = _Runs.advance

    def interrupted(runs: Any) -> None:
        advance(runs)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(_Runs, "advance", interrupted)
    monkeypatch.setattr(MuJoCoRobot, "start", lambda *_: moved.append("started"))
    drive = ["drive", "mujoco", "two_link", "--robot", "two_link", "--duration", "1"]
    code = main([*drive, "--out", str(tmp_path / "run")])
    assert (code, moved) == (130, [])
    assert "fail" not in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
