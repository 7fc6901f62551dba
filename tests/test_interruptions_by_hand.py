"""When a signal interrupts a command, when it waits for an import, and what it does to a terminal that is gone."""

from __future__ import annotations

import os
import signal
import stat
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from adaptctl.cli import interruption
from adaptctl.cli.interruption import (
    IMPORTING,
    SIGNALS,
    Interruption,
    _importing,
    _leave_terminal,
    _send_again,
    not_ignored,
    raised,
)


def frame(file: str, caller: Any = None) -> Any:
    return SimpleNamespace(f_code=SimpleNamespace(co_filename=file), f_back=caller)


OWN = frame("own.py")
IMPORT = frame(IMPORTING, OWN)
MODULE = frame("module.py", IMPORT)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Signals that are sent again."""
    numbers = list[int]()
    monkeypatch.setattr(interruption, "_send_again", numbers.append)
    monkeypatch.setattr(interruption, "_since", {})
    return numbers


@pytest.mark.parametrize(
    ("where", "seconds"), [(None, 0.0), (OWN, 0.0), (MODULE, 3.0), (frame("called.py", MODULE), 3.0), (IMPORT, None)]
)
def test_an_import_is_given_three_seconds_and_pythons_own_code_all_it_needs(
    where: Any, seconds: float | None, sent: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [8.0]
    monkeypatch.setattr(interruption, "time", SimpleNamespace(monotonic=lambda: now[0]))
    for passed in (0.0, 2.75, 3.0, 60.0):
        now[0] = 8.0 + passed
        if seconds is not None and passed >= seconds:
            with pytest.raises(KeyboardInterrupt):
                raised(signal.SIGTERM, where)
            assert interruption._since == {}  # the next one waits anew
            break
        raised(signal.SIGTERM, where)
    assert sent == [signal.SIGTERM] * (4 if seconds is None else 2 * bool(seconds))


def test_code_is_importing_below_an_import_alone() -> None:
    assert [_importing(one) for one in (None, OWN, IMPORT, MODULE)] == [False, False, True, True]


@pytest.mark.parametrize("number", SIGNALS)
def test_a_terminal_is_left_where_it_hangs_up(
    number: signal.Signals, sent: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    left = list[bool]()
    monkeypatch.setattr(interruption, "_leave_terminal", lambda: left.append(True))
    with pytest.raises(KeyboardInterrupt):
        raised(number, OWN)
    assert left == [True] * (number == signal.SIGHUP)
    assert sent == []


def test_results_are_written_once_a_signal_came_and_left_at_the_next(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    left = list[bool]()
    monkeypatch.setattr(interruption, "_leave_terminal", lambda: left.append(True))
    one = Interruption()
    assert not one.asked
    one.hold()
    one.interrupt(signal.SIGHUP, OWN)  # shells send two: neither counts
    one.interrupt(signal.SIGHUP, OWN)
    assert (one.asked, left, capfd.readouterr().err) == (True, [True, True], "")
    one.interrupt(signal.SIGINT, OWN)
    assert "once more" in capfd.readouterr().err
    with pytest.raises(KeyboardInterrupt):
        one.interrupt(signal.SIGINT, OWN)


def test_a_hangup_that_is_ignored_is_left_alone() -> None:
    before = signal.getsignal(signal.SIGHUP)
    try:
        for handler, heard in ((signal.SIG_IGN, {signal.SIGINT, signal.SIGTERM}), (signal.SIG_DFL, set(SIGNALS))):
            signal.signal(signal.SIGHUP, handler)
            assert set(not_ignored()) == heard
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_signal_that_is_sent_again_comes_to_the_main_thread() -> None:
    came, threads = threading.Event(), list[threading.Thread]()

    def heard(*_: object) -> None:
        threads.append(threading.current_thread())
        came.set()

    before = signal.signal(signal.SIGUSR1, heard)
    try:
        _send_again(signal.SIGUSR1)
        assert came.wait(10.0)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert threads == [threading.main_thread()]


@pytest.mark.parametrize(
    ("kind", "terminal", "gone"),
    [(stat.S_IFCHR, False, True), (stat.S_IFCHR, True, False), (stat.S_IFIFO, False, False)],
)
def test_output_to_a_terminal_that_is_gone_goes_nowhere(
    kind: int, terminal: bool, gone: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pipes and files go on, and every copy that was opened is closed."""
    opened, closed, moved = list[int](), list[int](), list[tuple[int, int]]()

    def opening(path: str, flags: int) -> int:
        assert (path, flags) == (os.devnull, os.O_WRONLY)
        opened.append(90 + len(opened))
        return opened[-1]

    system = SimpleNamespace(
        fstat=lambda stream: SimpleNamespace(st_mode=kind), isatty=lambda stream: terminal, open=opening,
        dup2=lambda *pair: moved.append(pair), close=closed.append, devnull=os.devnull, O_WRONLY=os.O_WRONLY,
    )  # fmt: skip
    monkeypatch.setattr(interruption, "os", system)
    before = signal.getsignal(signal.SIGHUP)
    try:
        _leave_terminal()
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert moved == [(90, 1), (91, 2)] * gone
    assert closed == opened
