"""Compilation that takes long is shown among bars of progress."""

from __future__ import annotations

import time
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from adaptctl.cli import compiling
from adaptctl.cli.compiling import Announcement
from adaptctl.compilation import compile_function
from adaptctl.stages import COMPILING, stage, watching


def announced(monkeypatch: pytest.MonkeyPatch, patience: float, *seconds: float) -> list[str]:
    """What an announcement does in compilations of some seconds each."""
    monkeypatch.setattr(compiling, "PATIENCE", patience)
    told: list[str] = []
    announcement = Announcement(lambda: told.append("shown"), lambda: told.append("hidden"))
    with watching(announcement):
        for each in seconds:
            with stage(COMPILING):
                time.sleep(each)
                told.append("compiled")
    return told


def test_it_is_shown_from_the_first_second_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    assert announced(monkeypatch, 0.5, 0.01) == ["compiled"]
    assert announced(monkeypatch, 0.05, 0.3) == ["shown", "compiled", "hidden"]
    assert announced(monkeypatch, 0.0, 0.2, 0.2) == 2 * ["shown", "compiled", "hidden"]


def test_what_compilations_took_is_taken_off_the_second(monkeypatch: pytest.MonkeyPatch) -> None:
    times, waits = iter((5.0, 5.25, 7.0, 8.5, 9.0, 9.5)), list[float]()
    monkeypatch.setattr(compiling, "perf_counter", lambda: next(times))
    monkeypatch.setattr(compiling, "Timer", lambda wait, act: MagicMock(start=lambda: waits.append(wait)))
    announcement = Announcement(lambda: None, lambda: None)
    for _ in range(3):
        with announcement(COMPILING):
            pass
    assert waits == [1.0, 0.75, 0.0]


def test_another_stage_is_not_taken_for_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    told: list[str] = []
    with watching(Announcement(lambda: told.append("shown"), lambda: told.append("hidden"))), stage("fitting"):
        time.sleep(0.2)
    assert told == []


def test_what_fails_hides_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    told: list[str] = []
    announcement = Announcement(lambda: told.append("s"), lambda: told.append("h"))

    def interrupted() -> None:
        with announcement(COMPILING):
            time.sleep(0.2)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert told == ["s", "h"]


def test_compilation_is_what_is_watched(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ADAPTCTL_CACHE", str(tmp_path))
    monkeypatch.setattr(compiling, "PATIENCE", -1.0)
    told: list[str] = []
    with watching(Announcement(lambda: told.append("shown"), lambda: told.append("hidden"))):
        for _ in range(2):  # the second is found in the cache
            assert compile_function(lambda x: 3.0 * x[0], {"x": 1}, name="tripled")([2.0]) == 6.0
    assert told in (["shown", "hidden"], [])  # it may be over before the timer's thread begins
