"""What commands print of results that are written by hand: their numbers, units, conditions and exit codes."""

from __future__ import annotations

import errno
import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import adaptctl
from adaptctl.cli import doctor, drive, gains, identify, numbers, runs, sweep, tune
from adaptctl.cli import main as command_line
from adaptctl.cli.main import main
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.errors import AdaptctlError, InputError, VerdictError
from adaptctl.hardware import LoopTimes, TouchEvent
from adaptctl.hardware.driven_run import DrivenRun
from adaptctl.identification import IdentifiedPayload
from adaptctl.recording import Fact
from adaptctl.simulation import RungeKutta4
from adaptctl.sweeps import cluster as cluster_module
from adaptctl.sweeps import report as sweep_report
from adaptctl.sweeps.folder import Folder
from adaptctl.sweeps.report import SweepReport
from adaptctl.sweeps.study import SweepStudy
from adaptctl.tuning.verification import Verification

ARM = adaptctl.load("two_link")
ROW = {"folder": "a", "robot": "arm", "label": "adaptive", "first_rms_error": 0.0123456, "final_rms_error": 2e-6,
       "terminated": False, "complete": True, "passed": True, "duration": 1.23456}  # fmt: skip


def shown(*parts: Any) -> str:
    console = Console(width=400, force_terminal=False)
    with console.capture() as captured:
        for part in parts:
            console.print(part)
    return captured.get()


def test_a_table_of_runs_has_errors_in_thousandths_and_how_runs_ended(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        ROW,
        ROW | {"passed": False},
        ROW | {"complete": False},
        ROW | {"terminated": True, "first_rms_error": None},
    ]
    runs._print(rows, Path("runs.parquet"))
    cells = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip().startswith("a ")]
    assert [row[3:5] for row in cells] == [["12.3", "0.002"]] * 3 + [["–", "0.002"]]
    assert [" ".join(row[5:]) for row in cells] == ["", "experiment failed", "interrupted", "ended after 1.23 s"]


def test_runs_are_chosen_by_all_conditions_and_those_without_a_value_come_last() -> None:
    rows = [ROW | {"folder": name, "first_rms_error": x} for name, x in (("a", 2.0), ("b", None), ("c", -1.0))]
    table = SimpleNamespace(column_names=list(ROW), to_pylist=lambda: [*rows, ROW | {"robot": "other"}])
    found: Any = SimpleNamespace(table=table)
    assert [row["folder"] for row in runs._selected(found, ["robot=a*", "passed=True"], "first_rms_error")] == [*"cab"]
    assert runs._selected(found, ["robot=arm", "folder=z"], "folder") == []


def driven(**changed: Any) -> DrivenRun:
    """A run at 1 kHz with one period of 1.3 ms among 3,000; errors of its last two seconds are 2 and 3 mrad."""
    times = LoopTimes(1e-3)
    for passed in (1.3e-3, *(2999 * [1e-3])):
        times.count(passed)
    times.busy = 2.5e-3
    time = 1e-3 * np.arange(3000)
    error = np.where((time < 0.999)[:, None], 1.0, [2e-3, -3e-3])
    rollout: Any = SimpleNamespace(time=time, error=error, duration=3.0)
    given: Any = {"rollout": rollout, "times": times, "stopped": "", "by_robot": False, "first_error": 0.00125}
    given |= {"peak_torque_rate": 1234.5, "peak_speed_share": 0.456, "compensates_gravity": True}
    return DrivenRun(**(given | changed))


def test_the_report_of_a_drive_has_its_numbers_in_their_units() -> None:
    told = shown(*drive._report(driven(), ARM, Path("out")))
    joints = [line.split()[1:] for line in told.splitlines() if line.strip().startswith(ARM.primary_joints[0].name)]
    assert joints == [["2", "mrad"]]
    assert "RMS error of the last 2 s" in told
    assert "first error 1.2 mrad; greatest torque rate 1234 N m/s; greatest speed 46% of a limit" in told
    assert "1 periods off, at most 1 late in a row, the longest 1.3 ms" in told
    assert "longest computation of a torque 2.5 ms, 2.5 periods: a robot would not have waited" in told
    assert "STOPPED" not in told
    assert "touched at" not in told
    touch = TouchEvent(2.0, "elbow", -5.21, 1.13)
    told = shown(*drive._report(driven(stopped="a reason", touches=(touch,), first_error=1e-13), ARM, Path("out")))
    assert "STOPPED: a reason" in told
    assert f"touched at 2.00 s: {touch}" in told
    assert "first error 0 mrad" in told
    assert (drive._thousandths(1e-12), drive._thousandths(1.1e-12)) == ("0", "1.1e-09")
    in_time = driven()
    in_time.times.busy = in_time.times.period
    assert "waited" not in drive._computing(in_time)


def test_the_summary_of_a_drive_has_its_numbers() -> None:
    found = drive.as_builtins(driven(), ARM)
    assert list(found["final_rms_error"].values()) == pytest.approx([2e-3, 3e-3])
    names = ("periods", "periods_off", "longest_late_run", "longest_period", "longest_computation", "control_period")
    assert [found[name] for name in names] == [3000, 1, 1, 1.3e-3, 2.5e-3, 1e-3]
    assert (found["payload"], found["touches"], found["first_error"]) == (None, [], 0.00125)
    assert sum(found["period_histogram"]) == 3000
    assert json.loads(json.dumps(found)) == found


def test_what_an_arm_carries_is_told_as_far_as_the_motion_tells_it() -> None:
    ten = from_center_of_mass(2.0, [0.0, 0.05, 0.1], 0.01 * np.eye(3))
    sure, vague = 1e-6 * np.eye(10), 1e-4 * np.eye(10)
    body = IdentifiedPayload("a log", "tool0", ten, vague)
    told = drive._carried(body)
    assert told.startswith(
        "carries 2 kg (deviation 0.01) more than described, centre (0, 0.05, 0.1) m (deviation 0.005"
    )
    assert told.endswith("in the frame of tool0; not determined by this motion: inertia")
    assert "not determined" not in drive._carried(replace(body, covariance=1e-10 * sure))
    assert drive._carried(replace(body, ten=-ten, covariance=1e-10 * sure)).startswith(
        "carries 2 kg (deviation 1e-08) less"
    )
    within = from_center_of_mass(0.019, [0.0, 0.05, 0.1], 1e-4 * np.eye(3))
    assert drive._carried(replace(body, ten=within)) == "carries no unknown load, within 0.02 kg"
    assert drive._carried(replace(body, covariance=np.eye(10))) == "this motion does not determine what the arm carries"


def test_an_outcome_has_its_facts_in_columns_its_notes_and_where_to_look(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    facts = [Fact("Rate", "1 Hz"), Fact("Length of it", "2 m")]
    identify.print_outcome("It went well.", facts, tmp_path, ["a", "b"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[:5] == ["It went well.", "  Rate          1 Hz", "  Length of it  2 m", "  note: a", "  note: b"]
    assert lines[-1] == f"Report:      {tmp_path / 'report.html'}"
    assert not any(line.startswith("Recording:") for line in lines)
    (tmp_path / "recording.rrd").touch()
    identify.print_outcome("It went well.", facts, tmp_path)
    assert f"Recording:   rerun {tmp_path / 'recording.rrd'}" in capsys.readouterr().out


def test_many_runs_are_started_where_that_is_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    sweep._validate_few(20_000, False)
    sweep._validate_few(20_001, True)
    for answer, is_terminal in (("y\n", False), ("no\n", True), ("\n", True)):
        monkeypatch.setattr(sys, "stdin", typed := io.StringIO(answer))
        monkeypatch.setattr(typed, "isatty", lambda said=is_terminal: said)
        with pytest.raises(InputError, match="20001 runs need a confirmation"):
            sweep._validate_few(20_001, False)
    for answer in ("y\n", "Yes\n"):
        monkeypatch.setattr(sys, "stdin", typed := io.StringIO(answer))
        monkeypatch.setattr(typed, "isatty", lambda: True)
        sweep._validate_few(20_001, False)


def test_the_status_of_a_sweep_counts_whole_shards(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = SweepStudy.named("adaptive", {"robot": "two_link", "seed": "0..6"}, controllers=("adaptive",))
    Folder.opened(tmp_path, study, 3, [])
    for name in ("done", ".beside"):
        (tmp_path / "shards").mkdir(exist_ok=True)
        (tmp_path / "shards" / f"{name}.parquet").touch()
    assert main(["sweep", "status", str(tmp_path), "--json"]) == 0
    counts = {"shards": 1, "shards_in_all": 3, "runs": 7}
    assert json.loads(capsys.readouterr().out) == {"schema": sweep.STATUS_SCHEMA, **counts}
    (tmp_path / "shards" / "done.parquet").unlink()
    assert main(["sweep", "status", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "0 of 3 shards of 3 runs are complete\n"


@pytest.mark.parametrize(("diverged", "failed", "code"), [(0, 0, 0), (1, 0, 3), (0, 1, 3)])
def test_a_sweep_with_failures_fails_where_that_is_asked_for(
    diverged: int, failed: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts = {"diverged": diverged, "failed": failed}
    monkeypatch.setattr(cluster_module, "sweep", lambda *_: None)
    monkeypatch.setattr(sweep_report, "write_report", lambda out: out)
    monkeypatch.setattr(SweepReport, "of", lambda out: SimpleNamespace(rows=[1, 2], counts=lambda rows: counts))
    monkeypatch.setattr(sweep, "_print_status", lambda out: 0)
    words = ["sweep", "adaptive", "--robot", "two_link", "--out", str(tmp_path)]
    assert [main(words), main([*words, "--fail-on-failure"])] == [0, code]


@pytest.mark.parametrize(("size", "code"), [("0", 2), ("100001", 2), ("1", 130), ("100000", 130)])
def test_a_sweep_gives_its_workers_certificates_in_order_and_shards_of_a_size(
    size: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = []

    def seen(*arguments: Any) -> None:
        given.append(arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(cluster_module, "Cluster", seen)
    files = [tmp_path / name for name in ("ca", "cert", "key")]
    tls = [
        word for flag, file in zip(("ca", "cert", "key"), files, strict=True) for word in (f"--tls-{flag}", str(file))
    ]
    words = ["sweep", "adaptive", "--robot", "two_link", "--out", str(tmp_path / "out"), "--shard-size", size]
    assert main([*words, "--jobs", "3", *tls]) == code
    assert given == [(3, None, None, tuple(files))] * (code == 130)
    assert main([*words, *tls[:4]]) == 2


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "x.csv"), 1, "x.csv: no such file or directory"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "x"), 2, "x: file name too long"),
        (OSError(errno.ELOOP, "Too many levels of symbolic links", "x"), 2, "x: too many levels of symbolic links"),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "x"), 2, "x: not a directory"),
        (OSError("the socket\nis closed"), 1, "the socket is closed"),
        (MemoryError("of 8 GB"), 1, "out of memory"),
        (AdaptctlError(""), 1, "AdaptctlError"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 1, ""),
        (VerdictError("no"), 3, "no"),
        (InputError("no"), 2, "no"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_each_kind_of_error_has_its_code_and_line(
    error: BaseException, code: int, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(given: object) -> None:
        raise error

    monkeypatch.setattr(command_line, "_validate_command", fail)
    assert main(["runs", "x"]) == code
    assert capsys.readouterr().err == (f"adaptctl: {told}\n" if told else "")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_full_disk_is_no_wrong_input(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(given: object) -> None:
        raise InputError("x: cannot be written") from OSError(number, "full")

    monkeypatch.setattr(command_line, "_validate_command", fail)
    assert main(["runs", "x"]) == 1


@pytest.mark.parametrize(
    ("words", "command"),
    [
        (["sweep", "status", "x"], "sweep"),
        (["experiment", "run", "adaptive", "--seed", "1"], "experiment run adaptive"),
    ],
)
def test_a_missing_package_is_told_with_the_command_that_needs_it(
    words: list[str], command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(given: object) -> None:
        raise ModuleNotFoundError(name="dask.array")

    monkeypatch.setattr(command_line, "_validate_command", fail)
    assert main(words) == 1
    assert capsys.readouterr().err == f"adaptctl: adaptctl {command} needs dask: pip install 'adaptctl[sweep]'\n"


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        *(("2ms", "s", "0.002"), ("2 us", "s", "2e-06"), ("2µs", "s", "2e-06"), ("2min", "s", "120")),
        *(
            ("2h", "s", "7200"),
            ("2kHz", "Hz", "2000"),
            ("180deg", "rad", "3.141592654"),
            ("180°", "rad", "3.141592654"),
        ),
        *(("2mm", "m", "0.002"), ("2cm", "m", "0.02"), ("2g", "kg", "0.002"), ("2kg", "kg", "2")),
        *(("500Hz", "s", "0.002"), ("0.5s", "Hz", "2"), ("2,5", "m", "2.5")),
    ],
)
def test_a_number_in_another_unit_is_written_out_in_the_flags_own(text: str, unit: str, number: str) -> None:
    assert f"got {text!r}; write {number}" in numbers._instead(text, unit, ())


def test_an_identification_in_json_has_its_verdicts_facts_logs_and_warnings(monkeypatch: pytest.MonkeyPatch) -> None:
    from adaptctl.identification import report

    told = {"verdict": "good", "facts": [Fact("Rate", "1 Hz")], "log_lines": [("a.csv", "3 s")]}
    joint: Any = SimpleNamespace(name="elbow", as_builtins=lambda: {"rms": 0.5})
    for name, answer in (told | {"joint_verdicts": [joint]}).items():
        monkeypatch.setattr(report, name, lambda found, answer=answer: answer)
    found: Any = SimpleNamespace(warnings=("slow",))
    assert identify.as_builtins(found, Path("out")) == {
        "schema": identify.SCHEMA,
        "folder": "out",
        "verdict": "good",
        "joints": {"elbow": {"rms": 0.5}},
        "facts": {"Rate": "1 Hz"},
        "logs": {"a.csv": "3 s"},
        "warnings": ["slow"],
    }


@pytest.mark.parametrize("failed", [False, True])
def test_the_report_of_a_tuning_has_its_numbers(failed: bool) -> None:
    runs = [Verification("nominal", 0.1, 0.002, 0.05, 0.3, 0.01), Verification("delayed", 0.1, 0.2, 0.05, 0.3, 0.5)]
    moved = {"center": [0.1, 0.2], "amplitude": [0.345678, 0.4], "frequency": [0.1, 0.2]}
    reference = SimpleNamespace(**{name: np.array(values) for name, values in moved.items()})
    tuning: Any = SimpleNamespace(
        mechanism=ARM, failed=failed, verified=runs, integrator=RungeKutta4(), substeps=3, control_period=0.002,
        limited_by=("the delay", "the torque"), notes=("a note",), torque_share=np.array([0.123, 0.456]),
        gains=SimpleNamespace(bandwidth=np.array([4.0, 5.0]), damping=np.array([60.0, 7.0])), reference=reference,
    )  # fmt: skip
    told = shown(*tune.report(tuning))
    assert ("FAILED" in told) == failed
    assert "integrator RungeKutta4, 3 steps per 0.002 s period" in told
    first, second = (joint.name for joint in ARM.primary_joints)
    assert [first, "4", "60", "0.1", "0.346", "0.1", "12%"] in [line.split() for line in told.splitlines()]
    assert [second, "5", "7", "0.2", "0.4", "0.2", "46%"] in [line.split() for line in told.splitlines()]
    assert [first, "the", "delay"] in [line.split() for line in told.splitlines()]
    assert "a note" in told
    assert [line.strip().endswith("(does not learn)") for line in told.splitlines() if line.strip() in
            {str(runs[0]), f"{runs[1]} (does not learn)"}] == [False, True]  # fmt: skip


def test_margins_of_gains_have_their_units_and_those_beyond_are_red() -> None:
    margin = SimpleNamespace(gain=2.0, phase=np.pi / 3.0, delay=0.0125, crossover=41.23456)
    design: Any = SimpleNamespace(margins=[margin] * 2, least_inertia=np.array([0.6, 0.5]), control_period=0.002)
    gain, inertia, *rest = gains._margins(design, 0)
    assert (gain, inertia) == ("× 2", ("× 0.6", ""))
    assert rest == ["60°", "12.5 ms", "6.25", "41.23 rad/s"]
    assert list(gains._margins(design, 1))[1] == ("× 0.5", "red")
    assert [gains._number(x) for x in (None, np.nan, np.inf, 1234.56)] == ["–", "–", "∞", "1235"]


def test_the_poles_that_a_period_carries_are_told() -> None:
    design: Any = SimpleNamespace(
        sampled_gain=0.5,
        largest_sampled_gain=1.2,
        max_bandwidth_factor=2.5,
        max_pole_magnitude=8.0,
        is_well_damped=True,
    )
    both, fastest = gains._together(design)
    assert "= 0.5 at the worst configuration found; up to 1.2 is allowed" in both
    assert "up to 2.5 times as fast are stable: the fastest at 20 1/s instead of 8" in fastest
    design.is_well_damped, design.max_bandwidth_factor = False, np.inf
    assert list(gains._together(design))[1:] == [
        "Any poles are stable at this period.",
        "Λ and K need a damping ratio of at least 1.",
    ]


def test_stated_delays_and_counts_are_effects_of_a_tuning() -> None:
    assert tune._effects(0, 0) == []
    delay, encoder, differences = tune._effects(2, 12)
    assert (delay.periods, encoder.resolution, differences.cutoff) == (2, pytest.approx(2.0 * np.pi / 4096), 60.0)  # type: ignore[attr-defined]
    assert len(tune._effects(0, tune.MAX_BITS)) == 2
    with pytest.raises(InputError, match="encoder_bits"):
        tune._effects(0, tune.MAX_BITS + 1)


def test_the_doctor_tells_what_is_there_missing_and_wrong() -> None:
    found: dict[str, Any] = {
        "adaptctl": "1.2", "python": "3.11", "platform": "Linux", "viewer": None,
        "packages": {"numpy": "2.0", "rich": None},
        "compiler": {"lanes": 4, "error": None}, "cache": {"folder": "/c", "objects": 3, "bytes": 2**20 + 2**19},
        "extras": {"logs": {"mcap": "1.0", "rosbags": None}, "all": {"x": "3"}, "none": {"y": None}}, "wrong": [],
    }  # fmt: skip
    lines = [" ".join(line.split()) for line in doctor._lines(found)]
    assert {"compiler works, 4 lanes of doubles", "cache /c: 3 objects, 1.5 MB", "viewer missing"} < set(lines)
    assert {"numpy 2.0", "rich missing", "logs mcap 1.0; missing: rosbags", "all x 3", "none missing: y"} < set(lines)
    assert lines[-1] == "No problems found."
    wrong = found | {"compiler": {"lanes": None, "error": "no compiler"}, "wrong": ["a", "b"], "viewer": "/v"}
    wrong["cache"] = wrong["cache"] | {"folder": None}
    lines = [" ".join(line.split()) for line in doctor._lines(wrong)]
    assert {"compiler no compiler", "cache off: 3 objects, 1.5 MB", "viewer /v"} < set(lines)
    assert lines[-2:] == ["wrong: a", "wrong: b"]


@pytest.mark.parametrize(("json_asked", "written"), [(True, False), (True, True), (False, True), (False, False)])
def test_a_design_is_printed_and_written_as_it_is_asked_for(
    json_asked: bool, written: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from adaptctl import design as library
    from adaptctl.cli import design as command
    from adaptctl.design import report

    done: list[Any] = []
    monkeypatch.setattr(library.DesignTask, "within_limits", lambda arm, samples, seed, speed: "task")
    monkeypatch.setattr(library, "design_study", lambda task, added, **given: (task, added, given["percent"]))
    monkeypatch.setattr(report, "as_builtins", lambda study, detail, runs: {"study": list(study), "runs": len(runs)})
    monkeypatch.setattr(report, "report", lambda study, detail, runs: SimpleNamespace(sections="sections"))
    monkeypatch.setattr(report, "write_study", lambda folder, *of: done.append(of[2]))
    monkeypatch.setattr(command, "print_sections", done.append)
    words = ["design", "two_link", *(["--json"] * json_asked), *(["--out", str(tmp_path / "out")] * written)]
    assert main(words) == 0
    content = {"study": ["task", 1.0, 1.0], "runs": 0}
    assert done == [content] * written + ["sections"] * (not json_asked)
    out = capsys.readouterr().out
    assert (json.loads(out) if json_asked else out) == (content if json_asked else "")
