"""The experiment on exported controllers tells which builds repeat Python's ticks, and writes what every one does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from rerun.chunk import RrdReader

from adaptctl.errors import InputError
from adaptctl.experiments.build_grid import build_grid
from adaptctl.experiments.export_check import Checked, ExportCheck
from adaptctl.experiments.exported_builds import Build, found_compilers


def test_it_needs_a_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert set(found_compilers()) <= {"zig cc"}
    if not found_compilers():
        with pytest.raises(InputError, match="no compiler is found; install one of: cc, clang, tcc, zig cc"):
            ExportCheck().run(lambda _what, _share: None)


def builds(messages: Mapping[str, str]) -> tuple[Build, ...]:
    """A build of each law with two kinds of number by one compiler, with one by another, and what its test said."""
    kinds = (("cc", "double"), ("cc", "float"), ("tcc", "double"))
    rows = ((law, said, *kind) for law, said in messages.items() for kind in kinds)
    return tuple(Build(law, scalar, which, said.startswith("passed"), said) for law, said, which, scalar in rows)


SAID = {"slotine-li": "passed: torques within 2.84e-14 of 151 N m", "natural": "FAILED: torques within nan of 9 N m"}


def test_an_export_check_shows_which_builds_agree_and_how_far() -> None:
    axes = build_grid(builds(SAID)).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == list(SAID)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["cc, double", "cc, float", "tcc, double"]
    assert [text.get_text() for text in axes.texts] == ["2.8·10⁻¹⁴ N m off"] * 3 + ["differs"] * 3
    assert len({line.get_color() for line in axes.lines}) == 2


def test_an_export_check_writes_all_that_an_experiment_does(tmp_path: Path) -> None:
    checked = Checked(ExportCheck(), {"cc": "cc 1.0"}, builds(SAID), complete=True)
    result = checked.result()
    assert result.failed
    assert result.headline.startswith("Failed: natural (double) by cc: FAILED")
    assert result.headline.endswith(
        "3 of 6 builds repeat Python's torques, of up to 151 N m, within 2.8·10⁻¹⁴ N m (double) and "
        "2.8·10⁻¹⁴ N m (float)."
    )
    result.write(tmp_path, lambda _what, _share: None)
    assert {path.name for path in tmp_path.iterdir()} == {"summary.json", "figures", "report.html", "recording.rrd"}
    told = json.loads((tmp_path / "summary.json").read_text())
    assert [build["difference"] for build in told["builds"]] == [2.84e-14] * 3 + [None] * 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "cc 1.0" in page
    assert page.count("not found") == 3
    schema = str(RrdReader(tmp_path / "recording.rrd").store().schema())
    assert "/summary" in schema
    assert "/figures/builds" in schema
