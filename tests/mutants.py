"""Mutation score of `identifiability/`, `dynamics/` and `control/`: `make mutants`, or

    python tests/mutants.py [--count 400] [--seed 0] [--budget 20] [--only NUMBER ...] [--list]

A mutant is one small change of the code: another operator, comparison, number or sign, or a check left out. It dies when
a test fails. A first run of the tests tells which functions each test enters and how long it takes; a mutant then meets
only tests that enter its function, quickest first, until one fails or `budget` seconds of them have passed. A sample is
drawn by seed among all mutants, and results are appended to `build/mutants/`, so that a run that was cut short goes on.

Tests run in a fork of a process that has imported what is slow to import, and the changed module is compiled in memory:
no file is changed. Tests that start processes of their own meet the code as it is, and kill nothing.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import hashlib
import importlib.machinery
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import pytest
from hypothesis import Phase, settings

ROOT = Path(__file__).parent.parent
PACKAGES = ("identifiability", "dynamics", "control")
BUILD = ROOT / "build" / "mutants"
ELSEWHERE = (
    *("benchmarks", "cli", "command", "compilation", "documented", "elementary", "env", "experiment", "export", "figures"),
    *("files", "floats", "folders", "fuzz", "graph", "identification", "kernels", "layers", "learner", "light_core"),
    *("live", "long_runs", "notebook", "object_cache", "own_", "packaging", "processor", "public", "real_plant"),
    *("recording", "render", "report", "rollout", "scalars", "sending", "simulate", "sine", "start_up", "stepper"),
    *("sweeps", "terminal", "tuning", "verdict", "visuals", "watch"),
)
"""Parts of names of test files that are about other folders, or start processes of their own."""
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}


@dataclass(frozen=True)
class Mutant:
    """One change: its file, the number of the changed node in it, the function and the change.

    `again` tells changes of a function apart that read the same.
    """

    path: str
    node: int
    line: int
    function: str
    change: str
    again: int

    @property
    def key(self) -> str:
        """A name that stays when other functions of the file are edited."""
        return f"{self.path}::{self.function} {self.change}" + (f" (again {self.again})" if self.again else "")

    def lot(self, seed: int) -> str:
        """Its lot in a draw: other mutants that come or go change nothing in the order of the rest."""
        return hashlib.sha256(f"{seed} {self.key}".encode()).hexdigest()


def sites(path: str) -> Iterator[Mutant]:
    """Every mutant of a file."""
    tree = ast.parse((ROOT / path).read_text())
    met: Counter[tuple[str, str]] = Counter()
    for number, (node, function) in enumerate(visited(tree)):
        before = ast.unparse(node)
        if mutate(node := copy.deepcopy(node)):
            after = "pass" if isinstance(node, ast.Expr) else ast.unparse(node)
            change = f"{before} -> {after}"
            yield Mutant(path, number, node.lineno, function, change, met[function, change])
            met[function, change] += 1


def visited(node: ast.AST, function: str = "<module>") -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Every expression and statement that may change, and the qualified name of the function it is in."""
    if isinstance(node, ast.expr | ast.stmt):
        yield node, function
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "msg", "bases"):
            continue
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        inner = function
        if isinstance(node, ast.FunctionDef) and name == "body":
            inner = node.name if function == "<module>" else f"{function}.{node.name}"
        elif isinstance(node, ast.ClassDef) and name == "body":
            inner = node.name if function == "<module>" else f"{function}.{node.name}"
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from visited(child, inner)


def mutate(node: ast.AST) -> bool:
    """Change a node; False for one that has no other form."""
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign):
        return exchange(node, "op")
    if isinstance(node, ast.Compare):
        node.ops[0] = OPERATORS[type(node.ops[0])]()
        return True
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        node.op = ast.UAdd() if isinstance(node.op, ast.USub) else ast.Not()
        if isinstance(node.op, ast.Not):
            node.operand = ast.UnaryOp(ast.Not(), node.operand)
        return True
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        node.value = not node.value if isinstance(node.value, bool) else changed(node.value)
        return True
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def changed(number: float) -> float:
    """Another number: one more of a whole one, twice or half of another."""
    return number + 1 if isinstance(number, int) or number == 0 else number * 2


def exchange(node: ast.BinOp | ast.BoolOp | ast.AugAssign, name: str) -> bool:
    """Put the opposite operator in place of a node's own; False where it has none."""
    other = OPERATORS.get(type(getattr(node, name)))
    if other is not None:
        setattr(node, name, other())
    return other is not None


def mutated(mutant: Mutant) -> ast.Module:
    """The module with the change."""
    tree = ast.parse((ROOT / mutant.path).read_text())
    node = next(node for number, (node, _) in enumerate(visited(tree)) if number == mutant.node)
    mutate(node)
    if isinstance(node, ast.Expr):
        node.value = ast.Constant(None)
    return ast.fix_missing_locations(tree)


def test_files() -> list[str]:
    """The test files that are about the mutated folders, and no slow ones of others."""
    names = sorted(path.name for path in (ROOT / "tests").glob("test_*.py"))
    return [f"tests/{name}" for name in names if not any(part in name for part in ELSEWHERE)]


class Recorder:
    """A plugin that appends, for each test, the functions of the package that it enters and its processor time, s."""

    def __init__(self, target: Path) -> None:
        self._target = target
        self._entered: set[tuple[str, str]] = set()
        self._within = str(ROOT / "adaptctl") + os.sep

    def _trace(self, frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        if code.co_filename.startswith(self._within):
            self._entered.add((code.co_filename, code.co_qualname))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Follow one test."""
        self._entered = set()
        begun = time.process_time()
        sys.settrace(self._trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            entered = sorted(
                {f"{Path(path).relative_to(ROOT)}::{name.replace('.<locals>', '')}" for path, name in self._entered}
            )
            row = {"test": item.nodeid, "seconds": time.process_time() - begun, "entered": entered}
            with self._target.open("a") as file:
                file.write(json.dumps(row) + "\n")


class Hurried:
    """A plugin that lets Hypothesis stop at the first failure, without looking for a smaller one."""

    def pytest_sessionstart(self) -> None:
        """Before tests are collected, and after `conftest.py`."""
        settings.register_profile("mutants", deadline=None, database=None, phases=[Phase.explicit, Phase.generate])
        settings.load_profile("mutants")


def record(name: str, limit: float) -> None:
    """Run one test file and record what its tests enter; what has not begun after `limit` s is left out."""
    target = BUILD / "entered" / f"{Path(name).stem}.jsonl"
    digest = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
    done = target.with_suffix(".sha256")
    if done.exists() and done.read_text() == digest:
        return
    target.unlink(missing_ok=True)
    print(f"recording {name}", flush=True)
    with contextlib.suppress(subprocess.TimeoutExpired):
        subprocess.run([sys.executable, __file__, "--record", name, str(target)], cwd=ROOT, timeout=limit, check=False)
    done.write_text(digest)


def tests_by_function() -> dict[str, list[tuple[float, str]]]:
    """For each function, and each file as a whole, the tests that enter it and their processor time."""
    found: dict[str, dict[str, float]] = {}
    for path in sorted((BUILD / "entered").glob("*.jsonl")):
        for line in path.read_text().splitlines():
            row = json.loads(line)
            for function in row["entered"]:
                found.setdefault(function, {})[row["test"]] = row["seconds"]
                found.setdefault(function.partition("::")[0], {})[row["test"]] = row["seconds"]
    return {name: sorted((seconds, test) for test, seconds in tests.items()) for name, tests in found.items()}


def chosen(mutant: Mutant, tests: dict[str, list[tuple[float, str]]], budget: float) -> list[str]:
    """Tests to meet, those of its own test file first, then a quick one of each file in turn, up to `budget` s."""
    concerned = tests.get(f"{mutant.path}::{mutant.function}") or tests.get(mutant.path, [])
    if not mutant.function.rpartition(".")[2][:1].islower() and not mutant.function.rpartition(".")[2].startswith("_"):
        concerned = tests.get(mutant.path, [])  # a class's or a module's own statements run when it is imported
    own = f"tests/test_{Path(mutant.path).stem}.py"
    turns: Counter[str] = Counter()
    ordered = []
    for seconds, test in concerned:
        file = test.partition("::")[0]
        turns[file] += 1
        ordered.append((turns[file] if file != own else 0, seconds, test))
    found, spent = [], 0.0
    for _, seconds, test in sorted(ordered):
        if not found or spent + seconds <= budget:
            found.append(test)
            spent += seconds
    return found


def verdict(mutant: Mutant, tests: list[str], limit: float) -> str:
    """`killed`, `survived`, `too slow` (counted as killed) or `no test`."""
    if not tests:
        return "no test"
    process = os.fork()
    if process == 0:
        os.setpgid(0, 0)
        meet(mutant, tests)
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return "survived" if os.waitstatus_to_exitcode(status) == 0 else "killed"
        time.sleep(0.02)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return "too slow"


def meet(mutant: Mutant, tests: list[str]) -> None:
    """Run tests on a mutant in this process, and leave it with their outcome."""
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    code = 1
    try:
        tree, target = mutated(mutant), str(ROOT / mutant.path)
        original = importlib.machinery.SourceFileLoader.get_code

        def get_code(self: importlib.machinery.SourceFileLoader, name: str) -> object:
            same = os.path.realpath(self.path) == os.path.realpath(target)
            return compile(tree, self.path, "exec") if same else original(self, name)

        importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign,assignment]
        code = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *tests], plugins=[Hurried()]))
    finally:
        os._exit(code)


def warm() -> None:
    """Import what is slow to import and is none of ours."""
    for name in ("scipy.linalg", "scipy.optimize", "scipy.integrate", "llvmlite.binding", "pinocchio", "control"):
        __import__(name)


def main() -> None:
    """Draw mutants, run them, and say how many died and which did not."""
    parser = argparse.ArgumentParser(description="Mutation score of a sample of mutants.")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--budget", type=float, default=20.0, help="seconds of tests that a mutant meets at most")
    parser.add_argument("--list", action="store_true", help="list the sample, and run nothing")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the sample to run, anew")
    parser.add_argument("--record", nargs=2, metavar=("FILE", "TARGET"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    os.chdir(ROOT)
    if asked.record:
        sys.exit(pytest.main(["-q", "-p", "no:xdist", asked.record[0]], plugins=[Recorder(Path(asked.record[1])), Hurried()]))
    paths = sorted(
        str(path.relative_to(ROOT)) for package in PACKAGES for path in (ROOT / "adaptctl" / package).rglob("*.py")
    )
    everything = [mutant for path in paths for mutant in sites(path)]
    sample = sorted(everything, key=lambda mutant: mutant.lot(asked.seed))[: asked.count]
    print(f"{len(sample)} of {len(everything)} mutants, seed {asked.seed}", flush=True)
    if asked.list:
        print("\n".join(f"{number} {mutant.path}:{mutant.line} {mutant.key}" for number, mutant in enumerate(sample)))
        return
    (BUILD / "entered").mkdir(parents=True, exist_ok=True)
    os.environ["ADAPTCTL_CACHE"] = str(BUILD / "cache")
    for name in test_files():
        record(name, 120)
    results = BUILD / f"seed{asked.seed}.json"
    known: dict[str, str] = json.loads(results.read_text()) if results.exists() else {}
    tests = tests_by_function()
    warm()
    for number, mutant in enumerate(sample):
        if asked.only is not None and number not in asked.only or asked.only is None and mutant.key in known:
            continue
        met = chosen(mutant, tests, asked.budget)
        known[mutant.key] = verdict(mutant, met, 3 * asked.budget)
        print(f"{number} {known[mutant.key]} ({len(met)} tests) line {mutant.line} {mutant.key}", flush=True)
        results.write_text(json.dumps(known, indent=1))
    counts = Counter(known[mutant.key] for mutant in sample if mutant.key in known)
    died = counts["killed"] + counts["too slow"]
    print(f"{died} of {counts.total()} died: {dict(counts)}")


if __name__ == "__main__":
    main()
