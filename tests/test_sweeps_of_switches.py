"""Sweeps of experiments with settings that are true or false, such as `adaptive`'s."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from adaptctl.errors import NotCompiledWarning, PhysicalConsistencyWarning, SimplificationWarning
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.sweeps import rows
from adaptctl.sweeps.folder import Folder
from adaptctl.sweeps.report import SweepReport, write_report
from adaptctl.sweeps.rows import columns_of, rows_of
from adaptctl.sweeps.study import SweepStudy

ARM = "two_link"


WARNED = [PhysicalConsistencyWarning, SimplificationWarning, NotCompiledWarning]


@pytest.mark.parametrize("category", WARNED)
def test_what_an_experiment_warns_of_is_not_told_for_each_run(
    category: type[Warning], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "_made", lambda kind, settings: warnings.warn("", category, stacklevel=1) or "refused")
    (row,) = rows_of("adaptive", [{"robot": ARM}])
    assert (row["status"], row["reason"]) == ("failed", "refused")


@pytest.mark.parametrize("category", WARNED[:2])
def test_names_of_controllers_are_found_without_a_warning(
    category: type[Warning], monkeypatch: pytest.MonkeyPatch
) -> None:
    known = rows._mechanism
    monkeypatch.setattr(rows, "_mechanism", lambda one: warnings.warn("", category, stacklevel=1) or known(one))
    assert "adaptive" in rows._controllers(AdaptiveTracking, {"robot": ARM})


def test_tables_have_switches(tmp_path: Path) -> None:
    given = {"robot": ARM, "duration": "0.05", "as_written": "true,false"}
    study = SweepStudy.named("adaptive", given, controllers=("adaptive",))
    rows = rows_of("adaptive", list(study.runs()), ("adaptive",))
    assert [row["status"] for row in rows] == ["done", "done"]
    assert columns_of(AdaptiveTracking)["as_written"][0] == "bool"
    folder = Folder.opened(tmp_path / "sweep", study, 2, ())
    for shard in folder.shards():
        folder.keep(shard, rows)
    made = folder.finished()
    assert made.column("as_written").to_pylist() == [True, False]
    assert made.column("floating_base").to_pylist() == [False, False]
    report = SweepReport.of(tmp_path / "sweep")
    commands = [report.replay(row) for row in report.rows]
    assert ["--as-written" in command.split() for command in commands] == [True, False]
    assert "--as-written True" not in commands[0]
    assert write_report(tmp_path / "sweep").exists()
