"""Commands say what they compute where they print nothing for a second: a line that goes, on terminals."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from adaptctl.cli import heartbeat as module

BEGIN = """
import sys, time
from adaptctl.cli import heartbeat as module
from adaptctl.cli.interruption import keep_without_terminal
module.PATIENCE, module.REDRAWN = 0.2, 10.0
keep_without_terminal()
beat = module.heartbeat
beat.start()
"""
WORK = "beat.doing('gains'); time.sleep(0.4); print('result'); time.sleep(0.1); beat.stop()"
OPEN_LINE = "print('Start? [y/N] ', end='', flush=True); time.sleep(0.5); print('y'); beat.stop()"
COMPILED = """
from adaptctl.stages import stage, watching
with watching(beat.during), stage("compiling to native code, which the next run finds in the cache"):
    time.sleep(0.5)
beat.stop()
"""


def seen(program: str) -> str:
    """What a terminal gets of a program."""
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", BEGIN + program], stdout=theirs, stderr=theirs, stdin=theirs
    ) as process:
        os.close(theirs)
        shown = b""
        while part := _read(ours):
            shown += part
        assert process.wait(30) == 0
    os.close(ours)
    return shown.decode().replace("\r\n", "\n")


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 1024)
    except OSError:  # Linux's end of a terminal
        return b""


@pytest.fixture(autouse=True)
def _shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ADAPTCTL_PROGRESS")


def test_a_line_goes_before_what_is_printed() -> None:
    assert seen(WORK) == "\r\x1b[Kadaptctl: gains, 0 s\r\x1b[Kresult\n"


def test_a_second_without_output_is_told_within_it() -> None:
    """It is looked four times within the patience."""
    assert 0.5 < 1.25 * module.PATIENCE <= 1.0


def test_a_question_stays_as_it_is() -> None:
    assert seen(OPEN_LINE) == "Start? [y/N] y\n"


def test_compilation_is_named_and_no_line_is_longer_than_the_terminal() -> None:
    shown = seen(COMPILED)
    assert "compiling to native code" in shown
    assert max(map(len, shown.replace("\x1b[K", "").split("\r"))) < 80
    assert shown.endswith("\r\x1b[K")


def test_a_terminal_that_does_not_tell_its_width_has_80_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    def untold(stream: int) -> os.terminal_size:
        raise OSError

    for width in (untold, lambda stream: os.terminal_size((0, 0))):
        monkeypatch.setattr(os, "get_terminal_size", width)
        assert module._columns() == 80


def piped(program: str) -> tuple[str, list[str]]:
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + program], capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout, done.stderr.splitlines()


def test_elsewhere_lines_follow() -> None:
    out, lines = piped("beat.doing('gains'); time.sleep(1.0); print('result'); beat.stop()")
    assert out == "result\n"
    assert set(lines) <= {"adaptctl: gains, 0 s", "adaptctl: gains, 1 s"}
    assert 3 <= len(lines) <= 8


def test_it_can_be_turned_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_PROGRESS", "off")
    assert piped(WORK) == ("result\n", [])
    assert seen(WORK) == "result\n"


def test_a_command_shows_it(tmp_path: Path) -> None:
    program = "import sys; from adaptctl.cli import heartbeat as m; m.PATIENCE = 0.01; "
    program += "from adaptctl.__main__ import run; run()"
    command = [sys.executable, "-c", program, "basis", "two_link"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "adaptctl: starting, 0 s" in done.stderr.splitlines()
    assert done.stdout.startswith("two_link")


def test_its_thread_ends_when_it_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.001)
    beat, before = module.Heartbeat(), set(threading.enumerate())
    monkeypatch.setattr(beat, "_put", lambda text: None)
    beat.start()
    (thread,) = set(threading.enumerate()) - before
    beat.stop()
    thread.join(10.0)
    assert not thread.is_alive()


def test_a_line_comes_after_a_silence_and_never_into_one_that_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the times of the looks at it: output ends at 0 s, begins a line at 3 s and ends that at 5 s."""
    clock, put = SimpleNamespace(now=0.0), list[tuple[float, str]]()
    monkeypatch.setattr(module, "monotonic", lambda: clock.now)
    beat: Any = module.Heartbeat()
    prints = {3.0: b"\x1b[1mStart?", 5.0: b"y\n"}

    def wait(seconds: float) -> bool:
        clock.now = round(clock.now + seconds, 6)
        for time in [time for time in prints if time <= clock.now]:
            beat.heard(prints.pop(time))
        return bool(clock.now > 7.0)

    beat._stopped, beat._put = (
        SimpleNamespace(wait=wait, is_set=lambda: False),
        lambda text: put.append((clock.now, text)),
    )
    beat._on_terminal()
    lines = [(time, text) for time, text in put if "adaptctl: starting" in text]
    assert lines[0] == (0.8, "\r\x1b[Kadaptctl: starting, 1 s")
    assert [time for time, _ in lines if time < 3.0] == pytest.approx([0.8, 1.3, 1.8, 2.3, 2.8])
    assert next(time for time, text in put if text == "\r\x1b[K") == pytest.approx(3.3)  # before what is printed
    assert not [time for time, _ in lines if 3.0 <= time < 5.8]
    assert [time for time, _ in lines if time >= 5.8]


def test_elsewhere_a_line_comes_every_while_until_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    beat: Any = module.Heartbeat()
    waits, put = list[float](), list[str]()
    beat._stopped = SimpleNamespace(wait=lambda seconds: waits.append(seconds) or len(waits) > 3)
    beat._put = put.append
    beat.doing("gains")
    beat._in_lines()
    assert [line.partition(",")[0] for line in put] == ["adaptctl: gains"] * 3
    assert all(line.endswith(" s\n") for line in put)
    assert 0.5 < min(waits) == max(waits) < 1.0


@pytest.mark.parametrize(
    ("setting", "terminal", "begun"), [("off", True, []), ("", True, ["line"]), ("", False, ["lines"])]
)
def test_signs_of_life_are_for_terminals_and_logs_unless_they_are_off(
    setting: str, terminal: bool, begun: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ADAPTCTL_PROGRESS", setting)
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(isatty=lambda: terminal))
    started, beat = list[str](), module.Heartbeat()
    monkeypatch.setattr(beat, "_on_terminal", lambda: started.append("line"))
    monkeypatch.setattr(beat, "_in_lines", lambda: started.append("lines"))

    def thread(target: Callable[[], None], daemon: bool) -> Any:
        assert daemon  # it ends with the command
        return SimpleNamespace(start=target)

    monkeypatch.setattr(module.threading, "Thread", thread)
    beat.start()
    assert started == begun


@pytest.mark.parametrize(("told", "columns"), [((100, 30), 100), ((0, 0), 80), (None, 80)])
def test_a_terminal_of_no_width_has_eighty_columns(
    told: tuple[int, int] | None, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def size(stream: int) -> os.terminal_size:
        if told is None:
            raise OSError
        return os.terminal_size(told if stream == 2 else (1, 1))

    monkeypatch.setattr(module.os, "get_terminal_size", size)
    assert module._columns() == columns
