"""The findings as tables in docs/speed.md, as JSON, and as the plot that README.md shows too."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TypeAlias

from adaptctl.files import write_text
from benchmarks.bars import write_bars
from benchmarks.findings import Agreement, Finding, Measurement, Speedup, plain
from benchmarks.interleaved import Spread
from benchmarks.machine import Machine

ROOT = Path(__file__).parent.parent
PLOT, NUMBERS = ROOT / "docs" / "images" / "speed.svg", ROOT / "benchmarks" / "latest.json"
PAGE = ROOT / "docs" / "speed.md"
SCHEMA = "adaptctl/benchmarks/1"
BENCH = "make bench"

Row: TypeAlias = tuple[str, ...]

_SCALES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"))


def publish(found: Sequence[Finding]) -> None:
    """Write numbers and plot, and put the tables into the page."""
    machine = Machine.here()
    numbers = {"schema": SCHEMA, "machine": asdict(machine), "findings": [plain(finding) for finding in found]}
    compared = [finding for finding in found if isinstance(finding, Speedup)]
    write_text(NUMBERS, json.dumps(numbers, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    write_bars(PLOT, compared)
    where = f"Measured by `make bench` on {machine}.\n"
    tables = f"{where}\n{comparisons(found)}\n{measurements(found)}\n{agreements(found)}"
    write_text(PAGE, inserted(PAGE.read_text(encoding="utf-8"), tables))


def inserted(page: str, text: str, command: str = BENCH) -> str:
    """The page with the text in place of what stands between the flags of a command. Raises ValueError where the page
    has no such flags."""
    begin, end = (f"<!-- {what}: written by {command} -->\n" for what in ("begin", "end"))
    before, _, rest = page.partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise ValueError(f"the page has no place to write to: it needs the lines {begin}{end}")
    return f"{before}{begin}\n{text}\n{end}{after}"


def comparisons(found: Iterable[Finding]) -> str:
    """Table of the speed-ups, with quartiles."""

    def row(one: Speedup) -> Row:
        times = seconds(one.ours), seconds(one.theirs), _times(one.ratio)
        return one.what, one.against, *times, _at_least(one)

    head = "what", "against", "adaptctl", "peer", "times faster", "goal"
    return table(head, (row(one) for one in found if isinstance(one, Speedup)))


def measurements(found: Iterable[Finding]) -> str:
    """Table of the measurements."""

    def row(one: Measurement) -> Row:
        return one.what, _value(one.value, one.unit), _at_most(one)

    return table(("what", "measured", "goal, at most"), (row(one) for one in found if isinstance(one, Measurement)))


def agreements(found: Iterable[Finding]) -> str:
    """Table of the agreements that were checked before anything was timed."""

    def row(one: Agreement) -> Row:
        difference = f"{one.difference:.0e} {one.unit}".strip()
        return one.what, one.against, difference, f"{one.at_most:.0e}"

    head = "what", "against", "largest difference", "at most"
    return table(head, (row(one) for one in found if isinstance(one, Agreement)))


def line(finding: Finding) -> str:
    """Line about a finding for the screen."""
    if isinstance(finding, Agreement):
        return f"{finding.what} against {finding.against}: {finding.difference:.0e} {finding.unit}".rstrip()
    if isinstance(finding, Measurement):
        found, asked = _value(finding.value, finding.unit), _at_most(finding)
    else:
        found = f"{seconds(finding.ours)}, {_times(finding.ratio)} times faster than {finding.against}"
        asked = _at_least(finding)
    return f"{finding.what}: {found}" + (f" [asked: {asked}]" if asked else "")


def seconds(spread: Spread) -> str:
    """Text of a median time in a unit that suits it."""
    return _plain_value(spread.median, "s")


def _at_least(one: Speedup) -> str:
    return "" if one.at_least is None else f"{_digits(one.at_least)}{_unless(one.as_asked)}"


def _at_most(one: Measurement) -> str:
    return "" if one.at_most is None else f"{_plain_value(one.at_most, one.unit)}{_unless(one.as_asked)}"


def _unless(as_asked: bool) -> str:
    return "" if as_asked else ", missed"


def _value(spread: Spread, unit: str) -> str:
    lower, upper = (_plain_value(x, unit) for x in (spread.lower, spread.upper))
    return f"{_plain_value(spread.median, unit)} ({lower} to {upper})"


def _plain_value(x: float, unit: str) -> str:
    if unit != "s":
        return _digits(x)
    scale, name = next((pair for pair in _SCALES if x >= pair[0]), _SCALES[-1])
    return f"{_digits(x / scale)} {name}"


def _times(ratio: Spread) -> str:
    return f"{_digits(ratio.median)} ({_digits(ratio.lower)} to {_digits(ratio.upper)})"


def _digits(x: float) -> str:
    """Three significant ones, thousands separated."""
    return f"{x:,.0f}" if abs(x) >= 100.0 else f"{x:.3g}"


def table(head: Sequence[str], rows: Iterable[Row]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
