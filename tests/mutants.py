"""Mutation score of `identifiability/`, `dynamics/` and `control/`: `make mutants`, or

    python tests/mutants.py [--count 400] [--seed 0] [--budget 40] [--only NUMBER ...] [--list]

A mutant is one small change of the code: another operator, comparison, number or sign, or a check left out. It dies
when a test fails. A first run of each test file tells which functions it enters and how long its tests take; a mutant
then meets test files that enter its function, its own and quick ones first, until one fails or `budget` seconds have
passed. A sample is drawn by seed among all mutants, and results are written to `build/mutants/` one by one,
so that a run that was cut short goes on.

Test files run in forks of a process that has imported what is slow to import, the first ones in one and all others in
another, and the changed module is compiled in memory: no file is changed. Tests that start processes of their own meet
the code as it is, and kill nothing.
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
from pathlib import Path

from alike_mutants import ALIKE
from mutant_choice import PACKAGES, ROOT, Recorded, chosen, record, recorded, test_files
from mutant_processes import Only, forked, run, warm
from mutant_sites import Mutant, mutated, sites

BUILD = ROOT / "build" / "mutants"
FAILED = BUILD / "failed.txt"
FIRST = 2


def verdict(mutant: Mutant, files: list[tuple[Recorded, list[str]]]) -> tuple[str, str]:
    """`killed`, `survived`, `too slow` (counted as killed) or `no test`; and the test that killed it.

    The first files have a process of their own, since to collect the rest takes longer than most tests do."""
    for some in (files[:FIRST], files[FIRST:]):
        FAILED.write_text(" ".join(sorted({file.name for file, _ in some})))
        limit = int(20 + 4 * sum(file.seconds(cases) for file, cases in some))
        outcome = forked(partial(meet, mutant, some), limit) if some else 0
        if outcome not in (0, 5):  # pytest's codes of tests that all pass, and of no tests
            return "too slow" if outcome is None else "killed", FAILED.read_text()
    return ("survived", "") if files else ("no test", "")


def meet(mutant: Mutant, files: list[tuple[Recorded, list[str]]]) -> int:
    """Exit code of pytest on test files and a mutant, in this process."""
    tree, target = mutated(mutant), (ROOT / mutant.path).resolve()

    def changed(path: Path) -> ast.Module | None:
        return tree if path == target else None

    cases = [case for _, some in files for case in some]
    return run(dict.fromkeys(file.name for file, _ in files), changed, [Only(cases, FAILED)], mutant.key)


def every_mutant() -> list[Mutant]:
    """All mutants of the folders."""
    paths = sorted(
        str(path.relative_to(ROOT)) for package in PACKAGES for path in (ROOT / "adaptctl" / package).rglob("*.py")
    )
    return [mutant for path in paths for mutant in sites(path)]


def summary(sample: list[Mutant], known: dict[str, str]) -> str:
    """A line on how many of a sample died."""
    counts = Counter(known[mutant.key] for mutant in sample if mutant.key in known)
    died = counts["killed"] + counts["too slow"]
    alike = sum(mutant.key in ALIKE and known.get(mutant.key) == "survived" for mutant in sample)
    share = 100 * died / max(counts.total() - alike, 1)
    return f"{died} of {counts.total()} died: {dict(counts)}; {alike} mean the same, of the others {share:.0f} % died"


def main() -> None:
    """Draw mutants, run them, and say how many died and which did not."""
    parser = argparse.ArgumentParser(description="Mutation score of a sample of mutants.")
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--budget", type=float, default=40.0, help="seconds of tests that a mutant meets at most")
    parser.add_argument("--list", action="store_true", help="list the sample, and run nothing")
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the sample to run, anew")
    parser.add_argument("--recorded", type=int, default=15, help="seconds of a test file that are recorded at most")
    parser.add_argument("--tests", nargs="*", help="test files to choose from; all unless given")
    asked = parser.parse_args()
    os.chdir(ROOT)
    everything = every_mutant()
    sample = sorted(everything, key=lambda mutant: mutant.lot(asked.seed))[: asked.count]
    print(f"{len(sample)} of {len(everything)} mutants, seed {asked.seed}", flush=True)
    if asked.list:
        print("\n".join(f"{number} {mutant.path}:{mutant.line} {mutant.key}" for number, mutant in enumerate(sample)))
        return
    BUILD.mkdir(parents=True, exist_ok=True)
    os.environ["ADAPTCTL_CACHE"] = str(BUILD / "cache")
    warm()
    for name in asked.tests or test_files():
        record(name, asked.recorded)
    results = BUILD / f"seed{asked.seed}.json"
    known: dict[str, str] = json.loads(results.read_text()) if results.exists() else {}
    files = [file for file in recorded() if asked.tests is None or file.name in asked.tests]
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
    print(summary(sample, known))


if __name__ == "__main__":
    main()
