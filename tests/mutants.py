"""Mutation score of the whole package, by folder: `make mutants`, or

    python tests/mutants.py [--count 50] [--seed 0] [--budget 40] [--folders control ...] [--only NUMBER ...] [--list]

A mutant is one small change of the code: another operator, comparison, number or sign, or a check left out. It dies
when a test of `make test` fails. A first run of each test file tells which functions it enters and how long its tests
take; a mutant then meets test files that enter its function, its own and quick ones first, until one fails or `budget`
seconds have passed. `count` of each folder are drawn by seed, and results are written to `build/mutants/` one by one,
so that a run that was cut short goes on.

Test files run in forks of a process that has imported what is slow to import, the first ones in one and all others in
another, and the changed module is compiled in memory, in processes that tests start as well: no file is changed. A test
that fails without the mutant too kills nothing.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import resource
import time
from collections import Counter
from functools import partial
from tempfile import TemporaryDirectory

from alike_mutants import ALIKE
from listed_mutants import LISTED, Listed
from mutant_choice import ROOT, Recorded, chosen, folder_of, record, recorded, test_files
from mutant_processes import Only, forked, run_changed, warm
from mutant_sites import Mutant, mutated, sites

BUILD = ROOT / "build" / "mutants"
FAILED = BUILD / f"failed{os.getpid()}.txt"
FIRST = 2
PASSED = (0, 5)
"""pytest's codes of tests that all pass, and of no tests"""
Files = list[tuple[Recorded, list[str]]]
TOPS = ("adaptctl", "envs", "experiments")


def verdict(mutant: Mutant, files: Files) -> tuple[str, str]:
    """`killed`, `survived`, `too slow` or `no test`; and the test that killed it, which passes on the code as it is,
    after the same other ones.

    The first files have a process of their own, since to collect the rest takes longer than most tests do."""
    for some in (files[:FIRST], files[FIRST:]):
        limit = int(20 + 4 * sum(file.seconds(cases) for file, cases in some))
        names, cases = {file.name for file, _ in some}, [case for _, cases in some for case in cases]
        outcome, by = met(names, cases, limit, mutated(mutant), mutant.path) if some else (0, "")
        if outcome is None:
            return "too slow", by
        if outcome not in PASSED:
            until = cases[: cases.index(by) + 1] if by in cases else []
            again, _ = met(names, until, limit, ast.parse((ROOT / mutant.path).read_text()), mutant.path)
            return ("killed", by) if again in PASSED else verdict(mutant, without(files, by))
    return ("survived", "") if files else ("no test", "")


def met(names: set[str], cases: list[str], limit: int, tree: ast.Module, path: str) -> tuple[int | None, str]:
    """Exit code of pytest on cases of test files and a module's tree, and the last case that began, or the files."""
    FAILED.write_text(" ".join(sorted(names)))
    only, target = Only(cases, FAILED), (ROOT / path).resolve()
    with TemporaryDirectory() as folder:
        return forked(partial(run_changed, sorted(names), target, tree, [only], folder), limit), FAILED.read_text()


def without(files: Files, tests: str) -> Files:
    """Test files without a case, or without those of some files."""
    kept = [(file, [case for case in cases if case != tests]) for file, cases in files]
    return [(file, cases) for file, cases in kept if cases and file.name not in tests.split()]


def listed_verdict(listed: Listed) -> str:
    """`killed`, `survived` or `too slow`, by the tests that are named beside a change."""
    target = (ROOT / listed.path).resolve()
    tree = ast.parse(target.read_text().replace(listed.before, listed.after))
    with TemporaryDirectory() as folder:
        outcome = forked(partial(run_changed, listed.tests, target, tree, [], folder), 120)
    return "too slow" if outcome is None else "survived" if outcome == 0 else "killed"


def judge_listed() -> dict[str, str]:
    """What became of the changes that are listed by hand."""
    found = {}
    for listed in LISTED:
        found[listed.name] = listed_verdict(listed)
        print(f"{found[listed.name]}: {listed.name}", flush=True)
    return found


def drawn(count: int, seed: int, folders: list[str] | None) -> dict[str, list[Mutant]]:
    """The first `count` mutants of each folder, by their lots."""
    paths = sorted(str(path.relative_to(ROOT)) for top in TOPS for path in (ROOT / top).rglob("*.py"))
    found: dict[str, list[Mutant]] = {}
    for path in paths:
        if (folder := folder_of(path)) and (not folders or folder in folders):
            found.setdefault(folder, []).extend(sites(path))
    return {folder: sorted(some, key=lambda mutant: mutant.lot(seed))[:count] for folder, some in found.items()}


def summary(sample: list[Mutant], known: dict[str, str]) -> str:
    """A line on how many of a sample died: by a failing test, of those that do not mean the same."""
    counts = Counter(known[mutant.key] for mutant in sample if mutant.key in known)
    alike = sum(mutant.key in ALIKE and known.get(mutant.key) == "survived" for mutant in sample)
    share = 100 * counts["killed"] / max(counts.total() - alike, 1)
    return f"{share:.0f} % of {counts.total()} died ({dict(counts)}, of which {alike} mean the same)"


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description="Mutation score of a sample of mutants of each folder.")
    parser.add_argument("--count", type=int, default=50, help="mutants of each folder")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--budget", type=float, default=40.0, help="seconds of tests that a mutant meets at most")
    parser.add_argument("--folders", nargs="*", help="folders of the package; all unless given")
    parser.add_argument("--listed", action="store_true", help="run the changes that are listed by hand, and no others")
    parser.add_argument("--list", action="store_true", help="list the sample, and run nothing")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the sample to run, anew")
    parser.add_argument("--recorded", type=int, default=15, help="seconds of a test file that are recorded at most")
    parser.add_argument("--tests", nargs="*", help="test files to choose from; all unless given")
    return parser.parse_args()


def judge(folder: str, sample: list[Mutant], files: list[Recorded], asked: argparse.Namespace) -> dict[str, str]:
    """Run the mutants of a folder that were not run before, and return what became of each of the sample."""
    results = BUILD / f"seed{asked.seed}-{folder}.json"
    known: dict[str, str] = json.loads(results.read_text()) if results.exists() else {}
    for number, mutant in enumerate(sample):
        if (asked.only is not None and number not in asked.only) or (asked.only is None and mutant.key in known):
            continue
        started, spent = time.monotonic(), sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        met = chosen(mutant, files, asked.budget)
        known[mutant.key], by = verdict(mutant, met)
        cost = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2]) - spent
        took = f"{time.monotonic() - started:.0f} s, {cost:.1f} s of the processor, {len(met)} test files"
        print(f"{number} {known[mutant.key]} {by} ({took}) line {mutant.line} {mutant.key}", flush=True)
        results.write_text(json.dumps(known, indent=1))
    return known


def judge_drawn(samples: dict[str, list[Mutant]], asked: argparse.Namespace) -> None:
    """Run the drawn mutants, and print how many of each folder died."""
    for name in asked.tests or test_files():
        record(name, asked.recorded)
    files = [file for file in recorded() if asked.tests is None or file.name in asked.tests]
    verdicts = {folder: judge(folder, sample, files, asked) for folder, sample in samples.items()}
    for folder, known in verdicts.items():
        print(f"{folder}: {summary(samples[folder], known)}")
    everything = [mutant for sample in samples.values() for mutant in sample]
    print(f"all: {summary(everything, {key: end for known in verdicts.values() for key, end in known.items()})}")


def main() -> None:
    """Run the changes that are listed by hand and those that are drawn, and say which no test noticed."""
    asked = arguments()
    os.chdir(ROOT)
    samples = drawn(asked.count, asked.seed, asked.folders)
    if asked.list:
        rows = [(n, mutant) for sample in samples.values() for n, mutant in enumerate(sample)]
        print("\n".join(f"{number} {mutant.path}:{mutant.line} {mutant.key}" for number, mutant in rows))
        return
    BUILD.mkdir(parents=True, exist_ok=True)
    warm()
    if not asked.folders:
        print(f"listed by hand: {dict(Counter(judge_listed().values()))}", flush=True)
    if not asked.listed:
        judge_drawn(samples, asked)


if __name__ == "__main__":
    main()
