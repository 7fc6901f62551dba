"""Mutation score of `identifiability/`, `dynamics/` and `control/`: `make mutants`, or

    python tests/mutants.py [--count 400] [--seed 0] [--budget 20] [--only NUMBER ...] [--list]

A mutant is one small change of the code: another operator, comparison, number or sign, or a check left out. It dies
when a test fails. A first run of the tests tells which functions each test enters and how long it takes; a mutant then
meets
only tests that enter its function, quickest first, until one fails or `budget` seconds of them have passed. A sample is
drawn by seed among all mutants, and results are appended to `build/mutants/`, so that a run that was cut short goes on.

Tests run in a fork of a process that has imported what is slow to import, and the changed module is compiled in memory:
no file is changed. Tests that start processes of their own meet the code as it is, and kill nothing.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import copy
import hashlib
import importlib.machinery
import json
import os
import resource
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType

import pytest
from alike_mutants import ALIKE
from hypothesis import Phase, settings

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("identifiability", "dynamics", "control")
BUILD = ROOT / "build" / "mutants"
ELSEWHERE = ("adaptation_laws", "adaptation_theorems", "benchmarks", "clipped", "command", "documented", "experiment")
ELSEWHERE += (
    "export",
    "long_runs",
    "notebook",
    "own_",
    "packaging",
    "recording",
    "sending",
    "simulate",
    "sweeps",
    "tuning",
)
"""Parts of names of test files that take long, or start processes of their own."""
PYTEST = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore::pytest.PytestAssertRewriteWarning")
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
        if isinstance(node, ast.keyword) and node.arg == "strict":  # a check of what the code itself has made
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        inner = function
        if (isinstance(node, ast.FunctionDef) and name == "body") or (
            isinstance(node, ast.ClassDef) and name == "body"
        ):
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
    """The test files that import something of the mutated folders, or the package itself, but those that take long."""
    found = []
    for path in sorted((ROOT / "tests").glob("test_*.py")):
        text = path.read_text()
        about = "import adaptctl\n" in text or any(f"adaptctl.{package}" in text for package in PACKAGES)
        if about and not any(part in path.name for part in ELSEWHERE):
            found.append(f"tests/{path.name}")
    return found


class Recorder:
    """A plugin that appends, for each test, the functions of the package that it enters and its processor time, s."""

    def __init__(self, target: Path) -> None:
        self._target = target
        self._entered: set[str] = set()
        compile_by(self._reporting)

    def _reporting(self, path: Path) -> ast.Module | None:
        """A module of the mutated folders, each function of which first reports its name."""
        name = str(path.relative_to(ROOT))
        if not name.startswith(tuple(f"adaptctl/{package}/" for package in PACKAGES)):
            return None
        tree = ast.parse(path.read_text())
        builtins.__dict__["entered_by_test"] = self._entered.add
        for node, function in functions(tree):
            report = ast.parse(f"entered_by_test({f'{name}::{function}'!r})").body
            node.body[1 if ast.get_docstring(node) else 0 : 0] = report
        return ast.fix_missing_locations(tree)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Of each test with parameters, keep the first case and the last."""
        cases: dict[str, list[pytest.Item]] = {}
        for item in items:
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
        items[:] = [item for case in cases.values() for item in (case[:1] + case[1:][-1:])]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Follow one test."""
        self._entered.clear()
        begun = time.process_time()
        try:
            return (yield)
        finally:
            seconds = time.process_time() - begun
            row = {"test": item.nodeid, "seconds": seconds, "entered": sorted(self._entered)}
            with self._target.open("a") as file:
                file.write(json.dumps(row) + "\n")


def functions(node: ast.AST, within: str = "") -> Iterator[tuple[ast.FunctionDef, str]]:
    """Every function below a node, and its qualified name."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            name = f"{within}.{child.name}".lstrip(".")
            if isinstance(child, ast.FunctionDef):
                yield child, name
            yield from functions(child, name)
        else:
            yield from functions(child, within)


def compile_by(changed: Callable[[Path], ast.Module | None]) -> None:
    """Let modules that are imported from now on be compiled from the tree that `changed` returns, if it returns one."""
    original = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: importlib.machinery.SourceFileLoader, name: str) -> CodeType | None:
        path = Path(os.path.realpath(self.path))
        tree = changed(path) if path.is_relative_to(ROOT) else None
        return original(self, name) if tree is None else compile(tree, self.path, "exec")

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign,assignment]


class Hurried:
    """A plugin that lets Hypothesis draw few examples, and stop at a failure without looking for a smaller one."""

    def pytest_sessionstart(self) -> None:
        """Before tests are collected, and after `conftest.py`."""
        phases = [Phase.explicit, Phase.generate]
        settings.register_profile("mutants", deadline=None, database=None, phases=phases, max_examples=10)
        settings.load_profile("mutants")


def record(name: str, limit: int) -> None:
    """Run a test file and record what its tests enter; tests not over after `limit` s of the processor are left out."""
    target = BUILD / "entered" / f"{Path(name).stem}.jsonl"
    digest = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
    done = target.with_suffix(".sha256")
    if done.exists() and done.read_text() == digest:
        return
    target.unlink(missing_ok=True)
    print(f"recording {name}", flush=True)
    forked(lambda: pytest.main([*PYTEST[1:], name], plugins=[Recorder(target), Hurried()]), limit, 20 * limit)
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
    """Tests to meet, up to `budget` s: of its own test file and the two that enter it most often, quick ones first."""
    name = mutant.function.rpartition(".")[2].lstrip("_<")
    own_function = tests.get(f"{mutant.path}::{mutant.function}", []) if name[:1].islower() else []
    concerned = own_function or tests.get(mutant.path, [])  # statements of modules and classes run at the import
    counts = Counter(test.partition("::")[0] for _, test in concerned)
    own = f"tests/test_{Path(mutant.path).stem}.py"
    files = sorted(counts, key=lambda file: (file != own, -counts[file]))[:3]
    found, spent = [], 0.0
    for seconds, test in concerned:
        if test.partition("::")[0] in files and (not found or spent + seconds <= budget):
            found.append(test)
            spent += seconds
    return found


def verdict(mutant: Mutant, tests: list[str], limit: int) -> str:
    """`killed`, `survived`, `too slow` (counted as killed) or `no test`."""
    if not tests:
        return "no test"
    outcome = forked(lambda: meet(mutant, tests), limit, 20 * limit)
    return {0: "survived", None: "too slow"}.get(outcome, "killed")


def forked(run: Callable[[], int], limit: int, longest: int) -> int | None:
    """What a function returns that runs silently in a process of its own; None where it takes longer than `limit` s of
    the processor or `longest` s."""
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
    end = time.monotonic() + longest
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            slow = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL)
            return None if slow else os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def meet(mutant: Mutant, tests: list[str]) -> int:
    """Exit code of pytest on a mutant, in this process."""
    tree, target = mutated(mutant), (ROOT / mutant.path).resolve()
    compile_by(lambda path: tree if path == target else None)
    return int(pytest.main([*PYTEST, *tests], plugins=[Hurried()]))


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
    parser.add_argument("--recorded", type=int, default=12, help="seconds of a test file that are recorded at most")
    parser.add_argument("--tests", nargs="*", help="test files to choose from; all about the folders unless given")
    asked = parser.parse_args()
    os.chdir(ROOT)
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
    warm()
    for name in asked.tests or test_files():
        record(name, asked.recorded)
    results = BUILD / f"seed{asked.seed}.json"
    known: dict[str, str] = json.loads(results.read_text()) if results.exists() else {}
    tests = tests_by_function()
    for number, mutant in enumerate(sample):
        if (asked.only is not None and number not in asked.only) or (asked.only is None and mutant.key in known):
            continue
        met = chosen(mutant, tests, asked.budget)
        known[mutant.key] = verdict(mutant, met, int(15 + 5 * asked.budget))
        print(f"{number} {known[mutant.key]} ({len(met)} tests) line {mutant.line} {mutant.key}", flush=True)
        results.write_text(json.dumps(known, indent=1))
    counts = Counter(known[mutant.key] for mutant in sample if mutant.key in known)
    died = counts["killed"] + counts["too slow"]
    alike = sum(mutant.key in ALIKE and known.get(mutant.key) == "survived" for mutant in sample)
    print(f"{died} of {counts.total()} died: {dict(counts)}, {alike} of the survivors known to mean the same")


if __name__ == "__main__":
    main()
