"""Mutation score of the whole package, by folder: `make mutants`, or

    python tests/mutants.py [--count 50] [--seed 0] [--budget 40] [--folders control ...] [--only NUMBER ...] [--list]

A mutant is one small change of the code: another operator, comparison, number or sign, or a check left out. It dies
when a test of `make test` fails. A first run of each test file tells which functions it enters and how long its tests
take; a mutant then meets test files that enter its function, its own and quick ones first, until one fails or `budget`
seconds have passed. `count` of each folder are drawn by seed, and results are written to `build/mutants/` one by one,
so that a run that was cut short goes on.

Test files run in forks of a process that has imported what is slow to import, the first ones in one and all others in
another, and the changed module is compiled in memory: no file is changed. Processes that tests start meet the code as
it is, and kill nothing.
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
from listed_mutants import LISTED, Listed
from mutant_choice import ROOT, Recorded, chosen, folder_of, record, recorded, test_files
from mutant_processes import Only, forked, run, warm
from mutant_sites import Mutant, mutated, sites

BUILD = ROOT / "build" / "mutants"
FAILED = BUILD / f"failed{os.getpid()}.txt"
FIRST = 2
TOPS = ("adaptctl", "envs", "experiments")


def verdict(mutant: Mutant, files: list[tuple[Recorded, list[str]]]) -> tuple[str, str]:
    """`killed`, `survived`, `too slow` or `no test`; and the test that killed it.

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
    changed = partial(_instead, (ROOT / mutant.path).resolve(), mutated(mutant))
    cases = [case for _, some in files for case in some]
    return run(dict.fromkeys(file.name for file, _ in files), changed, [Only(cases, FAILED)], mutant.key)


def listed_verdict(listed: Listed) -> str:
    """`killed`, `survived` or `too slow`, by the tests that are named beside a change."""
    target = (ROOT / listed.path).resolve()
    tree = ast.parse(target.read_text().replace(listed.before, listed.after))
    changed = partial(_instead, target, tree)
    outcome = forked(partial(run, listed.tests, changed, [], listed.name), 120)
    return "too slow" if outcome is None else "survived" if outcome == 0 else "killed"


def _instead(target: Path, tree: ast.Module, path: Path) -> ast.Module | None:
    return tree if path == target else None


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
    os.environ["ADAPTCTL_CACHE"] = str(BUILD / "cache")
    warm()
    if not asked.folders:
        print(f"listed by hand: {dict(Counter(judge_listed().values()))}", flush=True)
    if not asked.listed:
        judge_drawn(samples, asked)


if __name__ == "__main__":
    main()
