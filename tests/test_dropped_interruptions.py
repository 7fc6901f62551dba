"""An interruption that native code or a destructor drops is sent again: no command goes on with what is half done."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from nightly import mostly_at_night

from adaptctl.cli import interruption

START = """
import signal, sys, time
from signals import signalled
from adaptctl.cli.interruption import raised, repeated_where_lost
repeated_where_lost()
signal.signal(signal.SIGINT, raised)
"""
TABLES = """
from scipy.stats import qmc
with signalled("read_array", signal.SIGINT):  # of its tables, in a function that drops exceptions
    qmc.Sobol(3, rng=0).random(4)
    time.sleep(5.0)
"""
DESTRUCTOR = """
class Ending:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.01)
Ending()
time.sleep(5.0)
"""
OTHERS = """
class Ending:
    def __del__(self):
        raise ValueError("told as ever")
Ending()
raise RuntimeError("and this")
"""


def ran(code: str) -> subprocess.CompletedProcess[str]:
    lines = "\n".join(f"    {line}" for line in code.strip().splitlines())
    caught = f"\ntry:\n{lines}\nexcept KeyboardInterrupt:\n    print('heard')\nelse:\n    print('lost')\n"
    home = Path(__file__).parent
    path = f"import sys; sys.path[:0] = [{str(home)!r}, {str(home.parent)!r}]\n"
    return subprocess.run([sys.executable, "-c", path + START + caught], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("code", mostly_at_night([TABLES, DESTRUCTOR], DESTRUCTOR))
def test_a_dropped_interruption_is_heard(code: str) -> None:
    done = ran(code)
    assert (done.stdout, done.stderr, done.returncode) == ("heard\n", "", 0)


def test_other_errors_are_told_as_ever() -> None:
    done = ran(OTHERS)
    assert "ValueError: told as ever" in done.stderr
    assert "RuntimeError: and this" in done.stderr
    assert done.returncode == 1


def test_what_is_dropped_is_told_as_ever_or_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    told, sent = list[Any](), list[int]()
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    monkeypatch.setattr(sys, "excepthook", lambda *what: told.append(what))
    monkeypatch.setattr(interruption, "_send_again", sent.append)
    interruption.repeated_where_lost()
    others: Any = SimpleNamespace(exc_type=ValueError)
    ctrl_c: Any = SimpleNamespace(exc_type=KeyboardInterrupt)
    sys.unraisablehook(others)
    sys.unraisablehook(ctrl_c)
    elsewhere = threading.Thread(target=sys.unraisablehook, args=(ctrl_c,))
    elsewhere.start()
    elsewhere.join()
    error = ValueError()
    sys.excepthook(ValueError, error, None)
    sys.excepthook(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert told == [others, (ValueError, error, None)]
    assert sent == [signal.SIGINT]  # which arrives in the main thread alone
