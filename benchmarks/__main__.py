"""`python -m benchmarks [NAME ...] [--quick]`: measure, and write table and plot where the README shows them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from importlib.util import find_spec

from benchmarks.findings import DisagreementError, Finding
from benchmarks.interleaved import Effort
from benchmarks.machine import BUSY, load
from benchmarks.published import line, publish

SUBJECTS = (
    *("mechanism_calls", "regressor", "tick", "learning_algebra", "closed_loop", "many_arms"),
    *("offline", "first_tick", "own_robot"),
)
"""The modules that measure, in the table's order."""

PEERS = ("pinocchio", "mujoco")
"""Packages that are compared with, which may not be installed."""

QUICK = Effort(rounds=3, seconds=0.002)


def findings(subjects: Iterable[str], effort: Effort) -> Iterator[Finding]:
    """Findings of subjects one after the other, as they come; those whose peer is not installed are skipped, and
    named."""
    for subject in subjects:
        try:
            measure: Callable[[Effort], Iterator[Finding]] = import_module(f"benchmarks.{subject}").measure
        except ModuleNotFoundError as error:
            if error.name not in PEERS:
                raise
            print(f"{subject}: skipped, for {error.name} is not installed", flush=True)
            continue
        for finding in measure(effort):
            print(line(finding), flush=True)
            yield finding


def main() -> int:
    """Exit code: 2 when two results do not agree, 130 when interrupted; a figure worse than asked is printed, and no
    failure."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("subject", nargs="*", help=f"of {', '.join(SUBJECTS)}; all, unless given")
    parser.add_argument("--quick", action="store_true", help="only see that all works: a few rounds")
    given = parser.parse_args()
    unknown = sorted(set(given.subject) - set(SUBJECTS))
    if unknown:
        parser.error(f"unknown subject {unknown[0]!r}; subjects: {', '.join(SUBJECTS)}")
    if load() > BUSY:
        print("others are using this machine: figures will be worse and vary more", file=sys.stderr)
    try:
        found = list(findings(given.subject or SUBJECTS, QUICK if given.quick else Effort()))
    except KeyboardInterrupt:
        print("interrupted: nothing was written", file=sys.stderr)
        return 130
    except DisagreementError as error:
        print(f"they do not agree: {error}", file=sys.stderr)
        return 2
    missing = [peer for peer in PEERS if find_spec(peer) is None]
    if given.quick or given.subject or missing:
        print("not published: that takes a whole run")
        return 0
    publish(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
