"""Garbage of a command: looked for seldom, and never as the process ends."""

from __future__ import annotations

import gc
import subprocess
import sys

from adaptctl.cli.memory import COLLECTED_AFTER, collecting_seldom
from adaptctl.hardware.timing import without_collections

SCRIPT = """
import atexit, gc
atexit.register(lambda: print(gc.get_freeze_count() > 10_000))  # runs after what is registered later
from adaptctl.cli.main import main
before = gc.get_threshold()
main(["--version"])
print(gc.get_threshold() == before)
"""


def test_thresholds_are_raised_within_a_command_alone() -> None:
    now = gc.get_threshold()
    try:
        for few, within in ((700, COLLECTED_AFTER), (10 * COLLECTED_AFTER, 10 * COLLECTED_AFTER)):
            gc.set_threshold(few, 10, 10)
            with collecting_seldom():
                assert gc.get_threshold() == (within, 10, 10)
            assert gc.get_threshold() == (few, 10, 10)
    finally:
        gc.set_threshold(*now)


def test_a_process_ends_without_a_last_search() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout.split()[2:] == ["True", "True"]


def test_a_loop_is_not_stopped_to_collect_and_leaves_it_as_it_was() -> None:
    was = gc.isenabled()
    try:
        for switch, on in ((gc.enable, True), (gc.disable, False)):
            switch()
            with without_collections():
                assert not gc.isenabled()
            assert gc.isenabled() == on
    finally:
        gc.enable() if was else gc.disable()
