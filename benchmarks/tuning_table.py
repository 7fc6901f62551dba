"""Tuning of every robot that is at hand: `python -m benchmarks.tuning_table [--search 20] [--out FILE] [NAME ...]`.

A row for each URDF file of example-robot-data that has moving joints, and each MJCF file of gymnasium that reads; the
small ones first. The table is docs/tuning.md's.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import adaptctl
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.errors import AdaptctlError
from adaptctl.tuning import Tuning, Verification, tune
from benchmarks.real_robots import robots as urdfs

FIELDS = ("first", "last", "off", "largest", "limited")


def files() -> Iterator[tuple[str, Path]]:
    """Names and files of the robots."""
    import gymnasium

    yield from ((f"{path.parent.parent.name}/{path.stem}", path) for path in urdfs())
    for path in sorted((Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets").glob("*.xml")):
        yield f"gym/{path.stem}", path


def robots(names: list[str]) -> list[tuple[str, adaptctl.Mechanism]]:
    """Mechanisms that read and move, those of fewest links first."""
    found = []
    for name, path in files():
        if names and name not in names:
            continue
        try:
            mechanism = adaptctl.load(path)
        except AdaptctlError as error:
            print(f"{name}: not read: {str(error)[:120]}", flush=True)
            continue
        if mechanism.dof and len(mechanism.links) <= LARGEST_COMPILED:
            found.append((name, mechanism))
    return sorted(found, key=lambda robot: len(robot[1].links))


def row(name: str, mechanism: adaptctl.Mechanism, search: int, seed: int) -> dict[str, Any]:
    """Results of the rule and of the search, in JSON's types; `cpu` is the rule's processor time, its code in
    memory."""
    entry: dict[str, Any] = {"name": name, "dof": mechanism.dof}
    try:
        tune(mechanism, seed=seed)
        started = time.process_time()
        entry["rule"] = _as_builtins(tune(mechanism, seed=seed))
        entry["cpu"] = time.process_time() - started
        if search:
            entry["search"] = _as_builtins(tune(mechanism, search=search, seed=seed))
    except AdaptctlError as error:
        entry["error"] = str(error)
    return entry


def _as_builtins(tuning: Tuning) -> dict[str, Any]:
    notes = {"notes": list(tuning.notes), "implicit": tuning.integrator.implicit}
    return {run.name: _numbers(run) for run in tuning.verified} | notes


def _numbers(run: Verification) -> dict[str, Any]:
    values = {name: getattr(run, name) for name in FIELDS}
    finite: dict[str, Any] = {name: x if np.isfinite(x) else None for name, x in values.items()}
    return finite | {"learns": run.learns}


def main() -> None:
    """Write a row for each robot as it is found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--search", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("tuning.jsonl"))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    with given.out.open("a") as out:
        for name, mechanism in robots(given.names):
            entry = row(name, mechanism, given.search, given.seed)
            out.write(json.dumps(entry) + "\n")
            out.flush()
            print(json.dumps(entry)[:300], flush=True)


if __name__ == "__main__":
    main()
