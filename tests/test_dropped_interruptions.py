"""An interruption that native code or a destructor drops is sent again: no command goes on with what is half done."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from nightly import mostly_at_night

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
