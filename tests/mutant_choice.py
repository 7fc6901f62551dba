"""Test files that a mutant meets: those that enter its function, by themselves, their fixtures or what they keep.

A test that finds a mechanism built by an earlier one never enters what built it, though it depends on it. So functions
are recorded for each file as a whole, in a process of its own, and what the file's first test enters is the file's.
"""

from __future__ import annotations

import builtins
import hashlib
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from mutant_processes import ROOT, first_and_last, forked, run_followed
from mutant_sites import Mutant

RECORDED = ROOT / "build" / "mutants" / "entered"
ELSEWHERE = ("benchmarks", "docstring", "layers", "light_core", "mutants", "notebook", "packaging", "public_api")
"""Parts of names of test files that read the code, or take long to start processes of their own."""
KEPT = (
    "tests/test_golden.py::test_public_names_are_those_kept",
    "tests/test_golden.py::test_defaults_and_bounds_of_settings_are_those_kept",
    "tests/test_golden.py::test_help_is_the_one_kept",
    "tests/test_documented_limits.py::test_stated_limits_are_those_of_the_code",
    "tests/test_defaults.py::test_what_is_left_out_is_what_the_docstring_states",
)
"""They compare what modules and classes say of themselves, and enter no function of theirs for that."""
PICTURES = "tests/test_golden.py::test_figures_and_recordings_show_what_is_kept"
"""It compares all that is drawn, which most changes of what it enters change, within moments."""
NUMBERS = "tests/test_kept_numbers.py"
"""It compares numbers of all laws and rules, which most changes of what it enters change, within moments."""
START = 0.3
"""Seconds of the processor that a test file takes beside its tests"""
SHARE = 0.2
"""Share of a mutant's time that one test file has before all others had theirs"""


@dataclass(frozen=True)
class Recorded:
    """A test file: the functions that it enters when it is collected and its tests run, and those of its cases."""

    name: str
    entered: frozenset[str]
    cases: dict[str, tuple[float, frozenset[str]]]
    """Seconds and functions of each case, by its name"""
    ends: frozenset[str]
    """The first and the last case of each test"""

    @classmethod
    def read(cls, path: Path) -> Recorded:
        """A record of `Recorder`."""
        collected, *rows = [json.loads(line) for line in path.read_text().splitlines()]
        cases = {row["test"]: (row["seconds"], frozenset(row["entered"])) for row in rows}
        everything = frozenset(collected["entered"]).union(*(entered for _, entered in cases.values()))
        return cls(collected["file"], everything, cases, frozenset(collected["ends"]))

    def concerned(self, code: frozenset[str]) -> list[str]:
        """Cases that enter one of some functions, quick ones first; then the first and the last case of each other
        test, which may depend on them by what the file keeps."""
        enter = [case for case, (_, entered) in self.cases.items() if entered & code]
        others = [case for case in self.cases if case in self.ends and case not in set(enter)]
        return sorted(enter, key=lambda case: self.cases[case][0]) + others

    def tells(self, case: str, code: frozenset[str]) -> bool:
        """True for a case of this file that compares what modules say, or that enters one of some functions."""
        return case in self.cases and (case in KEPT or bool(self.cases[case][1] & code))

    def seconds(self, cases: list[str]) -> float:
        """Processor time of some cases, s."""
        return START + sum(self.cases[case][0] for case in cases)


class Recorder:
    """A plugin that writes the functions that a test file enters, and the seconds of its cases.

    The first and the last case of each test run first; after `limit` s of the processor the rest is left out.
    """

    def __init__(self, name: str, target: Path, limit: float) -> None:
        self._name, self._target, self._limit = name, target, limit
        self.reports = target.with_suffix(".entered")

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Have the first and the last case of each test run first."""
        ends = [item.nodeid for item in first_and_last(items)]
        items.sort(key=lambda item: item.nodeid not in set(ends))
        self._write({"file": self._name, "entered": self._reported(), "ends": ends})

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Follow one test."""
        if _spent() > self._limit:
            pytest.exit("enough is recorded", returncode=0)
        self._reported()
        started = _spent()
        try:
            return (yield)
        finally:
            seconds = _spent() - started
            self._write({"test": item.nodeid, "seconds": seconds, "entered": self._reported()})

    def _reported(self) -> list[str]:
        """What was entered since the last time, by processes that tests start as well."""
        names = sorted(set(self.reports.read_text().split("\n")) - {""})
        os.truncate(self.reports, 0)
        builtins.__dict__["entered_by_test"].clear()
        return names

    def _write(self, row: object) -> None:
        with self._target.open("a") as file:
            file.write(json.dumps(row) + "\n")


def _spent() -> float:
    """Processor time of this process and of those that it started and that ended, s."""
    return sum(os.times()[:4])


def folder_of(path: str) -> str | None:
    """The folder that a module's mutants are counted under; None outside the package."""
    first, *rest = Path(path).parts
    if first in ("envs", "experiments"):
        return first
    return None if first != "adaptctl" else rest[0] if len(rest) > 1 else "adaptctl"


def test_files() -> list[str]:
    """The test files that import something of the library or compare what it says, and run in one process."""
    found = sorted((ROOT / "tests").glob("test_*.py"))
    here = [path for path in found if not any(part in path.name for part in ELSEWHERE)]
    known = {case.partition("::")[0] for case in KEPT}
    names = {f"tests/{path.name}": path for path in here}
    return [name for name, path in names.items() if name in known or "adaptctl" in path.read_text()]


def record(name: str, limit: int) -> None:
    """Record a test file for about `limit` s, unless that was done; one that fails without a mutant is left out."""
    target = RECORDED / f"{Path(name).stem}.jsonl"
    digest = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
    done = target.with_suffix(".sha256")
    if done.exists() and done.read_text() == digest:
        return
    RECORDED.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    recorder = Recorder(name, target, limit)
    with TemporaryDirectory() as folder:
        code = forked(partial(run_followed, name, recorder, recorder.reports, folder), 5 * limit)
    remark = "" if code == 0 else ": left out, it fails or takes too long without a mutant"
    print(f"recorded {name}{remark}", flush=True)
    if code != 0:
        target.unlink(missing_ok=True)
    done.write_text(digest)


def recorded() -> list[Recorded]:
    """All test files that were recorded."""
    return [Recorded.read(path) for path in sorted(RECORDED.glob("*.jsonl"))]


def chosen(mutant: Mutant, files: list[Recorded], budget: float) -> list[tuple[Recorded, list[str]]]:
    """Test files that a mutant meets, and their cases, until `budget` s are taken: those that compare what modules say
    or what is drawn, if it is of that; its own file, then those that name its class or function, those that import its
    module, those that import of its folder, and the rest; of these quick ones first that enter little else. Cases that
    a file's share has no time for come after all other files."""
    code = concerning(mutant, files)
    kept = KEPT if f"{mutant.path}::{mutant.function}" not in code else (PICTURES,)
    about = [file for file in files if file.entered & code or names(file, mutant)]
    concerned = [(file, file.concerned(code)) for file in about]
    concerned.sort(key=lambda pair: (*distance(pair[0], mutant), pair[0].seconds(pair[1]) * len(pair[0].entered)))
    first = [(file, within(file, cases, SHARE * budget)) for file, cases in concerned]
    later = [(file, cases[len(known) :]) for (file, cases), (_, known) in zip(concerned, first, strict=True)]
    found = [(file, own) for file in files if (own := [case for case in kept if file.tells(case, code)])]
    left = budget - sum(file.seconds(cases) for file, cases in found)
    for file, cases in first + later:
        if left > 0.0 and (met := within(file, cases, left)):
            found.append((file, met))
            left -= file.seconds(met)
    return found


def concerning(mutant: Mutant, files: list[Recorded]) -> frozenset[str]:
    """The mutant's function where a test enters it; else all functions of its module that tests enter: statements of
    modules and classes run at the import, for all of them. Else those of its folder: processes that tests start may."""
    everything: frozenset[str] = frozenset().union(*(file.entered for file in files))
    own = frozenset({f"{mutant.path}::{mutant.function}"}) & everything
    module, folder = (
        frozenset(name for name in everything if name.startswith(place))
        for place in (f"{mutant.path}::", f"{Path(mutant.path).parent}/")
    )
    return own or module or folder


def within(file: Recorded, cases: list[str], seconds: float) -> list[str]:
    """The first of some cases that take no more than some seconds together; one where it alone takes more."""
    taken = list(accumulate(file.cases[case][0] for case in cases))
    return [case for case, until in zip(cases, taken, strict=True) if until <= max(seconds, taken[0])]


def names(file: Recorded, mutant: Mutant) -> bool:
    """True for a test file that names a mutant's module, which processes that it starts may import."""
    return not distance(file, mutant)[2]


def distance(file: Recorded, mutant: Mutant) -> tuple[bool, ...]:
    """Signs, the most telling first, that a test file is not about a mutant."""
    text, module = (ROOT / file.name).read_text(), Path(mutant.path).with_suffix("")
    names = [part for part in mutant.function.split(".") if not part.startswith(("<", "__"))]
    named = file.name == NUMBERS or any(re.search(rf"\b{name}\b", text) for name in names)
    imported = (".".join(place.parts) in text for place in (module, module.parent))
    return file.name != f"tests/test_{module.name}.py", not named, *(not known for known in imported)
