"""Entries of a contest: reasons, laws for all seeds, names of their files, and tables of their rows."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from contest_rows import entry, reasons
from nightly import at_night

from adaptctl.contest import own_process, trial
from adaptctl.contest.entries import LONGEST_REASON, ContestEntry, _laws
from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import LAWS, Entrant, _computed_torque
from adaptctl.contest.measures import COLUMNS, ContestRuns
from adaptctl.contest.own_process import rows_alone
from adaptctl.contest.running import rows_as_table, rows_of_table
from adaptctl.contest.scene import scene_of
from adaptctl.contest.step_times import NAMES, STEPS, times_of
from adaptctl.contest.trial import TimeExceededError
from adaptctl.control.controller import ReferencePoint
from adaptctl.dynamics import load
from adaptctl.errors import InputError
from adaptctl.experiments.disturbed_arm import LABELS
from adaptctl.experiments.laws import Laws
from adaptctl.experiments.laws_controllers import controller


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (KeyError("oops"), "KeyError: 'oops'"),
        (ValueError(), "ValueError: no message"),
        (InputError("a\n  b"), "a b"),
    ],
)
def test_reasons_are_of_one_line(error: Exception, told: str) -> None:
    assert entry("gradient").reason_of(error) == told
    assert len(entry("gradient").reason_of(ValueError("x" * 1000))) <= LONGEST_REASON


def test_a_law_that_is_too_slow_once_is_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def under(one: ContestEntry, name: str, *_: Any) -> list[dict[str, Any]]:
        asked.append(name)
        if name == "noise":
            raise TimeExceededError("too slow")
        return [one.about(name, seed) for seed in one.seeds]

    monkeypatch.setattr(ContestEntry, "_under", under)
    rows = entry("gradient", "clean", "noise", "halt").rows()
    assert asked == ["clean", "noise"]
    assert [(row["condition"], row["seed"], row["reason"]) for row in rows] == [
        ("clean", 1, ""), ("clean", 2, ""), *[(x, seed, "too slow") for x in ("noise", "halt") for seed in (1, 2)],
    ]  # fmt: skip
    assert {row["knows"] for row in rows[2:]} == {"limits"}


@pytest.mark.parametrize("most", [50_000, 49_999])
def test_a_step_takes_so_many_operations_at_most(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "operations", lambda law: 50_000)
    monkeypatch.setattr(trial, "MAX_OPERATIONS", most)
    entrant: Any = SimpleNamespace(make=lambda known: SimpleNamespace(dof=2), knows=None)
    known: Any = SimpleNamespace(dof=2)
    if most < 50_000:
        with pytest.raises(InputError, match="too slow: 50,000 operations"):
            trial._tried(entrant, known)
    else:
        assert trial._tried(entrant, known) == 50_000


def test_a_law_has_a_minute_to_be_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "in_time", lambda call, limit: limit)
    nothing: Any = None
    assert trial.tried(nothing, nothing) == 60


def test_one_law_serves_all_seeds_that_are_told_the_same() -> None:
    class Law:
        def __init__(self, known: Any) -> None:
            self.told = known.told

    def made(knows: Knowledge, *told: float) -> Any:
        known: Any = [SimpleNamespace(told=np.array([x])) for x in told]
        return _laws(Entrant("a", knows, Law, ""), known)  # type: ignore[arg-type]

    assert isinstance(made(Knowledge.LIMITS, 1.0, 2.0), Law)
    assert isinstance(made(Knowledge.TRUTH, 1.0, 1.0), Law)
    several = made(Knowledge.TRUTH, 1.0, 2.0, 1.0)
    assert [law.told[0] for law in several] == [1.0, 2.0, 1.0]
    assert several[0] is several[2]


@pytest.mark.parametrize("code", [0, at_night(3)])
def test_a_law_that_ends_its_process_is_a_row_with_its_reason(tmp_path: Path, code: int) -> None:
    (tmp_path / "own.py").write_text(f"import os\nprint('loaded', flush=True)\nos._exit({code})\n")
    rows = rows_alone(entry(f"{tmp_path / 'own.py'}:Law", seeds=(1, 2)))
    assert reasons(rows) == {f"ended the process that ran it, with code {code}"}
    assert [(row["law"], row["seed"]) for row in rows] == [("Law", 1), ("Law", 2)]


def test_a_process_answers_with_rows_and_not_with_what_a_law_prints(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def rows(one: ContestEntry) -> list[dict[str, Any]]:
        print("of a law", flush=True)
        return [{"law": one.law, "seed": seed} for seed in one.seeds]

    asked, handled = io.BytesIO(msgspec.json.encode(entry("a.py:Law")) + b"\n"), list[Any]()
    monkeypatch.setattr(ContestEntry, "rows", rows)
    monkeypatch.setattr(own_process, "_end_with_parent", lambda: None)
    monkeypatch.setattr(own_process.signal, "signal", lambda *which: handled.append(which))
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=asked))
    with monkeypatch.context() as printing:
        printing.setattr(sys, "stdout", os.fdopen(1, "w", closefd=False))
        own_process.main()
    assert handled == [(signal.SIGINT, signal.SIG_IGN)]
    told = capfd.readouterr()
    assert json.loads(told.out) == [{"law": "a.py:Law", "seed": 1}, {"law": "a.py:Law", "seed": 2}]
    assert told.err == "of a law\n"


@pytest.mark.nightly
def test_a_law_of_ones_own_has_the_same_rows_in_a_process_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "from adaptctl.control import Gradient\nprint('loaded')\nclass Law(Gradient):\n    pass\n"
    )
    one = entry(f"{tmp_path / 'own.py'}:Law", seeds=(1, 2))
    alone, here = (rows_as_table(rows, COLUMNS, "") for rows in (rows_alone(one), one.rows()))
    assert alone.equals(here)
    assert reasons(one.rows()) == {""}


def test_torques_are_told_over_the_limits_of_their_condition(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(one: ContestEntry, scene: Any, *_: Any) -> ContestRuns:
        torque = 0.3 * scene.tuning.torque_limits * np.ones((40, 2, 1))
        size = np.zeros((40, 2, 2))
        return ContestRuns(0.01 * np.arange(40), size, torque, size[0], np.full(2, np.nan), np.zeros((2, 0)))

    monkeypatch.setattr(ContestEntry, "run", run)
    rows = entry("pd", "clean", "saturation").rows()
    assert [row["torque"] for row in rows] == pytest.approx([0.3, 0.3, 0.5, 0.5])
    assert {row["parameters"] for row in rows} == {6 + 4}  # of two links, and friction
    assert entry("pd").about("clean", 1)["parameters"] == 0  # nobody has looked


def test_laws_have_the_constants_of_the_experiment_that_compares_them() -> None:
    known = Known.of(scene_of("two_link", 1e-3), Knowledge.LIMITS, 1, np.zeros(0))
    made: dict[str, Any] = {law.name: law.make(known) for law in LAWS if law.knows is Knowledge.LIMITS}
    other = Laws(robot="two_link")
    draft = {name: controller(other, name, known.model).adaptation_law for name in set(made) & set(LABELS)}
    for name, field in (("composite", "cutoff"), ("cushioned-floor", "forgetting"), ("e-modification", "leakage"),
                        ("dead-zone", "width"), ("concurrent-learning", "stack_size")):  # fmt: skip
        own, theirs = (getattr(law, field) for law in (made[name].adaptation_law, draft[name]))
        np.testing.assert_array_equal(own, theirs)


def test_times_of_a_law_are_those_of_its_compilation_and_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTCTL_CACHE", "")
    began = perf_counter()
    found = times_of(entry("true"))
    took = perf_counter() - began
    assert 0.0 < found["making"] + found["compilation"] < took
    assert 0.0 < 1e-6 * STEPS * found["step"] < took
    assert np.isnan([times_of(entry("no such law"))[name] for name in NAMES]).all()


def test_names_of_entries_tell_all_that_their_rows_depend_on() -> None:
    first = entry("gradient")
    changes: list[dict[str, Any]] = [
        {"robot_sha256": "x"}, {"conditions": ("noise",)}, {"seeds": (1, 3)}, {"duration": 0.4}, {"draws": ()},
        {"plant": "mujoco"}, {"law": "pd"},
    ]  # fmt: skip
    names = [first.name, *(replace(first, **change).name for change in changes)]
    assert len(set(names)) == len(names)
    assert re.fullmatch(r"two_link\.gradient\.[0-9a-f]{16}\.parquet", first.name)


def test_tables_of_rows_have_null_for_what_is_not_known() -> None:
    own = [entry("gradient").about("clean", 1) | {"error": 2.0, "curve": [1.0, 2.0]}, entry("pd").about("clean", 2)]
    table = rows_as_table(own, COLUMNS, "a hash")
    assert table["error"].to_pylist() == [2.0, None]
    assert table["curve"].to_pylist() == [[1.0, 2.0], []]
    assert table.schema.metadata[b"scoring"] == b"a hash"
    assert {field.name: field.metadata[b"unit"].decode() for field in table.schema}["torque_rate"] == "1/s"
    back = rows_of_table(table)
    assert [row["law"] for row in back] == ["gradient", "pd"]
    assert np.isnan([back[1]["error"], back[0]["return_time"]]).all()
    assert back[0]["error"] == 2.0


def test_computed_torque_is_critically_damped() -> None:
    arm = load("two_link")
    known: Any = SimpleNamespace(mechanism=arm, bandwidth=5.0, parameters=arm.inertial_parameters)
    law, rest = _computed_torque(known), np.zeros(2)
    stretched, _ = law.step(law.init(rest, rest), rest + 0.1, rest, ReferencePoint(rest, rest, rest))
    moving, _ = law.step(law.init(rest, rest), rest + 0.1, rest - 0.25, ReferencePoint(rest, rest, rest))
    M, bias = arm.mass_matrix(rest + 0.1), arm.inverse_dynamics(rest + 0.1, rest, rest)
    assert stretched == pytest.approx(bias - M @ np.full(2, 5.0**2 * 0.1))
    coriolis = arm.inverse_dynamics(rest + 0.1, rest - 0.25, rest) - bias
    assert moving == pytest.approx(bias + coriolis)  # 2 w e' makes up for w^2 e at e' = -w e/2
