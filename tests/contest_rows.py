"""Rows and files of contests for tests."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.contest.conditions import CONDITIONS
from adaptctl.contest.entries import ContestEntry
from adaptctl.contest.ranking import MEDIANS

ARM = "two_link"


ROWS = {
    "best": [1.0, 2.0, 3.0, 4.0],
    "pd-gravity": [2.0, 4.0, 6.0, 8.0],
    "true": [1.0, 1.0, 1.0, 1.0],
    "fails": [0.1, 0.1, np.nan, np.nan],
}


def rows_of(laws: dict[str, list[float]]) -> list[dict[str, Any]]:
    other = dict.fromkeys(MEDIANS, 1.0)
    return [
        {"law": law, "robot": "arm", "condition": "clean", "seed": seed, "knows": "limits",
         "gains": "by the rule", "operations": 9,
         "reason": "" if np.isfinite(x) else "error beyond 2 rad at 1.00 s", **other, "error": x}
        for law, values in laws.items() for seed, x in enumerate(values)
    ]  # fmt: skip


def of_robots(errors: dict[str, tuple[float, float]]) -> list[dict[str, Any]]:
    """Rows of two laws, by robot."""
    rows = [rows_of({"a": [a, a], "b": [b, b]}) for a, b in errors.values()]
    return [{**row, "robot": robot} for robot, part in zip(errors, rows, strict=True) for row in part]


def large(laws: int = 3, robots: int = 20, conditions: int = 10, seeds: int = 20) -> Iterator[dict[str, Any]]:
    rng = np.random.default_rng(0)
    other = dict.fromkeys(MEDIANS, 1.0)
    for axes in np.ndindex(laws, robots, conditions, seeds):
        law, robot, condition, seed = axes
        yield {"law": f"law{law}", "robot": f"robot{robot}", "condition": list(CONDITIONS)[condition], "seed": seed,
               "knows": "limits", "gains": "by the rule", "operations": 9, "reason": "",
               "curve": rng.random(20).tolist(), **other, "error": float(rng.random())}  # fmt: skip


def written(folder: Path, **changed: Any) -> Path:
    given = {"purpose": "Try.", "robots": [ARM], "laws": ["true", "gradient"], "conditions": ["clean"], "seeds": [1, 2],
             "duration": 0.3}  # fmt: skip
    path = folder / "contest.toml"
    path.write_text("\n".join(f"{name} = {json.dumps(x)}" for name, x in {**given, **changed}.items()))
    return path


def entry(law: str, *conditions: str, seeds: tuple[int, ...] = (1, 2), duration: float = 0.3) -> ContestEntry:
    return ContestEntry(
        law, ARM, "", conditions or ("clean",), seeds, duration, ("reference", "initial error"), "adaptctl"
    )


def reasons(rows: list[dict[str, Any]]) -> set[str]:
    return {row["reason"] for row in rows}
