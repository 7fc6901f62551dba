"""Tuning of every robot that is at hand: `python -m benchmarks.tuning_table [--search 20] [--out FILE] [NAME ...]`.

A row for each URDF file of example-robot-data that has moving joints, and each MJCF file of gymnasium that reads; the
small ones first. Robots that FILE has a row of are not run again, so that the same command goes on where it was ended.
`--publish` puts all rows of FILE into docs/tuning.md, and runs nothing.
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
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.errors import AdaptctlError
from adaptctl.files import write_text
from adaptctl.tuning import Tuning, Verification, tune
from benchmarks.published import inserted, table
from benchmarks.real_robots import robots as urdfs

PAGE = Path(__file__).parent.parent / "docs" / "tuning.md"
COMMAND = "python -m benchmarks.tuning_table"
CASES = ("nominal", "one-period delay", "link errors ±30%", "both")
FIELDS = ("initial_rms_error", "final_rms_error", "final_rms_error_adaptation_off", "max_error", "limited_share")


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
        if mechanism.dof and len(mechanism.links) <= MAX_COMPILED_LINKS:
            found.append((name, mechanism))
    return sorted(found, key=lambda robot: len(robot[1].links))


def row(name: str, mechanism: adaptctl.Mechanism, search: int, seed: int) -> dict[str, Any]:
    """Results of the rule and of the search, in JSON's types; `cpu` is the rule's least processor time of three, by the
    last of which its code is in memory."""
    entry: dict[str, Any] = {"name": name, "dof": mechanism.dof}
    try:
        times = [time.process_time()]
        for _ in range(3):
            tuning = tune(mechanism, seed=seed)
            times.append(time.process_time())
        entry["rule"], entry["cpu"] = _as_builtins(tuning), float(np.diff(times).min())
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
    return finite | {"is_learning": run.is_learning}


def rows(found: Path) -> list[dict[str, Any]]:
    """The rows of a file, the last one of each robot."""
    lines = found.read_text(encoding="utf-8").splitlines() if found.exists() else []
    return list({entry["name"]: entry for entry in map(json.loads, lines)}.values())


def published(done: list[dict[str, Any]]) -> str:
    """The table of all rows, those of few joints first, and what it comes to."""
    done = sorted(done, key=lambda entry: int(entry["dof"]))
    tuned, refused = ([entry for entry in done if ("error" in entry) == wrong] for wrong in (False, True))
    head = (
        "Robot",
        "joints",
        "first second",
        "last 2 s",
        "adaptation off",
        "one-period delay",
        "link errors 30 %",
        "both",
    )
    parts = [_counts("Tuning rules", [entry["rule"] for entry in tuned], len(done))]
    if searched := [entry["search"] for entry in tuned if "search" in entry]:
        parts.append(_counts("With `--search 20`", searched, len(searched)))
    seconds = [(entry["cpu"], entry["dof"]) for entry in tuned]
    times = ", ".join(
        f"{cpu:.2g} s for {dof} joints"
        for cpu, dof in (max(seconds), *_of_joints(seconds, 32), *_of_joints(seconds, 7))
    )
    parts.append(f"Processor time, its code in memory, at most: {times}.")
    parts += [f"`{entry['name']}` is refused: {entry['error']}" for entry in refused]
    return "\n\n".join((table(head, map(_line, tuned)), *parts)) + "\n"


def _of_joints(seconds: list[tuple[float, int]], dof: int) -> list[tuple[float, int]]:
    """The longest of the robots with so many joints."""
    return [max(pair for pair in seconds if pair[1] == dof)] if any(pair[1] == dof for pair in seconds) else []


def _counts(who: str, found: list[dict[str, Any]], count: int) -> str:
    """Counts of robots that learn, by how well they do."""
    runs = [one["nominal"] for one in found]
    learning = {name: sum(one[name]["is_learning"] for one in found) for name in CASES}
    tenth = sum(run["is_learning"] and run["final_rms_error"] <= 0.1 * run["initial_rms_error"] for run in runs)
    median = float(np.median([np.inf if run["final_rms_error"] is None else run["final_rms_error"] for run in runs]))
    return (
        f"{who}: {learning['nominal']} of {count} learn nominally, {tenth} of them to a tenth of the first second's "
        f"error, {learning['one-period delay']} with a one-period delay, {learning['link errors ±30%']} with link "
        f"errors, {learning['both']} with both; median of the last two seconds {1e3 * median:.2g} mrad."
    )


def _line(entry: dict[str, Any]) -> tuple[str, ...]:
    """Cells of a row; errors of runs that do not learn are in brackets."""
    runs = [entry["rule"][name] for name in CASES]
    first, off = _mrad(runs[0]["initial_rms_error"]), _mrad(runs[0]["final_rms_error_adaptation_off"])
    last = [
        _mrad(run["final_rms_error"]) if run["is_learning"] else f"({_mrad(run['final_rms_error'])})" for run in runs
    ]
    return entry["name"], str(entry["dof"]), first, last[0], off, *last[1:]


def _mrad(error: float | None) -> str:
    """An error in mrad (mm)."""
    if error is None:
        return "unstable"
    return f"{1e3 * error:.2g}" if 1e-5 <= error < 0.1 else "< 0.01" if error < 1e-5 else f"{1e3 * error:.0f}"


def main() -> None:
    """Write a row for each robot as it is found."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*")
    parser.add_argument("--search", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("tuning.jsonl"))
    parser.add_argument("--publish", action="store_true", help="put what was found into docs/tuning.md")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    done = rows(given.out)
    if given.publish:
        page = PAGE.read_text(encoding="utf-8")
        write_text(PAGE, inserted(page, published(done), COMMAND))
        return
    with given.out.open("a") as out:
        for name, mechanism in robots(given.names):
            if any(row["name"] == name and ("search" in row or not given.search) for row in done):
                continue
            entry = row(name, mechanism, given.search, given.seed)
            out.write(json.dumps(entry) + "\n")
            out.flush()
            print(json.dumps(entry)[:300], flush=True)


if __name__ == "__main__":
    main()
