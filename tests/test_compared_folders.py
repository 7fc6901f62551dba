"""Finished experiments over each other: settings first, then errors, then curves."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from comparisons import comparison

from adaptctl.cli.main import main
from adaptctl.dynamics import load
from adaptctl.recording.compared_report import PER_JOINT, drawings
from adaptctl.recording.finished_trace import read_traces
from adaptctl.recording.summary import sealed, summary
from adaptctl.recording.trace import write_trace

COMPARED = comparison(load("two_link"))


def unit_of_errors(field: pa.Field) -> pa.Field:
    return field.with_metadata({"unit": "m"}) if field.name.startswith("error.") else field


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Experiments a and b with other settings and errors, c of an arm with other joints, d with errors in m."""
    place = tmp_path_factory.mktemp("compared")
    content: dict[str, Any] = json.loads(json.dumps(summary(COMPARED)))
    write_trace(place / "trace.parquet", COMPARED)
    read = pq.read_table(place / "trace.parquet")
    same = read.replace_schema_metadata({key: x for key, x in read.schema.metadata.items() if key != b"sha256"})
    other = same.rename_columns([f"{name}_2" if "." in name else name for name in same.column_names])
    metres = same.cast(pa.schema([unit_of_errors(field) for field in same.schema]))
    tables = {"a": same, "b": same, "c": other, "d": metres}
    for (folder, table), factor, bandwidth in zip(tables.items(), (1.0, 3.0, 2.0, 1.0), "8488", strict=True):
        content["settings"] = {"Λ": bandwidth, "K": "1"}
        for run in content["runs"].values():
            run["final_rms_error"] = factor * 1e-3
        (place / folder).mkdir()
        (place / folder / "summary.json").write_text(json.dumps(sealed(content | {"robot": table.column_names[1]})))
        pq.write_table(table, place / folder / "trace.parquet")
    return place


def test_settings_come_first_then_errors_with_ratios(folders: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", "compare", str(folders / "a"), str(folders / "b"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["differences"] == {"Λ": ["8", "4"]}
    assert told["errors"]["adaptive"] == {"final_rms_error": [1e-3, 3e-3], "ratio": [1.0, pytest.approx(3.0)]}
    assert main(["experiment", "compare", str(folders / "a"), str(folders / "b")]) == 0
    out = capsys.readouterr().out
    assert out.index("Λ") < out.index("3 (3)")


def test_the_report_has_the_curves_over_each_other(
    folders: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["experiment", "compare", str(folders / "a"), str(folders / "b"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"comparison.json", "report.html"}
    page = (out / "report.html").read_text()
    assert all(f"{caption}." in page for caption in PER_JOINT.values())
    assert page.count("data:image/svg+xml") == 8  # four figures, each also for a phone
    assert f"Report: {out / 'report.html'}" in capsys.readouterr().out
    assert json.loads((out / "comparison.json").read_text())["schema"] == "adaptctl/comparison/2"
    assert main(["experiment", "compare", str(folders / "a"), str(folders / "b"), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    again = ["experiment", "compare", str(folders / "b"), str(folders / "a"), "--out", str(out), "--overwrite"]
    assert main(again) == 0
    assert json.loads((out / "comparison.json").read_text())["folders"] == [str(folders / name) for name in "ba"]


def test_a_curve_has_the_trace_s_numbers(folders: Path) -> None:
    (figure,) = [one for one in drawings(read_traces([folders / "a", folders / "b"])) if one.name == "tracking-error"]
    for line in figure.draw().axes[0].lines:
        time, error = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        alone = np.mean(COMPARED.subject.rollout.error[(COMPARED.subject.rollout.time <= 0.1)] ** 2)
        assert error[time.searchsorted(0.1)] == pytest.approx(1e3 * np.sqrt(alone), rel=1e-9)


def test_robots_with_other_joints_are_compared_by_the_errors_of_all(folders: Path) -> None:
    assert [one.name for one in drawings(read_traces([folders / "a", folders / "c"]))] == ["tracking-error"]


def of_joints(count: int, samples: int = 5) -> Any:
    """A trace in which all errors are the times."""
    time = 0.01 * np.arange(samples)
    return SimpleNamespace(
        time=time,
        folder="a",
        entry=lambda name: "adaptive",
        names=lambda kind: [f"j{k}" for k in range(count)] if kind == "error" else [],
        column=lambda name: time,
        unit=lambda name: "rad",
    )


def test_at_most_sixty_joints_have_panels_and_these_at_most_a_thousand_samples() -> None:
    assert [len(list(drawings([of_joints(count)]))) for count in (2, 60, 61)] == [2, 2, 1]
    for samples, every in ((1000, 1), (1001, 2)):
        _, each = drawings([of_joints(2, samples)])
        for axes in each.draw().axes[:2]:
            np.testing.assert_allclose(axes.lines[0].get_xdata(), 0.01 * np.arange(0, samples, every))
            np.testing.assert_allclose(axes.lines[0].get_ydata(), 10.0 * np.arange(0, samples, every))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["a"], "at least two results folders to compare, got 1"),
        (["", "a"], "no summary.json in it"),
        (["a", "d"], "errors in different units cannot be compared ({0}/a: rad; {0}/d: m)"),
        (["a", "lone"], "no controller in common: {0}/a has adaptive, adaptation-off; {0}/lone has mine"),
        (["a", "cut"], "trace.parquet: cannot be read"),
        (["a", "names"], "trace.parquet: cannot be read"),
    ],
)
def test_what_has_no_comparison_is_refused(
    folders: Path, given: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads((folders / "a" / "summary.json").read_text())
    content["runs"] = {"mine": content["runs"]["adaptive"]}
    trace = (folders / "a" / "trace.parquet").read_bytes()
    for name, data in (("lone", trace), ("cut", b"PAR1"), ("names", trace.replace(b"time", b"\xf3ime"))):
        (folders / name).mkdir(exist_ok=True)
        (folders / name / "summary.json").write_text(json.dumps(sealed(content)))
        (folders / name / "trace.parquet").write_bytes(data)
    assert main(["experiment", "compare", *(str(folders / name) for name in given)]) != 0
    assert says.format(folders) in capsys.readouterr().err
