"""Runs whose terminal is closed, as where a connection by ssh is lost: what was computed is kept."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

from nightly import nightly

RUN = (sys.executable, "-m", "adaptctl", "experiment", "run", "adaptive", "--robot", "puma560_arm3")

OF_TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where tests run under nohup
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""
"""Program that makes its input the terminal that controls it, and runs another."""


def wait_for_first_arm(terminal: int) -> None:
    """Wait until the first arm of an experiment was simulated."""
    shown, end = b"", time.monotonic() + 120.0
    while b"Slotine-Li" not in shown:
        assert time.monotonic() < end, shown[-300:]
        if select.select([terminal], [], [], 1.0)[0]:
            shown += os.read(terminal, 1000)


def test_a_run_whose_terminal_is_closed_keeps_what_was_computed(tmp_path: Path) -> None:
    terminal, inner = pty.openpty()
    command = [sys.executable, "-c", OF_TERMINAL, *RUN[1:], "--duration", "300", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stdin=inner, stdout=inner, stderr=inner, start_new_session=True)
    os.close(inner)
    wait_for_first_arm(terminal)
    os.close(terminal)
    assert process.wait(120.0) == 130
    said = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert said["complete"] is False
    assert next(iter(said["runs"])) == "learning"
    assert 0.0 < said["duration_run"] < 300.1  # rounded up to a whole sample


@nightly
def test_a_run_under_nohup_goes_on_when_its_terminal_is_closed(tmp_path: Path) -> None:
    terminal, inner = pty.openpty()
    command = [*RUN, "--duration", "0.2", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stdin=inner, stdout=inner, stderr=inner)
    os.close(inner)
    wait_for_first_arm(terminal)
    os.close(terminal)  # it is no controlling one, so that no signal comes
    assert process.wait(120.0) in (0, 3)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["complete"] is True


@nightly
def test_a_run_under_nohup_goes_on(tmp_path: Path) -> None:
    command = [*RUN, "--duration", "0.2", "--out", str(tmp_path / "out")]
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does; inherited
    try:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    finally:
        signal.signal(signal.SIGHUP, before)
    while process.poll() is None:
        process.send_signal(signal.SIGHUP)
        time.sleep(0.2)
    shown = process.communicate()[0]
    assert process.returncode in (0, 3), shown
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["complete"] is True
