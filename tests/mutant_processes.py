"""Test files run by processes of their own, on modules that were changed in memory."""

from __future__ import annotations

import ast
import marshal
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from changed_module.changed import ROOT, change_modules
from hypothesis import Phase, settings

CHILDREN = ROOT / "tests" / "changed_module"
"""On the path of processes that tests start: what changes modules there"""
PYTEST = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore::pytest.PytestAssertRewriteWarning")


class Hurried:
    """A plugin that lets Hypothesis draw few examples, and stop at a failure without looking for a smaller one."""

    def pytest_sessionstart(self) -> None:
        """Before tests are collected, and after `conftest.py`."""
        phases = [Phase.explicit, Phase.generate]
        settings.register_profile("mutants", deadline=None, database=None, derandomize=True, phases=phases)
        settings.register_profile("mutants", settings.get_profile("mutants"), max_examples=10)
        settings.load_profile("mutants")


class Only:
    """A plugin that leaves out all tests but some, and writes the name of the one that fails into a file."""

    def __init__(self, cases: Iterable[str], failed: Path) -> None:
        self._places = {case: place for place, case in enumerate(cases)}
        self._failed = failed

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Leave out the others, and keep the order of these."""
        items[:] = [item for item in items if item.nodeid in self._places]
        items.sort(key=lambda item: self._places[item.nodeid])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Write the name of the test that begins: the last one is the one that fails."""
        self._failed.write_text(nodeid)


def first_and_last(items: Iterable[pytest.Item]) -> list[pytest.Item]:
    """Of each test with parameters, the first case and the last."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    return [item for case in cases.values() for item in (case[:1] + case[1:][-1:])]


def run(test_files: Iterable[str], plugins: list[object], folder: str) -> int:
    """Exit code of pytest on test files, in this process.

    What the library keeps from one process to the next, and what a change writes at home, is kept in a folder of this
    version of the code alone.
    """
    for name in [name for name in os.environ if name.startswith("XDG_")]:
        del os.environ[name]
    os.environ["HOME"] = folder
    os.environ["PYTHONPATH"] = os.pathsep.join([str(CHILDREN), *filter(None, [os.environ.get("PYTHONPATH")])])
    os.environ["ADAPTCTL_CACHE"] = f"{folder}/cache"
    change_modules()
    return int(pytest.main([*PYTEST, *test_files], plugins=[Hurried(), *plugins]))


def run_changed(test_files: Iterable[str], target: Path, tree: ast.Module, plugins: list[object], folder: str) -> int:
    """Exit code of pytest on test files, where one module is changed, in processes that tests start as well."""
    code = Path(folder, "changed")
    code.write_bytes(marshal.dumps(compile(tree, str(target), "exec")))
    os.environ["CHANGED_MODULE"] = f"{target}{os.pathsep}{code}"
    return run(test_files, plugins, folder)


def run_followed(name: str, plugin: object, reports: Path, folder: str) -> int:
    """Exit code of pytest on a test file, where the functions that it enters are written into a file."""
    os.environ["ENTERED_BY_TEST"] = str(reports)
    return run([name], [plugin], folder)


def forked(run: Callable[[], int], limit: int) -> int | None:
    """What a function returns that runs silently in a process of its own; None where it takes longer than `limit` s of
    the processor, or four times as long on the clock."""
    process = os.fork()
    if process == 0:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        code = 1
        try:
            code = int(run())
        finally:
            os._exit(code)
    end = time.monotonic() + 4 * limit
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            slow = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL)
            return None if slow else os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def warm() -> None:
    """Import what is slow to import and is not mutated."""
    for name in ("scipy.linalg", "scipy.optimize", "scipy.integrate", "scipy.signal", "llvmlite.binding", "pinocchio"):
        __import__(name)
    for name in ("control", "msgspec", "hypothesis.strategies", "gymnasium", "mujoco", "matplotlib.figure", "rerun"):
        __import__(name)
    assert not [name for name in sys.modules if name.partition(".")[0] == "adaptctl"]
