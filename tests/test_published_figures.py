"""Figures in the documentation are those of the data beside them: benchmarks, and invariants with their bounds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from adaptctl.dynamics import load
from adaptctl.experiments.laws import Laws
from adaptctl.identifiability import essential_space, fundamental_basis
from benchmarks import long_mechanisms, start_up
from benchmarks.findings import Agreement, Finding, Measurement, Speedup
from benchmarks.interleaved import Spread
from benchmarks.machine import Machine
from benchmarks.offline import chain
from benchmarks.published import NUMBERS, PLOT, agreements, comparisons, measurements
from docs.making.null_directions import write_null_directions
from docs.making.verification import KEPT, PAGE, TESTS, asked_in, publish, shown

ROOT = Path(__file__).resolve().parent.parent
KINDS: dict[str, type[Any]] = {"speedup": Speedup, "measurement": Measurement, "agreement": Agreement}


def findings() -> list[Finding]:
    """What the last `make bench` kept."""
    kept = json.loads(NUMBERS.read_text(encoding="utf-8"))["findings"]
    return [
        KINDS[one.pop("kind")](**{k: Spread(**v) if isinstance(v, dict) else v for k, v in one.items()}) for one in kept
    ]


def measured(what: str) -> float:
    return next(one.value.median for one in findings() if isinstance(one, Measurement) and one.what == what)


@pytest.mark.parametrize("tables", [comparisons, measurements, agreements])
def test_tables_of_speed_are_those_of_the_last_benchmark(tables: Any) -> None:
    assert tables(findings()) in (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")


def test_the_plot_of_speed_is_that_of_the_last_benchmark() -> None:
    texts = set(re.findall(r"<text[^>]*>([^<]*)</text>", PLOT.read_text(encoding="utf-8")))
    compared = [one for one in findings() if isinstance(one, Speedup)]
    assert len(compared) > 5
    assert {f"{one.ratio.median:,.0f}" for one in compared} <= texts


def test_the_readme_promises_what_was_measured() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    promised = re.search(r"for a hundred links in (\d+) ms", text)
    assert promised is not None
    assert 1e3 * measured("null vectors, kept parameters and regrouping matrix of that chain") <= float(promised[1])
    loop = [one for one in findings() if isinstance(one, Speedup) and one.against == "real time"]
    assert "a thousand times faster than real time" in text
    assert max(one.ratio.median for one in loop) > 1000.0


def test_the_page_of_invariants_shows_its_data() -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    assert len(kept["figures"]) > 5
    assert shown(kept) in PAGE.read_text(encoding="utf-8")
    for figure in kept["figures"]:
        assert figure["figure"] <= figure.get("at_most", float("inf"))
        assert figure["figure"] >= figure.get("at_least", 0.0)
        assert (TESTS / asked_in(figure["name"])).is_file()


def test_the_table_of_the_first_tick_shows_its_data() -> None:
    kept = json.loads(start_up.NUMBERS.read_text(encoding="utf-8"))
    assert start_up.shown(kept) in (ROOT / "docs" / "compilation.md").read_text(encoding="utf-8")
    assert kept["cached"]["together"][1] < kept["cold"]["together"][1]


def test_the_table_of_long_mechanisms_shows_its_data() -> None:
    kept = json.loads(long_mechanisms.NUMBERS.read_text(encoding="utf-8"))
    assert long_mechanisms.shown(kept) in (ROOT / "docs" / "compilation.md").read_text(encoding="utf-8")
    assert [row["links"] for row in kept["rows"]] == list(long_mechanisms.LINKS)
    for row in kept["rows"]:
        assert row["first_step"] > row["step"] > 0.0
        assert row["first_tick"] > row["tick"] > 0.0


def test_operations_of_long_mechanisms_are_those_of_their_ticks() -> None:
    """Counted for two chains; every link more costs as much."""
    kept = {
        row["links"]: row["flops"] for row in json.loads(long_mechanisms.NUMBERS.read_text(encoding="utf-8"))["rows"]
    }
    few, more = long_mechanisms.LINKS[:2]
    counted = [long_mechanisms.flops(long_mechanisms.law(chain(links))) for links in (few, more)]
    each = (counted[1] - counted[0]) // (more - few)
    assert kept == {links: counted[0] + each * (links - few) for links in long_mechanisms.LINKS}


def test_figures_of_a_run_come_into_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, kept, found = (tmp_path / name for name in ("page.md", "kept.json", "figures.json"))
    page.write_text("# V\n<!-- begin: written by make figures -->\nold\n<!-- end: written by make figures -->\nrest\n")
    monkeypatch.setattr("docs.making.verification.PAGE", page)
    monkeypatch.setattr("docs.making.verification.KEPT", kept)
    figures = [
        {"name": "accepted-hold", "meaning": "damping", "unit": "1", "at_least": 0.5, "figure": 1.0},
        {"name": "memory-growth", "meaning": "memory", "unit": "MB", "at_most": 20.0, "figure": 0.0},
    ]
    found.write_text(json.dumps({"schema": "adaptctl/figures/1", "figures": figures}))
    publish(found)
    text = page.read_text(encoding="utf-8")
    assert "| damping | ≥\u00a00.5 | 1 | 2 | `test_hold.py` |" in text
    assert "| memory | ≤\u00a020\u00a0MB | 0\u00a0MB | – | `test_long_runs.py` |" in text
    assert "\nold\n" not in text
    assert text.endswith("rest\n")
    assert Machine.here().processor in text
    assert json.loads(kept.read_text(encoding="utf-8"))["figures"] == figures


def test_arms_that_differ_along_a_null_direction_move_alike(tmp_path: Path) -> None:
    apart = write_null_directions(tmp_path / "arms.svg")
    first, along, other = apart.values()
    assert first == 0.0
    assert along < 1e-9 < 0.5 < other
    text = (tmp_path / "arms.svg").read_text(encoding="utf-8")
    assert ElementTree.fromstring(text).tag.endswith("svg")
    assert "prefers-reduced-motion" in text
    shown = (ROOT / "docs" / "images" / "null-directions.svg").read_text(encoding="utf-8")
    assert set(re.findall(r"<text[^>]*>([^<]*kg)", text)) == set(re.findall(r"<text[^>]*>([^<]*kg)", shown))


def test_operations_of_laws_are_those_of_their_ticks() -> None:
    """Each row of the table of laws, whose name is that of a controller of the experiment."""
    experiment = Laws()
    mechanism = load(experiment.robot)
    contenders = experiment.contenders(mechanism, fundamental_basis(essential_space(mechanism)))
    counted = {one.name: one.controller.kernel.operations.flops for one in contenders}
    page = (ROOT / "docs" / "adaptation.md").read_text(encoding="utf-8").partition("## Payload pickup")[0]
    rows = re.findall(r"^\| (`(\w+)`|adaptation off).*\| ([\d,]+) \|$", page, re.MULTILINE)
    names = [re.sub(r"(?<!^)(?=[A-Z])", "-", name or "adaptation-off").lower() for _, name, _ in rows]
    assert len(names) > 10
    told = {name: int(count.replace(",", "")) for name, (*_, count) in zip(names, rows, strict=True)}
    # which of two equal constants are shared depends on their last bits, and so on the processor
    assert told == pytest.approx({name: counted[name] for name in names}, rel=2e-3)
