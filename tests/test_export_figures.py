"""Figures of docs/export.md: those of the data beside it, and those that are computed here."""

from __future__ import annotations

import json
import re
from pathlib import Path

import export_published
import pytest
from check_export import cases
from check_page import started
from export_builds import TOOLCHAINS
from export_published import ARMS, NUMBERS, PAGE, Figures, publish, shown

import adaptctl
from adaptctl.codegen.interface import Interface
from adaptctl.codegen.live_arm import LiveArm, live_arm
from benchmarks.tasks import puma, semi_direct_drive

TEXT = re.sub(r"\s+", " ", PAGE.read_text(encoding="utf-8"))


def test_tables_of_export_show_their_data() -> None:
    kept = json.loads(NUMBERS.read_text(encoding="utf-8"))
    assert shown(kept) in PAGE.read_text(encoding="utf-8")
    assert set(kept["native"]) == set(kept["cortex"]) == set(ARMS)
    assert kept["agree"] == kept["builds"] == kept["laws"] * len(TOOLCHAINS)
    assert kept["laws"] <= len(cases())


def test_laws_are_named_by_the_parameters_that_they_learn() -> None:
    laws = cases()
    for name in ("puma", "semi_direct"):
        assert str(len(laws[name].model.columns)) == re.findall(r"\d+", ARMS[name])[0]


def test_a_run_comes_into_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page, numbers = tmp_path / "export.md", tmp_path / "export.json"
    flags = [f"<!-- {what}: written by {export_published.COMMAND} -->\n" for what in ("begin", "end")]
    page.write_text(f"# E\n{flags[0]}old\n{flags[1]}rest\n")
    monkeypatch.setattr(export_published, "PAGE", page)
    monkeypatch.setattr(export_published, "NUMBERS", numbers)
    found = Figures()
    found.count(6, 0)
    found.count(6, 1)
    found.times["puma"] = {"native": 200.4, "gcc -O2": 301.0}
    found.times["semi_direct"] = {"native": 250.0}
    found.cortex["puma"] = {"flash": 9050, "stack": 5, "instructions_most": 3417, "nano_newton_metres_off": 2000}
    publish(found.kept())
    text = page.read_text(encoding="utf-8")
    assert "11 of 12 builds of 2 laws" in text
    assert "| native code here | 200 ns | 250 ns | – |" in text
    assert "| gcc -O2 | 1.50 | – | – |" in text
    assert "| PUMA, 36 parameters | 9,050 B | 5 B | 3,417 | 2·10⁻⁶ N m |" in text
    assert "old" not in text
    assert text.endswith("rest\n")
    assert json.loads(numbers.read_text(encoding="utf-8")) == found.kept()


def test_sizes_of_live_arms_are_those_of_the_page() -> None:
    sizes = []
    for task in (puma(), semi_direct_drive()):
        plant, state, parameters = started(task)
        live = live_arm(plant, task.controller, task.reference, state, parameters)
        assert isinstance(live, LiveArm)
        sizes.append(f"{len(live.binary) / 1000:.0f} kB")
    assert f"law and plant (`make check-page`): {' and '.join(sizes)};" in TEXT


def test_the_size_of_a_law_alone_is_that_of_the_page(tmp_path: Path) -> None:
    law = puma().controller
    done = adaptctl.export(law, tmp_path / "arm", name="arm", language="wasm", without_safety_filter=True)
    stated = re.search(r"some (\d+) kB for (\d+) parameters of six joints", TEXT)
    assert stated is not None
    assert int(stated[1]) == pytest.approx(done.manifest["wasm_bytes"] / 1000, rel=0.1)
    assert (int(stated[2]), len(Interface(law).joints)) == (len(law.model.columns), 6)
