"""Verification page: every invariant that `make figures` tells of, beside its bound and the test that asks for it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeAlias

from adaptctl.files import write_text
from adaptctl.recording.wording import number
from benchmarks.machine import Machine
from benchmarks.published import inserted, table

ROOT = Path(__file__).resolve().parents[2]
PAGE, KEPT = ROOT / "docs" / "verification.md", ROOT / "docs" / "verification.json"
TESTS = ROOT / "tests"
SCHEMA = "adaptctl/verification/1"
COMMAND = "make figures"

Figure: TypeAlias = Mapping[str, Any]


def publish(found: Path) -> None:
    """Keep the figures of a run with the machine they are of, and show them in the page."""
    figures = json.loads(found.read_text(encoding="utf-8"))["figures"]
    kept = {"schema": SCHEMA, "machine": asdict(Machine.here()), "figures": figures}
    write_text(KEPT, json.dumps(kept, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    write_text(PAGE, inserted(PAGE.read_text(encoding="utf-8"), shown(kept), COMMAND))


def shown(kept: Mapping[str, Any]) -> str:
    """What the page says of figures and their machine, in Markdown."""
    head = "invariant", "bound", "found", "times inside", "test"
    return f"Found by `{COMMAND}` on {Machine(**kept['machine'])}.\n\n{table(head, map(_row, kept['figures']))}"


def asked_in(name: str, tests: Iterable[Path] | None = None) -> str:
    """File that asks for an invariant by its name."""
    paths = sorted(TESTS.glob("test_*.py") if tests is None else tests)
    return next(path.name for path in paths if f'require("{name}"' in path.read_text(encoding="utf-8"))


def _row(figure: Figure) -> tuple[str, ...]:
    found, unit = float(figure["figure"]), "" if figure["unit"] == "1" else f"\u00a0{figure['unit']}"
    at_least = "at_least" in figure
    bound = float(figure["at_least" if at_least else "at_most"])
    sign = "≥" if at_least else "≤"
    asked = number(bound, 1 if float(f"{bound:.1g}") == bound else 3)
    numbers = f"{sign}\u00a0{asked}{unit}", f"{number(found)}{unit}", _inside(found, bound, at_least)
    return figure["meaning"], *numbers, f"`{asked_in(figure['name'])}`"


def _inside(found: float, bound: float, at_least: bool) -> str:
    """How many times a figure is on the right side of its bound."""
    if not found:
        return "–"
    times = found / bound if at_least else bound / found
    return f"{times:,.0f}" if times >= 100.0 else number(times)


if __name__ == "__main__":
    publish(Path(sys.argv[1]))
