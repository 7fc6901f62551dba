"""A contest's folder, its progress, times and files, with workers and clocks that are written by hand."""

from __future__ import annotations

import os
import re
import warnings
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed
import numpy as np
import pytest
from contest_rows import ARM, ROWS, entry, rows_of, written

from adaptctl.cli import contest as command
from adaptctl.contest import foreign_runs, page, report, running, step_times
from adaptctl.contest.conditions import CONDITIONS, Push
from adaptctl.contest.contest_file import Contest
from adaptctl.contest.entries import ContestEntry
from adaptctl.contest.own_law import own_entrant
from adaptctl.contest.ranking import Ranking
from adaptctl.contest.running import ContestFolder
from adaptctl.contest.scene import robot_path, scene_of
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import FileError, InputError, MissingExtraError, NotFoundError
from adaptctl.scalars import Column
from adaptctl.simulation.plant import Plant
from adaptctl.sweeps.cluster import Cluster

LAWS = ["true", "gradient", "pd-gravity", "composite"]


def rows(one: ContestEntry, error: float = 1.0) -> list[dict[str, Any]]:
    return [
        {**one.about(name, seed), "error": error, "curve": [error]} for name in one.conditions for seed in one.seeds
    ]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ContestFolder:
    """Folder of a contest of four laws, whose workers need no time."""
    monkeypatch.setattr(running, "computed", lambda client, missing: computed(missing))
    monkeypatch.setattr(Cluster, "client", lambda cluster: nullcontext())
    return ContestFolder(tmp_path / "out", Contest.of(written(tmp_path, laws=LAWS)))


def computed(missing: dict[str, ContestEntry]) -> Any:
    for one in list(missing.values()):
        del missing[f"contest-{one.name}"]
        yield one, rows(one)


def test_progress_goes_from_what_is_there_to_all(folder: ContestFolder) -> None:
    seen: list[float] = []
    table = folder.run(Cluster(1), seen.append, print)
    assert seen == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert table["law"].to_pylist() == [law for law in LAWS for _ in (1, 2)]
    assert table["seed"].to_pylist() == 4 * [1, 2]
    folder.place(folder.entries()[1]).unlink()
    folder.run(Cluster(1), seen.append, print)
    assert seen[5:] == [0.75, 1.0]


def test_a_file_of_an_entry_has_a_row_for_each_run(folder: ContestFolder) -> None:
    one = folder.entries()[0]
    assert not folder.has(one)
    folder.run(Cluster(1), lambda share: None, print)
    assert folder.has(one)
    assert not folder.fails(one)
    running.write_checked(folder.place(one), folder._table(rows(one)[:1]))
    assert not folder.has(one)
    lost = [row | {"reason": "no"} for row in rows(one)]
    running.write_checked(folder.place(one), folder._table(lost))
    assert folder.fails(one)
    running.write_checked(folder.place(one), folder._table([lost[0], rows(one)[1]]))
    assert not folder.fails(one)
    folder.place(one).write_bytes(b"nothing")
    assert not folder.has(one)


def test_workers_get_all_entries_and_are_forgotten_once_they_have_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    submitted: list[Any] = []
    released: list[str] = []

    def submit(call: Any, one: ContestEntry, key: str, pure: bool) -> Any:
        submitted.append((call, pure))
        return SimpleNamespace(key=key, result=lambda: rows(one), release=lambda: released.append(key))

    monkeypatch.setattr(distributed, "as_completed", reversed)
    entries = {f"contest-{name}": entry(name) for name in ("true", "gradient")}
    missing = dict(entries)
    found = list(running.computed(SimpleNamespace(submit=submit), missing))
    assert [one.law for one, _ in found] == ["gradient", "true"]
    assert [own[0]["law"] for _, own in found] == ["gradient", "true"]
    assert submitted == [(running.rows_of, False)] * 2
    assert released == list(entries)[::-1]
    assert not missing


def test_laws_of_others_are_run_in_a_process_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "rows_alone", lambda one: "alone")
    monkeypatch.setattr(ContestEntry, "rows", lambda one: "here")
    assert (running.rows_of(entry("a.py:Law")), running.rows_of(entry("true"))) == ("alone", "here")


def test_laws_are_timed_that_have_no_times_yet_and_do_not_fail(
    folder: ContestFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    timed: list[str] = []

    class Client:
        def submit(self, call: Any, one: ContestEntry, pure: bool) -> Any:
            assert (call, pure) == (step_times.times_of, False)
            timed.append(one.law)
            about = {"entry": one.name, "law": one.law, "robot": ARM}
            return SimpleNamespace(result=lambda: about | {"making": 1.0, "compilation": 2.0, "step": 3.0})

    monkeypatch.setattr(Cluster, "client", lambda cluster: nullcontext(Client()))
    folder.run(Cluster(1), lambda share: None, print)
    fails = folder.entries()[1]
    running.write_checked(folder.place(fails), folder._table([row | {"reason": "no"} for row in rows(fails)]))
    seen: list[float] = []
    assert step_times.kept_times(folder) == []
    step_times.write_times(folder, seen.append)
    assert timed == [LAWS[0], *LAWS[2:]]
    assert seen == pytest.approx([0.0, 1.0 / 3.0, 2.0 / 3.0])
    kept = step_times.kept_times(folder)
    assert [row["law"] for row in kept] == LAWS
    assert [row["step"] for row in kept] == pytest.approx([3.0, np.nan, 3.0, 3.0], nan_ok=True)
    step_times.write_times(folder, seen.append)
    assert len(timed) == 3
    fewer = ContestFolder(folder.path, folder.contest.only({"law": "true"}))
    assert [row["law"] for row in step_times.kept_times(fewer)] == ["true"]
    (folder.path / step_times.TIMES).write_bytes(b"nothing")
    assert step_times.kept_times(folder) == []


def test_a_step_is_timed_along_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of steps that take 5 us, but for a first one that takes a second; the rest of the time passes between them."""
    clock = SimpleNamespace(now=0.0, count=0)
    seen: list[float] = []

    def reference(t: float) -> ReferencePoint:
        clock.now += 100.0
        seen.append(t)
        return ReferencePoint(np.array([t]), np.array([2.0 * t]), np.zeros(1))

    def step(memory: int, p: Any, v: Any, point: ReferencePoint) -> tuple[float, int]:
        assert (memory, p[0], v[0]) == (clock.count, point.p[0], point.v[0])
        clock.now += 5e-6 if clock.count else 1.0
        clock.count += 1
        return 0.0, clock.count

    monkeypatch.setattr(step_times, "perf_counter", lambda: clock.now)
    law: Any = SimpleNamespace(init=lambda p, v: 0, step=step)
    assert step_times._step_time(law, reference) == pytest.approx(5.0, rel=1e-2)
    assert clock.count == step_times.STEPS == 2000
    assert seen == pytest.approx([0.0, *(1e-3 * np.arange(2000.0))])


def test_the_command_tells_ranks_failures_and_where_to_look(
    folder: ContestFolder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    ranking = Ranking([{**row, "curve": [1.0]} for row in rows_of(ROWS)])
    monkeypatch.setattr(report, "write_report", lambda folder: ranking)
    assert command._told(folder) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = {line.split()[0]: line.split()[1:] for line in lines if line.split()[:1] and line.split()[0] in ROWS}
    assert cells["best"] == ["limits", "2.00", "2.5", "2.45", "0.5", "0", "of", "4"]
    assert any(line.startswith("fails: Fails in 2 of 4 runs") for line in lines)
    assert not any(line.startswith("best: ") for line in lines)
    assert f"Critical difference of ranks: {ranking.critical_difference:.3g}" in lines
    assert f"Halves of the seeds: {ranking.halves()}" in lines
    assert f"Scoring set: {folder.contest.scoring_hash}" in lines
    assert lines[-2:] == [f"Rows:     {folder.path / 'results.parquet'}", f"Page:     {folder.path / 'index.html'}"]
    assert (command.short(float("nan")), command.short(1234.5), command.short(0.5)) == ("-", "1.23e+03", "0.5")


@pytest.mark.parametrize("condition", ["late", "saturation"])
def test_runs_on_another_engine_are_those_of_ours_where_it_is_ours(
    condition: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(
        foreign_runs.ENGINES, "ours", lambda arm, period, torque_limits: Plant(arm, period, torque_limits=torque_limits)
    )
    own = CONDITIONS[condition]
    scene = scene_of(ARM, own.control_period)
    truth = np.array([own.parameters(scene, seed) for seed in (1, 2)])
    law = scene.tuning.controller(scene.model)
    one, other = (
        ContestEntry("x", ARM, "", (condition,), (1, 2), 0.2, ("reference", "initial error"), plant)
        for plant in ("adaptctl", "ours")
    )
    ours, theirs = (each.run(scene, own, law, truth) for each in (one, other))
    np.testing.assert_array_equal(theirs.time, ours.time)
    np.testing.assert_allclose(theirs.error, ours.error, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(theirs.torque, ours.torque, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(theirs.largest_error, ours.largest_error, rtol=1e-4)
    assert np.isnan(theirs.diverged_at).all()


def test_a_run_on_another_engine_ends_where_it_diverges(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = Plant(scene_of(ARM, 1e-3).mechanism, 1e-3)
    arm = plant.mechanism
    still = ReferencePoint(*np.zeros((3, 100, 2)))
    law: Any = SimpleNamespace(
        init=lambda p, v: SimpleNamespace(estimate=[4.0]), step=lambda memory, p, v, point: (np.zeros(2), memory)
    )
    asked = list[float]()
    effects: Any = SimpleNamespace(
        loaded=lambda parameters, links, time: asked.append(time) or parameters, actuators=()
    )
    for p, failed in ((2.001, 0.0), (-1.5, np.nan)):
        start = np.array([p, 0.0])
        error, torque, diverged, estimate = foreign_runs._run(
            plant, effects, law, still, start, arm.inertial_parameters
        )
        assert diverged[0] == pytest.approx(failed, nan_ok=True)
        assert error[0].tolist() == start.tolist()
        assert np.isnan(torque).all() == (failed == 0.0)
        assert estimate.tolist() == [4.0]
    assert asked == pytest.approx([0.0, 0.0, *(1e-3 * np.arange(100))])  # of both starts, and of each period


def test_a_push_accepts_any_arm_and_begins_at_no_time() -> None:
    push = Push((1.0, 2.0), rise=2.0)
    push.validate(2, ("a",), 1e-3)
    memory = push.initial_state(np.zeros((3, 2)), 1e-3)
    assert memory.tolist() == [[0.0]] * 3
    torque, after = push.apply(Column([10.0, 20.0]), Column([7.0]), 0.25)
    assert ([float(x) for x in torque], [float(x) for x in after]) == ([10.5, 21.0], [7.25])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"duration": 0.1}, ""),
        ({"duration": 1000.0}, ""),
        ({"duration": 0.099}, "duration: expected 0.1 to 1000 s, got 0.099"),
        ({"duration": 1000.1}, "duration: expected 0.1 to 1000 s"),
        ({"seeds": [3, 4, 3]}, "seeds: 3 is given twice"),
        ({"laws": []}, "laws: expected at least one"),
        ({"laws": ["gradent"]}, r"unknown law 'gradent' \(did you mean 'gradient'\?\)"),
        ({"plant": "mujoco", "conditions": ["noise"]}, "the plant mujoco has no noise; it has clean, "),
        ({"plant": "drake", "conditions": ["friction"]}, "the plant drake has no friction"),
    ],
)
def test_the_file_of_a_contest_is_checked_to_the_last_number(
    changed: dict[str, Any], told: str, tmp_path: Path
) -> None:
    if told:
        with pytest.raises((InputError, NotFoundError), match=told):
            Contest.of(written(tmp_path, **changed))
    else:
        assert Contest.of(written(tmp_path, **changed)).asked.duration == changed["duration"]


def test_a_robot_of_a_package_is_found_there_or_the_package_is_named() -> None:
    assert robot_path("two_link") == "two_link"
    with pytest.raises(MissingExtraError, match="the package nowhere is not installed: pip install nowhere"):
        robot_path("{nowhere}/x.urdf")
    with pytest.raises(NotFoundError, match="the package numpy has no file"):
        robot_path("{numpy}/x.urdf")
    assert Path(robot_path("{numpy}/numpy/version.py")).is_file()


def test_conditions_have_the_rates_limits_and_times_that_they_state() -> None:
    for name, condition in CONDITIONS.items():
        told = condition.meaning
        rate = re.search(r"(\d+) Hz", told)
        assert condition.control_period == pytest.approx(1.0 / int(rate[1]) if rate else 1e-3)
        share = re.search(r"torque limits of (\d+) %", told)
        scene = scene_of(ARM, 1e-3)
        limits = scene.tuning.torque_limits * (int(share[1]) / 100 if share else 1.0)
        np.testing.assert_allclose(condition.plant(scene).torque_limits, limits, err_msg=name)
        halt = re.search(r"stops at (\d+) s", told)
        assert condition.halt == (float(halt[1]) if halt else 0.0)
        event = re.search(r"(?:to|up at|dropped at) (\d+) s", told.replace("the same push, rising for 2 s", "to 11 s"))
        assert condition.event == (float(event[1]) if event else None), name


def test_warnings_of_a_law_fail_neither_its_times_nor_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    def warned(*of: Any) -> Any:
        warnings.warn("of a law", stacklevel=1)
        return {"making": 1.0, "compilation": 2.0, "step": float(os.environ["ADAPTCTL_CACHE"] == "off")}

    monkeypatch.setenv("ADAPTCTL_CACHE", "")
    monkeypatch.setattr(step_times, "_measured", warned)
    with warnings.catch_warnings():
        found = step_times.times_of(entry("true"))
    assert [found[name] for name in step_times.NAMES] == [1.0, 2.0, 1.0]
    monkeypatch.setattr(ContestEntry, "_under", lambda *of: [warned()])
    with warnings.catch_warnings():
        assert len(entry("true", "clean", "noise").rows()) == 2


def test_a_file_that_is_no_python_has_no_law(tmp_path: Path) -> None:
    (tmp_path / "own.txt").write_text("class Law:\n    pass\n")
    with pytest.raises(FileError, match=r"own.txt: cannot be imported as Python"):
        own_entrant(f"{tmp_path / 'own.txt'}:Law")


def test_a_file_offers_the_classes_that_are_named_alike_or_all(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text("from adaptctl.control import PDGravity\nclass Own(PDGravity): pass\nclass Other(PDGravity): pass\n")
    for name, offered in (("Owns", ".*'Own'"), ("Xyzzy", "; it has Own, Other$")):
        with pytest.raises(NotFoundError, match=f"no class '{name}'{offered}"):
            own_entrant(f"{own}:{name}")


def test_cells_of_numbers_have_what_they_are_sorted_by_and_only_the_last_is_words() -> None:
    row = Ranking([{**row, "curve": [1.0]} for row in rows_of(ROWS)]).table()[2]
    found = page._cells(row)
    assert [cell.words for cell in found] == [False] * (len(found) - 1) + [True]
    assert [found[k].value for k in (0, 1, 7, -4)] == [row["rank"], row["error"], row["failed"], row["operations"]]
    assert found[2].note == f"[{page.short(row['over_true_low'])}, {page.short(row['over_true_high'])}]"
    values = (np.nan, np.inf, 1234.5, -1000.0, -0.12345)
    assert [page.short(value) for value in values] == ["–", "∞", "1,230", "-1,000", "-0.123"]
