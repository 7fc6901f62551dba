"""The command's process: what it sets, which signals it takes when, and the code with which it ends."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from adaptctl import __main__ as entry

SETTINGS = {"OPENBLAS_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system", "MIMALLOC_PURGE_DELAY": "0"}


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What a process does to the rest of the system, in order; its end is `SystemExit`."""
    told: list[Any] = []
    for name in ("keep_without_terminal", "repeated_where_lost"):
        monkeypatch.setattr(entry, name, lambda name=name: told.append(name))
    beat = SimpleNamespace(start=lambda: told.append("start"), stop=lambda: told.append("stop"))
    monkeypatch.setattr(entry, "heartbeat", beat)
    monkeypatch.setattr(entry, "not_ignored", lambda: (signal.SIGTERM,))
    monkeypatch.setattr(entry.signal, "signal", lambda number, handler: told.append((number, handler)))
    monkeypatch.setattr(entry.gc, "set_threshold", lambda *counts: told.append(counts[0] > gc.get_threshold()[0]))
    monkeypatch.setattr(entry.atexit, "_run_exitfuncs", lambda: told.append("closed"))
    monkeypatch.setattr(entry.os, "_exit", sys.exit)
    for name in SETTINGS:
        monkeypatch.setenv(name, "")  # so that it is as before again
        monkeypatch.delenv(name)
    return told


def interrupted() -> int:
    raise KeyboardInterrupt


@pytest.mark.parametrize(("main", "code"), [(lambda: 3, 3), (interrupted, 130)])
def test_a_command_takes_signals_from_its_start_to_its_end(
    main: Callable[[], int], code: int, told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entry, "_main", lambda: main)
    monkeypatch.setenv("MIMALLOC_PURGE_DELAY", "7")
    with pytest.raises(SystemExit) as ended:
        entry.run()
    assert ended.value.code == code
    on = [(signal.SIGTERM, handler) for handler in (entry._leave, entry.raised, signal.SIG_IGN)]
    begun = [on[0], True, "keep_without_terminal", "start"]
    assert told == [*begun, "repeated_where_lost", on[1], on[2], "stop", "closed"]
    assert {name: os.environ[name] for name in SETTINGS} == {**SETTINGS, "MIMALLOC_PURGE_DELAY": "7"}


def test_a_command_that_is_interrupted_while_it_starts_says_so(
    told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entry.os, "write", lambda *what: told.append(what))
    with pytest.raises(SystemExit) as ended:
        entry._leave(signal.SIGINT, None)
    assert (ended.value.code, told) == (130, ["stop", (2, b"adaptctl: interrupted\n")])


def test_what_is_left_is_printed_at_the_end_unless_nobody_reads_it(
    told: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone() -> None:
        raise BrokenPipeError

    monkeypatch.setattr(sys, "stdout", SimpleNamespace(flush=gone))
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(flush=lambda: told.append("flushed")))
    with pytest.raises(SystemExit):
        entry._exit_at_once(0)
    assert told == ["closed", "flushed"]
